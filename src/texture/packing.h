#pragma once

// Shapes made of square blocks, packed into pages.

#include <cstdint>
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
};

struct BlockPage {
  int width = 0, height = 0;  ///< as far as it is used
};

struct Packing {
  std::vector<BlockPlace> places;  ///< of each shape
  std::vector<BlockPage> pages;
};

/// Largest first, each to one of the first places where it meets nothing, by rows: there where most of its outline
/// touches others or the page's edge. Shapes may lie inside each other's bays.
/// Pages are page_width × page_height blocks at most; every shape fits on one.
Packing pack_blocks(const std::vector<BlockShape>& shapes, int page_width, int page_height, Context& context);

}  // namespace lapseam
