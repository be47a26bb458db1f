#include <vector>

#include "core/parallel.h"
#include "lapseam/overlap.h"

namespace lapseam {
namespace {

// Grows one piece from a seed. Returns whether any of its triangles lost a neighbour to another view.
bool grow_piece(const PatchGrid& grid, PatchGrid::Place seed, std::vector<std::uint8_t>& is_visited,
                std::vector<PatchGrid::Place>& piece) {
  bool is_cut = false;
  piece.assign(1, seed);
  is_visited[seed.cell] |= std::uint8_t(1 << seed.slot);
  for (std::size_t i = 0; i < piece.size(); ++i) {
    const PatchGrid::Place at = piece[i];
    const auto corners = grid.corners(at.cell, at.slot);
    for (std::size_t k = 0; k < 3; ++k) {
      const auto next = grid.neighbor_across(at.cell, at.slot, corners[k], corners[(k + 1) % 3]);
      if (!next || !grid.exists(next->cell, next->slot)) continue;
      if (!grid.is_alive(next->cell, next->slot)) {
        is_cut = true;
        continue;
      }
      const auto bit = std::uint8_t(1 << next->slot);
      if (is_visited[next->cell] & bit) continue;
      is_visited[next->cell] |= bit;
      piece.push_back(*next);
    }
  }
  return is_cut;
}

std::uint64_t remove_islands_of(PatchGrid& grid, std::uint64_t smallest) {
  std::vector<std::uint8_t> is_visited(grid.cells.size(), 0);
  std::vector<PatchGrid::Place> piece, doomed;
  for (std::size_t cell = 0; cell < grid.cells.size(); ++cell)
    for (int slot = 0; slot < 2; ++slot) {
      if (!grid.is_alive(cell, slot) || (is_visited[cell] >> slot & 1)) continue;
      if (grow_piece(grid, {cell, slot}, is_visited, piece) && piece.size() < smallest)
        doomed.insert(doomed.end(), piece.begin(), piece.end());
    }
  for (const PatchGrid::Place& place : doomed)
    grid.cells[place.cell] &= std::uint8_t(~(PatchGrid::kAlive << place.slot));
  return doomed.size();
}

}  // namespace

std::uint64_t remove_islands(std::span<Patch> patches, std::uint64_t smallest, Context& context) {
  std::vector<std::uint64_t> removed(patches.size(), 0);
  parallel_for(context, patches.size(), 1,
               [&](std::size_t i) { removed[i] = remove_islands_of(patches[i].grid, smallest); });
  std::uint64_t sum = 0;
  for (const std::uint64_t n : removed) sum += n;
  return sum;
}

}  // namespace lapseam
