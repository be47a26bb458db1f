#pragma once

// Edges between two triangles.

#include <array>
#include <cstdint>
#include <vector>

#include "lapseam/mesh.h"

namespace lapseam {

class Context;

struct SharedEdge {
  std::uint32_t a = 0, b = 0;               ///< triangles, a < b
  std::uint8_t corner_a = 0, corner_b = 0;  ///< the edge runs from this corner of each to its next
};

/// Of edges with more than two triangles, each with the next. By vertices of the edge, then triangles.
std::vector<SharedEdge> find_shared_edges(const Mesh& mesh, Context& context);

inline constexpr std::uint32_t kNoEdge = kInvalidIndex;
/// Per triangle, the shared edges (indices into the list) at its sides.
std::vector<std::array<std::uint32_t, 3>> edges_of_triangles(const Mesh& mesh, const std::vector<SharedEdge>& edges);

/// Root triangle of each triangle's connected region of one label; kInvalidIndex labels belong to none.
std::vector<std::uint32_t> find_regions(const std::vector<SharedEdge>& edges, const std::vector<std::uint32_t>& label);

}  // namespace lapseam
