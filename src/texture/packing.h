#pragma once

// Shapes made of square blocks, packed into pages.

#include <cstdint>
#include <utility>
#include <vector>

namespace lapseam {

class Context;

/// Rows of blocks; bit x of a row says whether the block is used.
struct BlockShape {
  int width = 0, height = 0;
  std::vector<std::uint8_t> used;  ///< width · height
};

struct BlockPlace {
  int page = 0, x = 0, y = 0;
  int turns = 0;  ///< quarter turns, that of the x axis to the y axis; of the mirrored shape (x backwards) from 4 on
};

inline constexpr int kMostTurns = 8;

/// Where (x, y) of a grid of points comes to lie when the grid is turned, and before that mirrored where turns are 4 or
/// more; corners keep lying in corners.
template <typename T>
std::pair<T, T> turn(T x, T y, T width, T height, int turns) {
  if (turns >= 4) x = width - 1 - x;
  switch (turns % 4) {
    case 1:
      return {height - 1 - y, x};
    case 2:
      return {width - 1 - x, height - 1 - y};
    case 3:
      return {y, width - 1 - x};
    default:
      return {x, y};
  }
}

struct BlockPage {
  int width = 0, height = 0;  ///< as far as it is used
};

struct Packing {
  std::vector<BlockPlace> places;  ///< of each shape
  std::vector<BlockPage> pages;
};

/// Largest first, each to one of the first places where it meets nothing, by rows: there where most of its outline
/// touches others or the page's edge, in that of four turns, mirrored or not, where it touches the most. Shapes may lie
/// inside each other's bays. Pages are page_width × page_height blocks at most; every shape fits on one as it is.
Packing pack_blocks(const std::vector<BlockShape>& shapes, int page_width, int page_height, Context& context);

/// Lowers the pages of a packing: again and again some shapes around a gap are taken out and put in again in another
/// order, until all fit on a page that is a row lower. For a bounded work, which is the same on every machine.
void tighten(const std::vector<BlockShape>& shapes, Packing& packing, Context& context);

}  // namespace lapseam
