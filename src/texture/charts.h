#pragma once

// Regions of images that triangles show, as sets of square blocks, and where they lie in the pages.

#include <Eigen/Core>
#include <span>
#include <vector>

#include "lapseam/mesh.h"
#include "texture/blocks.h"
#include "texture/layout.h"
#include "texture/packing.h"

namespace lapseam {

class Context;

/// Surface laid out as one image, or a smaller copy of it, has it, moved by whole pixels so that it owns few blocks of
/// the page, and turned by quarters. Its pixels come from that image and from others.
struct Chart {
  std::uint32_t view = 0;                  ///< whose image it is laid out as
  float scale = 1;                         ///< pixels of the chart per pixel of the image
  Eigen::Vector2i corner_px{0, 0};         ///< where its first pixel lies in the scaled image
  BlockShape shape;                        ///< blocks that it owns
  BlockPlace place;                        ///< page, and blocks there
  bool is_scattered = false;               ///< see find_scattered
  std::vector<std::uint32_t> triangles{};  ///< in increasing order
  std::vector<std::uint32_t> parts{};      ///< views whose images it shows, in increasing order

  /// Of a pixel of the chart, its place on the page.
  template <typename T>
  std::pair<T, T> on_page(T x, T y) const {
    const auto [u, v] = turn(x, y, T(shape.width * kBlock_px), T(shape.height * kBlock_px), place.turns);
    return {u + T(place.x * kBlock_px), v + T(place.y * kBlock_px)};
  }
  template <typename Page>
  auto& pixel(Page& page, int x, int y) const {
    const auto [u, v] = on_page(x, y);
    return page.at(u, v);
  }
  bool owns(int x, int y) const {  ///< pixel of the chart
    return shape.used[std::size_t(y / kBlock_px) * std::size_t(shape.width) + std::size_t(x / kBlock_px)] != 0;
  }
  /// From a pixel of the chart to the image's, and back.
  Eigen::Vector2f to_image(const Eigen::Vector2f& p) const {
    return ((p + corner_px.cast<float>()).array() + 0.5f) / scale - 0.5f;
  }
  Eigen::Vector2f from_image(const Eigen::Vector2f& p) const {
    return ((p.array() + 0.5f) * scale - 0.5f).matrix() - corner_px.cast<float>();
  }
};

struct Charts {
  std::vector<Chart> charts;
  std::vector<std::uint32_t> chart_of_triangle;  ///< kInvalidIndex: no image shows it
  std::vector<Corners> pixels;                   ///< corners of each triangle in its chart
  std::vector<std::uint32_t> view_of_triangle;   ///< whose image it shows
  std::vector<std::uint16_t> part_of_triangle;   ///< place of that in its chart's parts
  std::vector<std::uint8_t> is_resampled;        ///< see Layout
};

/// view_of_triangle: whose image it shows. scale_of_triangle: over 0 to 1, the same for all of a region. Triangles of
/// one sheet and scale whose blocks meet share a chart; what is larger than a page is cut. Every block that a texture
/// lookup at a point of a triangle reads at mip levels 0 to 3 (bilinear in each) is owned. Numbered by first triangle.
/// Triangles that are scattered (empty: none) share charts with each other alone.
Charts make_charts(const Layout& layout, const std::vector<std::uint32_t>& view_of_triangle,
                   std::span<const float> scale_of_triangle, std::span<const std::uint8_t> is_scattered,
                   int page_blocks, Context& context);

/// Cuts sheets that would leave holes on a page into ones that leave fewer.
void cut_sheets(Layout& layout, int page_blocks, Context& context);

/// Of each triangle, whether its region (root: of each triangle) would fill little of the blocks that are owned for it
/// alone, while its triangles are so small that colours of its vertices show as much.
std::vector<std::uint8_t> find_scattered(const Charts& charts, const std::vector<std::uint32_t>& root);

/// Of the 8 × 8 ways in which a grid of blocks may lie over triangles, the move of these to the one where the fewest
/// blocks are read. Those that are read from no deeper than squeezed_px count less: they can be squeezed out.
Eigen::Vector2i best_shift(const std::vector<std::uint32_t>& triangles, const std::vector<Corners>& pixels,
                           int squeezed_px);

}  // namespace lapseam
