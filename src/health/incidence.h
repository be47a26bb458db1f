#pragma once

// Which triangles meet in a vertex, and which vertices are at the same place.

#include <Eigen/Core>
#include <cstdint>
#include <span>
#include <vector>

#include "lapseam/mesh.h"

namespace lapseam {

class Context;

/// The triangles around each vertex, in increasing order. Triangles with a repeated vertex are left out.
struct Incidence {
  std::vector<std::uint32_t> offset;    ///< vertex count + 1
  std::vector<std::uint32_t> triangle;  ///< three times the triangles

  std::span<const std::uint32_t> around(std::size_t vertex) const {
    return {triangle.data() + offset[vertex], offset[vertex + 1] - offset[vertex]};
  }
};
Incidence build_incidence(std::size_t vertices, std::span<const Triangle> triangles);

inline bool has_repeated_vertex(const Triangle& t) { return t[0] == t[1] || t[1] == t[2] || t[2] == t[0]; }

/// For each vertex, the index that it has after exactly equal positions became one vertex (0 equals −0). New indices
/// follow the first vertex at each place.
struct Weld {
  std::vector<std::uint32_t> new_index;
  std::vector<std::uint32_t> first_vertex;  ///< per new index
};
Weld weld_equal_positions(std::span<const Eigen::Vector3f> positions_m, Context& context);

/// Positions and triangles after welding; triangles keep their number and order, some may now repeat a vertex.
struct WeldedSurface {
  std::vector<Eigen::Vector3f> positions_m;
  std::vector<Triangle> triangles;
};
WeldedSurface weld_surface(const Mesh& mesh, Context& context);

}  // namespace lapseam
