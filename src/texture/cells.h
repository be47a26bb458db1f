#pragma once

// Triangles in small groups: what images are chosen for. Fewer than triangles by an order, and no image changes for the
// sake of one.

#include <span>
#include <vector>

#include "texture/shared_edges.h"

namespace lapseam {

struct Cells {
  std::vector<std::uint32_t> triangles;  ///< cell after cell
  std::vector<std::uint32_t> begin;      ///< of each cell in it, and the end of the last

  std::size_t count() const { return begin.size() - 1; }
  std::span<const std::uint32_t> of(std::size_t cell) const {
    return {triangles.data() + begin[cell], triangles.data() + begin[cell + 1]};
  }
};

/// Connected triangles that face alike, up to a number, each cell grown around its first.
Cells make_cells(const Mesh& mesh, const std::vector<SharedEdge>& edges);

/// The same, with the cells that are marked cut into single triangles.
Cells take_apart(const Cells& cells, const std::vector<std::uint8_t>& is_marked);

/// Where two cells meet, along all the edges that they share.
struct CellBorder {
  std::uint32_t a, b;  ///< a < b
  float length_m;
};

struct CellBorders {
  std::vector<CellBorder> all;         ///< by a, then b
  std::vector<std::uint32_t> numbers;  ///< of the borders of each cell, cell after cell
  std::vector<std::uint32_t> begin;    ///< of each cell in them, and the end of the last

  std::span<const std::uint32_t> of(std::uint32_t cell) const {
    return {numbers.data() + begin[cell], numbers.data() + begin[cell + 1]};
  }
  std::uint32_t across(std::uint32_t cell, std::uint32_t border) const {
    return all[border].a == cell ? all[border].b : all[border].a;
  }
};

/// Of the cells that are marked, among each other.
CellBorders find_borders(const Mesh& mesh, const Cells& cells, const std::vector<SharedEdge>& edges,
                         const std::vector<std::uint8_t>& is_marked);

/// Cell of each triangle.
std::vector<std::uint32_t> cell_of_triangles(const Cells& cells);

}  // namespace lapseam
