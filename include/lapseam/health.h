#pragma once

// Is this mesh fit for use? Counts of everything that can be wrong with its topology and its shape.

#include <array>
#include <cstdint>
#include <optional>
#include <string>

#include "lapseam/mesh.h"
#include "lapseam/seam_health.h"

namespace lapseam {

class Context;

struct HealthOptions {
  /// First make one vertex of vertices at exactly equal positions (a triangle soup has no topology otherwise).
  bool weld = false;
  /// Self-intersections are exact and cost more than all the rest together.
  bool self_intersections = true;
};

/// Lengths in metres. "Triangle" in all counts of topology means one with three different vertices; the others are
/// counted in degenerate_triangles and take part in nothing else.
struct MeshHealth {
  std::uint64_t vertices = 0;   ///< as given, or after welding
  std::uint64_t triangles = 0;  ///< as given
  double area_m2 = 0;

  std::uint64_t components = 0;                ///< triangles joined by shared vertices
  std::uint64_t components_100_triangles = 0;  ///< those of at least a hundred triangles
  double largest_component_share = 0;          ///< of the triangles, 0 … 1
  std::uint64_t smallest_component_triangles = 0;
  std::uint64_t components_99_percent_area = 0;  ///< so many of the largest hold 99 % of the area

  std::uint64_t edges = 0;
  std::uint64_t boundary_edges = 0;  ///< with one triangle
  double boundary_length_m = 0;
  std::uint64_t boundary_loops = 0;     ///< outlines; one that touches itself in a point counts once for each fan
  std::uint64_t nonmanifold_edges = 0;  ///< with more than two triangles
  std::uint64_t misoriented_edges = 0;  ///< edges that two triangles run through in the same direction
  std::uint64_t pinched_vertices = 0;   ///< triangles around it fall into several fans that share only the vertex

  std::uint64_t duplicate_triangles = 0;   ///< beyond the first, of triangles with the same three vertices
  std::uint64_t degenerate_triangles = 0;  ///< repeated vertex, or exactly zero area
  std::uint64_t unused_vertices = 0;

  /// Triangles that meet another where they share nothing: exact, touching counts; see self_intersections_checked.
  /// Pairs that share an edge are not tested, nor triangles of zero area.
  bool self_intersections_checked = false;
  std::uint64_t self_intersecting_triangles = 0;
  std::uint64_t self_intersecting_pairs = 0;

  /// The smallest angle of each triangle, percentiles 1, 5, 25, 50.
  std::array<double, 4> min_angle_percentiles_deg{};
  double min_angle_below_10_deg_share = 0;
  double edge_length_median_m = 0;  ///< median over the triangles of the middle one of their three sides

  std::optional<SeamHealth> seams;  ///< of meshes that tell tags and views of their triangles

  /// No edge with more than two triangles, none misoriented, no duplicate or degenerate triangle.
  bool is_edge_manifold() const { return nonmanifold_edges == 0; }
  bool is_sound() const {
    return is_edge_manifold() && misoriented_edges == 0 && duplicate_triangles == 0 && degenerate_triangles == 0;
  }
};

/// Works on the indices as given unless options.weld. Measured on two cores: seven million triangles take 3 s, their
/// self-intersections 13 s more; about 35 bytes a triangle beside the mesh. Throws InvalidInput as check_mesh does.
MeshHealth check_health(const Mesh& mesh, const HealthOptions& options, Context& context);

/// One JSON object with a key per figure: units in the key, shares in percent.
std::string to_json(const MeshHealth& health);

}  // namespace lapseam
