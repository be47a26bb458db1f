#pragma once

// A mesh cut into pieces that lie together in space, so that each fits into the cache and can be worked on alone.

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "lapseam/mesh.h"

namespace lapseam {

class Context;

/// Positions that lie `stride` bytes apart, at the beginning of whatever holds them.
struct StridedPositions {
  const std::byte* data = nullptr;
  std::size_t stride = sizeof(Eigen::Vector3f);
  std::size_t size = 0;
  const Eigen::Vector3f& operator[](std::size_t i) const {
    return *reinterpret_cast<const Eigen::Vector3f*>(data + i * stride);
  }
};

/// Each vertex is of one part. A triangle is in the parts of all its corners: those that cross are in two or three.
struct Partition {
  std::size_t parts = 0;
  std::vector<std::uint32_t> part_of_vertex;
  std::vector<std::uint32_t> rank_of_vertex;   ///< place in its part's list
  std::vector<std::uint32_t> vertex_offset;    ///< parts + 1
  std::vector<std::uint32_t> vertices;         ///< by part, in increasing order
  std::vector<std::uint64_t> triangle_offset;  ///< parts + 1
  std::vector<std::uint32_t> triangles;        ///< by part, in increasing order

  std::span<const std::uint32_t> vertices_of(std::size_t part) const {
    return {vertices.data() + vertex_offset[part], vertex_offset[part + 1] - vertex_offset[part]};
  }
  std::span<const std::uint32_t> triangles_of(std::size_t part) const {
    return {triangles.data() + triangle_offset[part], std::size_t(triangle_offset[part + 1] - triangle_offset[part])};
  }
};

/// Runs of cells along a Morton curve, of about piece_vertices each (more where one cell alone holds more). shift: in
/// [0, 1); moves the cells, so that two partitions of a mesh have their borders in different places. Triangles with a
/// repeated vertex are in no part. Deterministic. About 10 bytes a triangle.
Partition partition(const StridedPositions& positions_m, std::span<const Triangle> triangles,
                    std::size_t piece_vertices, float shift, Context& context);

}  // namespace lapseam
