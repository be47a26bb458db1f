#include "texture/charts.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <tuple>

#include "core/disjoint_sets.h"
#include "core/parallel.h"

namespace lapseam {
namespace {

// Regions that show less than this share of the blocks that are owned for them can go to vertex colours ...
constexpr double kLeastShown = 0.25;
// ... where the longest sides of their triangles are no longer than this, as a mean over the length of all: what
// colours of vertices show there is as fine as pixels, nearly.
constexpr double kLongestSide_px = 3;

/// The triangles of one sheet at one scale.
class SheetCutter {
 public:
  SheetCutter(std::uint32_t view, float scale, bool is_scattered, int page_blocks)
      : view_(view), scale_(scale), is_scattered_(is_scattered), page_blocks_(page_blocks) {}

  void add(std::uint32_t triangle) { triangles_.push_back(triangle); }

  /// Cuts into charts; their triangles' pixels change from the scaled sheet's to the chart's.
  std::vector<Chart> cut(std::vector<Corners>& pixels) const {
    std::vector<Chart> charts;
    for (std::vector<std::uint32_t>& part : parts(pixels))
      charts.push_back(align(make_chart(std::move(part), pixels), pixels));
    return charts;
  }

  /// The triangles of each chart.
  std::vector<std::vector<std::uint32_t>> parts(const std::vector<Corners>& pixels) const {
    const std::vector<std::uint32_t> label = connect_by_blocks(triangles_, pixels);
    std::map<std::uint32_t, BlockBox> boxes;
    for (std::size_t k = 0; k < triangles_.size(); ++k) boxes[label[k]].extend(pixels[triangles_[k]]);
    // By component, and by tiles of half a page for those that are larger than one.
    std::map<std::tuple<std::uint32_t, int, int>, std::vector<std::uint32_t>> pieces;
    for (std::size_t k = 0; k < triangles_.size(); ++k) {
      const std::uint32_t i = triangles_[k];
      const BlockBox& box = boxes[label[k]];
      const bool is_large = box.width() > page_blocks_ || box.height() > page_blocks_;
      const Eigen::Vector2f middle = (pixels[i][0] + pixels[i][1] + pixels[i][2]) / 3;
      const float tile_px = 0.5f * float(page_blocks_ * kBlock_px);
      const auto tile = [&](float x, int from) { return is_large ? int((x - float(from * kBlock_px)) / tile_px) : 0; };
      pieces[{label[k], tile(middle.x(), box.low_u), tile(middle.y(), box.low_v)}].push_back(i);
    }
    std::vector<std::vector<std::uint32_t>> parts;
    for (auto& [key, triangles] : pieces) split(std::move(triangles), pixels, parts);
    return parts;
  }

 private:
  /// Cuts in two, and the parts again, where bays are opened that way: a chart like a frame leaves holes that not
  /// enough small ones are there to fill.
  void split(std::vector<std::uint32_t> triangles, const std::vector<Corners>& pixels,
             std::vector<std::vector<std::uint32_t>>& parts) const {
    const Chart whole = make_chart(triangles, pixels);
    const Cut cut = find_cut(whole.shape);
    std::vector<std::uint32_t> low, high;
    for (const std::uint32_t i : triangles) {
      if (!cut.is_worth_it) break;
      const Eigen::Vector2f middle = (pixels[i][0] + pixels[i][1] + pixels[i][2]) / 3 - corner_of(whole);
      (middle[cut.axis] < float(cut.at * kBlock_px) ? low : high).push_back(i);
    }
    if (low.empty() || high.empty()) return parts.push_back(std::move(triangles));
    split(std::move(low), pixels, parts);
    split(std::move(high), pixels, parts);
  }

  /// Moves a chart to where it owns the fewest blocks, and its triangles' pixels into it.
  Chart align(Chart chart, std::vector<Corners>& pixels) const {
    const auto move = [&](const Eigen::Vector2i& by) {
      for (const std::uint32_t i : chart.triangles)
        for (Eigen::Vector2f& q : pixels[i]) q += by.cast<float>();
    };
    const Eigen::Vector2i shift = best_shift(chart.triangles, pixels, 0);
    move(shift);
    Chart moved = make_chart(chart.triangles, pixels);
    if (owned_blocks(moved) < owned_blocks(chart) && moved.shape.width <= page_blocks_ &&
        moved.shape.height <= page_blocks_) {
      move(-moved.corner_px);
      moved.corner_px -= shift;
      return moved;
    }
    move(-shift - chart.corner_px);
    return chart;
  }

  static std::ptrdiff_t owned_blocks(const Chart& chart) {
    return std::count(chart.shape.used.begin(), chart.shape.used.end(), 1);
  }

