#pragma once

// The streams of one primitive as glTF stores them: plain, quantized, or packed.

#include <Eigen/Core>
#include <cstdint>
#include <span>
#include <vector>

#include "io/weld_corners.h"

namespace lapseam {

/// Positions on a grid of 16 bits: local position = low + step · integer.
struct PositionGrid {
  Eigen::Vector3f low_m = Eigen::Vector3f::Zero();
  float step_m = 1;
};
/// The smallest that holds all vertices of the pages.
PositionGrid make_position_grid(const Mesh& mesh, const std::vector<WeldedPage>& pages);
std::array<std::uint16_t, 3> quantize(const PositionGrid& grid, const Eigen::Vector3f& position_m);

/// Triangles in an order that lets neighbours share vertices, and vertices in the order in which they are used: what
/// the packing below is made for.
void reorder_for_packing(WeldedPage& page);

/// EXT_meshopt_compression, modes ATTRIBUTES and TRIANGLES. stride: a multiple of 4, up to 256.
std::vector<char> pack_vertices(std::span<const char> bytes, std::size_t stride);
std::vector<char> pack_triangles(std::span<const std::uint32_t> indices, std::size_t vertex_count);

/// The reverse, for the reader. False when the bytes are not such. mode: as in the file.
bool unpack(std::span<const char> packed, std::string_view mode, std::size_t count, std::size_t stride,
            std::vector<char>& out);

}  // namespace lapseam
