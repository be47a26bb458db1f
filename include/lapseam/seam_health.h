#pragma once

// How well are the patches of a mesh put together? Figures that need its tags and the view of each triangle.

#include <array>
#include <cstdint>
#include <string>

#include "lapseam/mesh.h"

namespace lapseam {

class Context;

struct SeamOptions {
  /// A patch of fewer triangles is an island: confetti between views that are about equally good.
  std::uint64_t island_triangles = 40;
  /// Exact, and costs more than all the rest together.
  bool self_intersections = true;
};

/// Lengths in metres. A patch is a piece of measured triangles of one view that are joined by shared edges.
struct SeamHealth {
  std::uint64_t measured_triangles = 0;
  std::uint64_t seam_triangles = 0;
  std::uint64_t filled_triangles = 0;
  double seam_area_m2 = 0;
  double seam_area_share = 0;  ///< of the whole area, 0 … 1

  /// Where patches meet: edges between measured triangles of two views, and half of the edges between a measured
  /// triangle and one that is not, since a strip of seam triangles has two sides.
  double seam_length_m = 0;
  double seam_length_per_area_per_m = 0;  ///< divided by the whole area

  std::uint64_t patches = 0;
  std::uint64_t islands = 0;
  std::uint64_t triangles_in_islands = 0;

  /// The smallest angle of each seam triangle, percentiles 1, 5, 25; 0 when there is none.
  std::array<double, 3> seam_min_angle_percentiles_deg{};

  /// Seam triangles that meet another triangle, of whatever tag, as in MeshHealth.
  bool self_intersections_checked = false;
  std::uint64_t self_intersecting_seam_triangles = 0;
};

/// Indices as given: vertices at equal positions stay apart. Triangles with a repeated vertex take part in nothing. The
/// same figures for any number of threads. About 0.2 µs a triangle without self-intersections, 25 bytes a triangle.
/// Throws InvalidInput as check_mesh does, and when the mesh has no tags or no views of its triangles.
SeamHealth check_seams(const Mesh& mesh, const SeamOptions& options, Context& context);

/// One JSON object with a key per figure: units in the key, shares in percent.
std::string to_json(const SeamHealth& seams);

}  // namespace lapseam