  struct Cut {
    bool is_worth_it = false;
    int axis = 0, at = 0;
  };

  static Cut find_cut(const BlockShape& shape) {
    constexpr int kSmallestPart = 4;
    const double box = double(shape.width) * double(shape.height);
    // Of a bay in its box, the share that other charts leave free.
    constexpr double kBayLoss = 0.25;
    Cut best;
    double most = 0;
    for (const int axis : {0, 1}) {
      const int length = axis == 0 ? shape.width : shape.height, across = axis == 0 ? shape.height : shape.width;
      // Of each line of blocks across the axis: how many are used, from where, and to where.
      std::vector<std::array<int, 3>> lines;
      for (int i = 0; i < length; ++i) {
        std::array<int, 3> line{0, across, -1};
        for (int j = 0; j < across; ++j) {
          const int x = axis == 0 ? i : j, y = axis == 0 ? j : i;
          if (!shape.used[std::size_t(y * shape.width + x)]) continue;
          line = {line[0] + 1, std::min(line[1], j), std::max(line[2], j)};
        }
        lines.push_back(line);
      }
      for (int at = kSmallestPart; at <= length - kSmallestPart; ++at) {
        // Both parts own the blocks beside the cut: one line of them and a half more each.
        const double gain = kBayLoss * (box - box_area(lines, 0, at) - box_area(lines, at, length)) -
                            2 * double(lines[std::size_t(at)][0]);
        if (gain > most) most = gain, best = {true, axis, at};
      }
    }
    return best;
  }

  static double box_area(const std::vector<std::array<int, 3>>& lines, int from, int to) {
    int low = 1 << 30, high = -1;
    for (int i = from; i < to; ++i) {
      low = std::min(low, lines[std::size_t(i)][1]);
      high = std::max(high, lines[std::size_t(i)][2]);
    }
    return high < low ? 0 : double(to - from) * double(high - low + 1);
  }

  static Eigen::Vector2f corner_of(const Chart& chart) { return chart.corner_px.cast<float>(); }

  Chart make_chart(std::vector<std::uint32_t> triangles, const std::vector<Corners>& pixels) const {
    const BlockBox box = box_of(triangles, pixels);
    Chart chart;
    chart.view = view_;
    chart.scale = scale_;
    chart.is_scattered = is_scattered_;
    chart.corner_px = {box.low_u * kBlock_px, box.low_v * kBlock_px};
    chart.shape.width = box.width();
    chart.shape.height = box.height();
    chart.shape.used.assign(std::size_t(box.width()) * std::size_t(box.height()), 0);
    for (const std::uint32_t i : triangles)
      for_blocks(pixels[i], [&](int u, int v) { chart.shape.used[box.index(u, v)] = 1; });
    chart.triangles = std::move(triangles);
    return chart;
  }

  std::uint32_t view_;
  float scale_;
  bool is_scattered_;
  int page_blocks_;
  std::vector<std::uint32_t> triangles_;
};

/// Regions of one chart, and how many of them read each block.
class ScatterSearch {
 public:
  ScatterSearch(const Charts& charts, const Chart& chart, const std::vector<std::uint32_t>& root)
      : readers_(chart.shape.used.size(), 0) {
    std::map<std::uint32_t, std::size_t> number;
    for (const std::uint32_t i : chart.triangles) {
      const auto [found, is_new] = number.try_emplace(root[i], regions_.size());
      if (is_new) regions_.emplace_back();
      Region& region = regions_[found->second];
      region.triangles.push_back(i);
      const Corners& p = charts.pixels[i];
      const Eigen::Vector2f ab = p[1] - p[0], ac = p[2] - p[0];
      const double area_px = 0.5 * double(std::abs(ab.x() * ac.y() - ab.y() * ac.x()));
      region.area_px += area_px;
      // In pixels of the image: a limit that makes charts smaller must not turn textures into vertex colours.
      const float longest_2 = std::max({ab.squaredNorm(), ac.squaredNorm(), (ac - ab).squaredNorm()});
      const double longest_px = std::sqrt(double(longest_2)) / double(chart.scale);
      region.lengths_px += longest_px;
      region.squares += longest_px * longest_px;
      for_blocks(p, [&](int u, int v) {
        // Of smaller charts, the last digits can say something else than where they were cut.
        if (u >= 0 && v >= 0 && u < chart.shape.width && v < chart.shape.height)
          region.blocks.push_back(std::uint32_t(v * chart.shape.width + u));
      });
    }
    for (Region& region : regions_) {
      std::sort(region.blocks.begin(), region.blocks.end());
      region.blocks.erase(std::unique(region.blocks.begin(), region.blocks.end()), region.blocks.end());
      for (const std::uint32_t block : region.blocks) ++readers_[block];
    }
    std::stable_sort(regions_.begin(), regions_.end(),
                     [](const Region& a, const Region& b) { return a.area_px < b.area_px; });
  }

