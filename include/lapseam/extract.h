#pragma once

// From implicit patches to one mesh with indices.

#include <span>
#include <vector>

#include "lapseam/mesh.h"
#include "lapseam/patch.h"

namespace lapseam {

class Context;

/// A directed edge (a → b) of exactly one triangle, which lies to its left.
struct BoundaryEdge {
  std::uint32_t a = 0, b = 0;
  std::uint32_t triangle = 0;
};

/// The alive triangles of all patches, and where they were cut.
struct ExtractedMesh {
  Mesh mesh;  ///< with provenance; all triangles kMeasured; one vertex per sample in use
  /// Edges whose triangle lost its neighbour to another patch ("active", Sun et al. 2000, §2.3), ordered by triangle.
  std::vector<BoundaryEdge> active_edges;
};

/// Vertices are ordered by view and pixel, triangles by view, cell and slot. Deterministic.
ExtractedMesh extract(std::span<const Patch> patches, Context& context);

}  // namespace lapseam
