#pragma once

// Joining registered meshes that overlap, without range images. After G. Turk, M. Levoy, Zippered Polygon Meshes from
// Range Images, 1994, and Y. Sun, C. Dumont, M. Abidi 2000, §2.3.

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "lapseam/mesh.h"

namespace lapseam {

class Context;

struct SewMeshesOptions {
  /// Surfaces that face alike and lie no farther apart than this are one, metres. 0: from the lengths of the edges and
  /// from how far the meshes lie apart where they overlap.
  double overlap_distance_m = 0;
};

/// What became of one input.
struct SewnMesh {
  std::uint64_t triangles = 0;       ///< as given
  std::uint64_t defects = 0;         ///< left out: repeated vertex, no area, an edge that was taken already
  std::uint64_t removed = 0;         ///< lost to another mesh
  std::uint64_t triangles_kept = 0;  ///< in the result
};

struct SewMeshesReport {
  double edge_length_m = 0;       ///< median, over all meshes
  double disagreement_m = 0;      ///< median distance of meshes where they overlap; 0: they do not
  double overlap_distance_m = 0;  ///< as used
  std::vector<SewnMesh> meshes;
  std::uint64_t front_triangles = 0;    ///< seam triangles made edge by edge (some are replaced later)
  std::uint64_t loop_triangles = 0;     ///< seam triangles made loop by loop (some are replaced later)
  std::uint64_t defects_widened = 0;    ///< loops that could not be closed, and fans that touch: cut wider
  std::uint64_t removed_to_repair = 0;  ///< triangles of the inputs that went for it
  std::uint64_t flips = 0;              ///< edges of the seam that were turned for a better shape
  std::uint64_t collapses = 0;          ///< short edges at the seam that were taken out for a better shape
  std::uint64_t seam_triangles = 0;     ///< in the result
  std::uint64_t open_edges = 0;         ///< of cracks that are left
};

/// One mesh from any number that overlap. Where two show the same surface (closest points within the overlap distance,
/// normals alike, not at a border) the triangle nearer to its own mesh's border goes; where both are far from it, the
/// later mesh's. Borders are then sewn with triangles tagged kSeam, whose vertices are vertices of the inputs; none is
/// moved. The result is edge-manifold and consistently oriented, and no seam triangle meets another triangle (exact).
/// What does not overlap is kept as it is.
///
/// Inputs: indexed (not a soup), consistently oriented; triangles that break this, or have no area, are left out with a
/// warning. Colours, vertex and triangle provenance are kept where all inputs have them, textures are not. The origin
/// is that of the first mesh. Same bytes for any number of threads. Throws InvalidInput naming the mesh ("mesh 0", …)
/// when there is none, or one has no triangles or fails check_mesh; Cancelled.
Mesh sew_meshes(std::span<const Mesh> meshes, const SewMeshesOptions& options, SewMeshesReport& report,
                Context& context);

/// One JSON object: units in the keys.
std::string to_json(const SewMeshesReport& report);

}  // namespace lapseam