  /// Smallest first; in the end all that is left together: regions may have kept each other for the blocks they share.
  void mark(std::vector<std::uint8_t>& is_scattered) {
    double left_px = 0;
    bool are_small = true;
    for (Region& region : regions_) {
      const auto alone = std::count_if(region.blocks.begin(), region.blocks.end(),
                                       [&](std::uint32_t block) { return readers_[block] == 1; });
      region.is_marked = region.is_small() && region.area_px < least_px(double(alone));
      if (!region.is_marked) {
        left_px += region.area_px;
        are_small = are_small && region.is_small();
        continue;
      }
      for (const std::uint32_t block : region.blocks) --readers_[block];
    }
    const auto left_blocks = double(readers_.size() - std::size_t(std::count(readers_.begin(), readers_.end(), 0u)));
    const bool is_all = are_small && left_px < least_px(left_blocks);
    for (const Region& region : regions_)
      if (region.is_marked || is_all)
        for (const std::uint32_t i : region.triangles) is_scattered[i] = 1;
  }

 private:
  struct Region {
    std::vector<std::uint32_t> triangles, blocks;
    double area_px = 0, lengths_px = 0, squares = 0;
    bool is_marked = false;

    bool is_small() const { return squares <= kLongestSide_px * lengths_px; }
  };
  static double least_px(double blocks) { return kLeastShown * blocks * kBlock_px * kBlock_px; }

  std::vector<Region> regions_;
  std::vector<std::uint32_t> readers_;
};

void find_parts(Charts& charts, Chart& chart) {
  for (const std::uint32_t i : chart.triangles) chart.parts.push_back(charts.view_of_triangle[i]);
  std::sort(chart.parts.begin(), chart.parts.end());
  chart.parts.erase(std::unique(chart.parts.begin(), chart.parts.end()), chart.parts.end());
  for (const std::uint32_t i : chart.triangles)
    charts.part_of_triangle[i] = std::uint16_t(
        std::lower_bound(chart.parts.begin(), chart.parts.end(), charts.view_of_triangle[i]) - chart.parts.begin());
}

using BlockCounts = std::array<std::array<std::uint32_t, kBlock_px>, kBlock_px>;

/// Counts windows that show something by where, in blocks, the pixel `beyond_px` behind their last column and row lies.
void count_windows(const Image<std::uint8_t>& shown, int window_px, int beyond_px, BlockCounts& counts) {
  // First along rows, then along columns.
  const int columns = shown.width + window_px - 1, rows = shown.height + window_px - 1;
  Image<std::uint8_t> in_row(columns, shown.height);
  for (int y = 0; y < shown.height; ++y)
    for (int x = 0, last = -window_px; x < columns; ++x) {
      if (x < shown.width && shown.at(x, y)) last = x;
      in_row.at(x, y) = x - last < window_px;
    }
  std::vector<int> last(std::size_t(columns), -window_px);
  for (int y = 0; y < rows; ++y)
    for (int x = 0; x < columns; ++x) {
      int& row = last[std::size_t(x)];
      if (y < shown.height && in_row.at(x, y)) row = y;
      counts[std::size_t((y + beyond_px) % kBlock_px)][std::size_t((x + beyond_px) % kBlock_px)] += y - row < window_px;
    }
}

}  // namespace

std::vector<std::uint8_t> find_scattered(const Charts& charts, const std::vector<std::uint32_t>& root) {
  std::vector<std::uint8_t> is_scattered(charts.chart_of_triangle.size(), 0);
  for (const Chart& chart : charts.charts) ScatterSearch(charts, chart, root).mark(is_scattered);
  return is_scattered;
}

Eigen::Vector2i best_shift(const std::vector<std::uint32_t>& triangles, const std::vector<Corners>& pixels,
                           int squeezed_px) {
  const auto cell = [](float x) { return int(std::floor(x + 0.5f)); };
  Eigen::Vector2f low = pixels[triangles.front()][0], high = low;
  for (const std::uint32_t i : triangles)
    for (const Eigen::Vector2f& q : pixels[i]) low = low.cwiseMin(q), high = high.cwiseMax(q);
  const int x0 = cell(low.x()), y0 = cell(low.y());
  Image<std::uint8_t> shown(cell(high.x()) - x0 + 1, cell(high.y()) - y0 + 1);
  for (const std::uint32_t i : triangles) {
    const Corners& p = pixels[i];
    const Eigen::Vector2f from = p[0].cwiseMin(p[1]).cwiseMin(p[2]), to = p[0].cwiseMax(p[1]).cwiseMax(p[2]);
    for (int y = cell(from.y()); y <= cell(to.y()); ++y)
      for (int x = cell(from.x()); x <= cell(to.x()); ++x)
        if (meets(p, {float(x) - 0.5f, float(y) - 0.5f}, {float(x) + 0.5f, float(y) + 0.5f}))
          shown.at(x - x0, y - y0) = 1;
  }
  BlockCounts counts{};
  // A block is read from where some pixel lies in a square of twice its size.
  for (int less = 0; less <= squeezed_px; ++less) count_windows(shown, 2 * kBlock_px - 2 * less, less, counts);
  Eigen::Vector2i best(0, 0);
  std::uint32_t fewest = 0xffffffff;
  for (int v = 0; v < kBlock_px; ++v)
    for (int u = 0; u < kBlock_px; ++u) {
      const std::uint32_t count = counts[std::size_t(v)][std::size_t(u)];
      if (count >= fewest) continue;
      fewest = count;
      // The window ends half a block after its block does.
      const auto shift = [](int last_px) {
        return ((kHalfBlock_px - 1 - last_px) % kBlock_px + kBlock_px) % kBlock_px;
      };
      best = {shift(x0 + u), shift(y0 + v)};
    }
  return best;
}

void cut_sheets(Layout& layout, int page_blocks, Context& context) {
  std::vector<SheetCutter> sheets;
  for (const std::uint32_t frame : layout.frame) sheets.emplace_back(frame, 1.0f, false, page_blocks);
  for (std::uint32_t i = 0; i < layout.sheet.size(); ++i)
    if (layout.sheet[i] != kInvalidIndex) sheets[layout.sheet[i]].add(i);
  std::vector<std::vector<std::vector<std::uint32_t>>> parts(sheets.size());
  parallel_for(context, sheets.size(), 1, [&](std::size_t s) { parts[s] = sheets[s].parts(layout.pixels); });
  for (std::size_t s = 0; s < parts.size(); ++s)
    for (std::size_t k = 1; k < parts[s].size(); ++k) {  // the first stays
      for (const std::uint32_t i : parts[s][k]) layout.sheet[i] = std::uint32_t(layout.frame.size());
      layout.frame.push_back(layout.frame[s]);
    }
}

Charts make_charts(const Layout& layout, const std::vector<std::uint32_t>& view_of_triangle,
                   std::span<const float> scale_of_triangle, std::span<const std::uint8_t> is_scattered,
                   int page_blocks, Context& context) {
  const std::size_t count = layout.pixels.size();
  Charts out;
  out.view_of_triangle = view_of_triangle;
  out.part_of_triangle.assign(count, 0);
  out.pixels = layout.pixels;
  out.chart_of_triangle.assign(count, kInvalidIndex);
  out.is_resampled = layout.is_resampled;
  std::map<std::tuple<std::uint32_t, float, bool>, SheetCutter> sheets;
  for (std::uint32_t i = 0; i < count; ++i) {
    const std::uint32_t sheet = layout.sheet[i];
    if (sheet == kInvalidIndex) continue;
    const float scale = scale_of_triangle[i];
    for (Eigen::Vector2f& q : out.pixels[i])
      if (scale < 1) q = ((q.array() + 0.5f) * scale - 0.5f).matrix();
    const bool is_apart = !is_scattered.empty() && is_scattered[i];
    sheets.try_emplace({sheet, scale, is_apart}, layout.frame[sheet], scale, is_apart, page_blocks)
        .first->second.add(i);
  }
  std::vector<const SheetCutter*> order;
  for (const auto& [key, sheet] : sheets) order.push_back(&sheet);
  std::vector<std::vector<Chart>> charts(order.size());
  parallel_for(context, order.size(), 1, [&](std::size_t k) { charts[k] = order[k]->cut(out.pixels); });
  for (std::vector<Chart>& some : charts)
    for (Chart& chart : some) out.charts.push_back(std::move(chart));
  std::sort(out.charts.begin(), out.charts.end(),
            [](const Chart& a, const Chart& b) { return a.triangles.front() < b.triangles.front(); });
  for (std::uint32_t c = 0; c < out.charts.size(); ++c) {
    for (const std::uint32_t i : out.charts[c].triangles) out.chart_of_triangle[i] = c;
    find_parts(out, out.charts[c]);
  }
  return out;
}

}  // namespace lapseam
