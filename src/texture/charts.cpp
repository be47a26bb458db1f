#include "texture/charts.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <tuple>

#include "core/disjoint_sets.h"
#include "core/parallel.h"

namespace lapseam {
namespace {

// Bilinear lookup in mip level 3 reads the blocks of the four nearest block centres: half a block around each point.
constexpr int kHalfBlock_px = kBlock_px / 2;
constexpr float kReach_px = float(kHalfBlock_px) + 0.02f;
constexpr float kAffine_px = 0.25f;
// Blocks left of and above an image that its triangles' surroundings may reach into.
constexpr int kMargin = 2;
// Regions that show less than this share of the blocks that are owned for them can go to vertex colours ...
constexpr double kLeastShown = 0.25;
// ... where the longest sides of their triangles are no longer than this, as a mean over the length of all: what
// colours of vertices show there is as fine as pixels, nearly.
constexpr double kLongestSide_px = 3;

using Corners = std::array<Eigen::Vector2f, 3>;

/// Whether a triangle meets a rectangle: no side of either parts them.
bool meets(const Corners& p, const Eigen::Vector2f& low, const Eigen::Vector2f& high) {
  const Eigen::Vector2f middle = 0.5f * (low + high), half = 0.5f * (high - low);
  for (std::size_t k = 0; k < 3; ++k) {
    const Eigen::Vector2f side = p[(k + 1) % 3] - p[k];
    const Eigen::Vector2f normal(-side.y(), side.x());
    const float radius = std::abs(normal.x()) * half.x() + std::abs(normal.y()) * half.y();
    const float a = normal.dot(p[k] - middle), b = normal.dot(p[(k + 2) % 3] - middle);
    if (std::min(a, b) > radius || std::max(a, b) < -radius) return false;
  }
  return true;
}

/// Visits the blocks that lookups in a triangle read. Pixel x lies in block floor((x + ½) / size) of the page.
template <typename Visit>
void for_blocks(const Corners& p, const Visit& visit) {
  const Eigen::Vector2f low = p[0].cwiseMin(p[1]).cwiseMin(p[2]), high = p[0].cwiseMax(p[1]).cwiseMax(p[2]);
  const auto block = [](float x) { return int(std::floor((x + 0.5f) / float(kBlock_px))); };
  for (int v = block(low.y() - kReach_px); v <= block(high.y() + kReach_px); ++v)
    for (int u = block(low.x() - kReach_px); u <= block(high.x() + kReach_px); ++u) {
      const Eigen::Vector2f from(float(u * kBlock_px) - 0.5f - kReach_px, float(v * kBlock_px) - 0.5f - kReach_px);
      const Eigen::Vector2f to = from.array() + float(kBlock_px) + 2 * kReach_px;
      if (meets(p, from, to)) visit(u, v);
    }
}

/// Corners in the image, brought to one side of a panorama's seam. Whether they tell where the rest is.
bool project_triangle(const std::array<Eigen::Vector3f, 3>& corners_m, const ColorCamera& camera, Corners& p,
                      bool& is_affine) {
  for (std::size_t k = 0; k < 3; ++k)
    if (!camera.project_beyond(corners_m[k], p[k])) return false;
  if (camera.wraps()) unwrap(p, camera.width());
  is_affine = true;
  for (std::size_t k = 0; k < 3; ++k) {
    Eigen::Vector2f middle;
    const std::size_t next = (k + 1) % 3;
    if (!camera.project_beyond(0.5f * (corners_m[k] + corners_m[next]), middle)) return false;
    Eigen::Vector2f off = middle - 0.5f * (p[k] + p[next]);
    if (camera.wraps()) off.x() -= float(camera.width()) * std::round(off.x() / float(camera.width()));
    is_affine = is_affine && off.norm() <= kAffine_px;
  }
  return true;
}

/// The triangles of one view at one scale, and the grid of their blocks.
class Sheet {
 public:
  Sheet(std::uint32_t view, float scale, bool is_scattered, const ColorCamera& camera, int page_blocks)
      : view_(view),
        scale_(scale),
        is_scattered_(is_scattered),
        page_blocks_(page_blocks),
        margin_x_(kMargin + blocks(camera.margin_x())),
        margin_y_(kMargin + blocks(camera.margin_y())),
        columns_((camera.wraps() ? 2 : 1) * blocks(camera.width()) + 2 * margin_x_),
        rows_(blocks(camera.height()) + 2 * margin_y_) {}

  void add(std::uint32_t triangle) { triangles_.push_back(triangle); }

  /// Cuts into charts; their triangles' pixels change from the scaled image's to the chart's.
  std::vector<Chart> cut(std::vector<Corners>& pixels) const {
    const std::size_t count = std::size_t(columns_) * std::size_t(rows_);
    DisjointSets sets(count);
    for (const std::uint32_t i : triangles_) {
      std::uint32_t first = kInvalidIndex;
      for_blocks(pixels[i], [&](int u, int v) {
        const std::uint32_t block = index(u, v);
        if (first == kInvalidIndex) first = block;
        sets.unite(first, block);
      });
    }
    std::vector<std::array<int, 4>> box(count, {columns_, rows_, -1, -1});
    for (const std::uint32_t i : triangles_) extend(box[root_of(pixels[i], sets)], pixels[i]);
    // By component, and by tiles of half a page for those that are larger than one.
    std::map<std::tuple<std::uint32_t, int, int>, std::vector<std::uint32_t>> pieces;
    for (const std::uint32_t i : triangles_) {
      const std::uint32_t root = root_of(pixels[i], sets);
      const auto& b = box[root];
      const bool is_large = b[2] - b[0] >= page_blocks_ || b[3] - b[1] >= page_blocks_;
      const Eigen::Vector2f middle = (pixels[i][0] + pixels[i][1] + pixels[i][2]) / 3;
      const float tile_px = 0.5f * float(page_blocks_ * kBlock_px);
      const auto tile = [&](float x, int from) { return is_large ? int((x - float(from * kBlock_px)) / tile_px) : 0; };
      pieces[{root, tile(middle.x(), b[0] - margin_x_), tile(middle.y(), b[1] - margin_y_)}].push_back(i);
    }
    std::vector<Chart> charts;
    for (auto& [key, triangles] : pieces) split(std::move(triangles), pixels, charts);
    return charts;
  }

 private:
  int blocks(int size_px) const { return int(std::ceil(float(size_px) * scale_ / float(kBlock_px))); }
  std::uint32_t index(int u, int v) const {
    u = std::clamp(u + margin_x_, 0, columns_ - 1);
    v = std::clamp(v + margin_y_, 0, rows_ - 1);
    return std::uint32_t(v) * std::uint32_t(columns_) + std::uint32_t(u);
  }

  std::uint32_t root_of(const Corners& p, DisjointSets& sets) const {
    std::uint32_t root = kInvalidIndex;
    for_blocks(p, [&](int u, int v) {
      if (root == kInvalidIndex) root = sets.find(index(u, v));
    });
    return root;
  }

  void extend(std::array<int, 4>& box, const Corners& p) const {
    for_blocks(p, [&](int u, int v) {
      box = {std::min(box[0], u + margin_x_), std::min(box[1], v + margin_y_), std::max(box[2], u + margin_x_),
             std::max(box[3], v + margin_y_)};
    });
  }

  /// Cuts a chart in two, and its parts again, where their boxes are much smaller together: a chart like a frame leaves
  /// holes that not enough small ones are there to fill.
  void split(std::vector<std::uint32_t> triangles, std::vector<Corners>& pixels, std::vector<Chart>& charts) const {
    Chart whole = make_chart(triangles, pixels);
    const BlockShape& shape = whole.shape;
    const Cut cut = find_cut(shape);
    std::vector<std::uint32_t> low, high;
    for (const std::uint32_t i : triangles) {
      if (!cut.is_worth_it) break;
      const Eigen::Vector2f middle = (pixels[i][0] + pixels[i][1] + pixels[i][2]) / 3 - corner_of(whole);
      (middle[cut.axis] < float(cut.at * kBlock_px) ? low : high).push_back(i);
    }
    if (low.empty() || high.empty()) return charts.push_back(align(std::move(whole), pixels));
    split(std::move(low), pixels, charts);
    split(std::move(high), pixels, charts);
  }

  /// Moves a chart to where it owns the fewest blocks, and its triangles' pixels into it.
  Chart align(Chart chart, std::vector<Corners>& pixels) const {
    const auto move = [&](const Eigen::Vector2i& by) {
      for (const std::uint32_t i : chart.triangles)
        for (Eigen::Vector2f& q : pixels[i]) q += by.cast<float>();
    };
    const Eigen::Vector2i shift = best_shift(chart.triangles, pixels);
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

  /// Of the 8 × 8 ways in which a grid of blocks may lie over triangles, the one where the fewest blocks are read:
  /// those that have some pixel of them in a square of twice their size.
  static Eigen::Vector2i best_shift(const std::vector<std::uint32_t>& triangles, const std::vector<Corners>& pixels) {
    const auto cell = [](float x) { return int(std::floor(x + 0.5f)); };
    Eigen::Vector2f low = pixels[triangles.front()][0], high = low;
    for (const std::uint32_t i : triangles)
      for (const Eigen::Vector2f& q : pixels[i]) low = low.cwiseMin(q), high = high.cwiseMax(q);
    constexpr int kWindow = 2 * kBlock_px;
    const int x0 = cell(low.x()), y0 = cell(low.y());
    const int width = cell(high.x()) - x0 + 1, height = cell(high.y()) - y0 + 1;
    Image<std::uint8_t> shown(width, height);
    for (const std::uint32_t i : triangles) {
      const Corners& p = pixels[i];
      const Eigen::Vector2f from = p[0].cwiseMin(p[1]).cwiseMin(p[2]), to = p[0].cwiseMax(p[1]).cwiseMax(p[2]);
      for (int y = cell(from.y()); y <= cell(to.y()); ++y)
        for (int x = cell(from.x()); x <= cell(to.x()); ++x)
          if (meets(p, {float(x) - 0.5f, float(y) - 0.5f}, {float(x) + 0.5f, float(y) + 0.5f}))
            shown.at(x - x0, y - y0) = 1;
    }
    // Of each window by its last column and row: whether it shows something; first along rows, then along columns.
    const int columns = width + kWindow - 1, rows = height + kWindow - 1;
    Image<std::uint8_t> in_row(columns, height);
    for (int y = 0; y < height; ++y)
      for (int x = 0, last = -kWindow; x < columns; ++x) {
        if (x < width && shown.at(x, y)) last = x;
        in_row.at(x, y) = x - last < kWindow;
      }
    std::array<std::array<std::uint32_t, kBlock_px>, kBlock_px> blocks{};
    std::vector<int> last(std::size_t(columns), -kWindow);
    for (int y = 0; y < rows; ++y)
      for (int x = 0; x < columns; ++x) {
        int& row = last[std::size_t(x)];
        if (y < height && in_row.at(x, y)) row = y;
        blocks[std::size_t(y % kBlock_px)][std::size_t(x % kBlock_px)] += y - row < kWindow;
      }
    Eigen::Vector2i best(0, 0);
    std::uint32_t fewest = 0xffffffff;
    for (int v = 0; v < kBlock_px; ++v)
      for (int u = 0; u < kBlock_px; ++u) {
        const std::uint32_t count = blocks[std::size_t(v)][std::size_t(u)];
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

  struct Cut {
    bool is_worth_it = false;
    int axis = 0, at = 0;
  };

  static Cut find_cut(const BlockShape& shape) {
    constexpr int kSmallestPart = 4;
    constexpr double kWorthIt = 0.85;
    Cut best;
    double smallest = kWorthIt * double(shape.width) * double(shape.height);
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
        const double area =
            box_area(lines, 0, at) + box_area(lines, at, length) + 2 * double(lines[std::size_t(at)][0]);
        if (area < smallest) smallest = area, best = {true, axis, at};
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
    std::array<int, 4> box = {columns_, rows_, -1, -1};
    for (const std::uint32_t i : triangles) extend(box, pixels[i]);
    Chart chart;
    chart.view = view_;
    chart.scale = scale_;
    chart.is_scattered = is_scattered_;
    const int u0 = box[0] - margin_x_, v0 = box[1] - margin_y_;
    chart.corner_px = {u0 * kBlock_px, v0 * kBlock_px};
    chart.shape.width = box[2] - box[0] + 1;
    chart.shape.height = box[3] - box[1] + 1;
    chart.shape.used.assign(std::size_t(chart.shape.width) * std::size_t(chart.shape.height), 0);
    for (const std::uint32_t i : triangles)
      for_blocks(pixels[i], [&](int u, int v) {
        chart.shape.used[std::size_t(v - v0) * std::size_t(chart.shape.width) + std::size_t(u - u0)] = 1;
      });
    chart.triangles = std::move(triangles);
    return chart;
  }

  std::uint32_t view_;
  float scale_;
  bool is_scattered_;
  int page_blocks_;
  int margin_x_, margin_y_;  // blocks left of and above the image
  int columns_, rows_;
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
      for_blocks(p, [&](int u, int v) { region.blocks.push_back(std::uint32_t(v * chart.shape.width + u)); });
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

}  // namespace

std::vector<std::uint8_t> find_scattered(const Charts& charts, const std::vector<std::uint32_t>& root) {
  std::vector<std::uint8_t> is_scattered(charts.chart_of_triangle.size(), 0);
  for (const Chart& chart : charts.charts) ScatterSearch(charts, chart, root).mark(is_scattered);
  return is_scattered;
}

Charts make_charts(const Mesh& mesh, const ColorCameras& cameras, const std::vector<std::uint32_t>& view_of_triangle,
                   std::span<const std::uint32_t> frame_of_triangle, std::span<const float> scale_of_triangle,
                   std::span<const std::uint8_t> is_scattered, int page_blocks, Context& context) {
  Charts out;
  out.view_of_triangle = view_of_triangle;
  out.part_of_triangle.assign(mesh.triangle_count(), 0);
  out.pixels.resize(mesh.triangle_count());
  out.chart_of_triangle.assign(mesh.triangle_count(), kInvalidIndex);
  out.is_resampled.assign(mesh.triangle_count(), 0);
  std::vector<std::uint8_t> is_seen(mesh.triangle_count(), 0);
  parallel_for(context, mesh.triangle_count(), 16384, [&](std::size_t i) {
    if (frame_of_triangle[i] == kInvalidIndex) return;
    const Triangle& t = mesh.triangles[i];
    bool is_affine = false;
    Corners& p = out.pixels[i];
    is_seen[i] = project_triangle({mesh.positions_m[t[0]], mesh.positions_m[t[1]], mesh.positions_m[t[2]]},
                                  *cameras[frame_of_triangle[i]], p, is_affine);
    out.is_resampled[i] = !is_affine || frame_of_triangle[i] != view_of_triangle[i];
    for (Eigen::Vector2f& q : p) q = ((q.array() + 0.5f) * scale_of_triangle[i] - 0.5f).matrix();
  });
  std::map<std::tuple<std::uint32_t, float, bool>, Sheet> sheets;
  for (std::uint32_t i = 0; i < mesh.triangle_count(); ++i)
    if (is_seen[i]) {
      const std::uint32_t view = frame_of_triangle[i];
      const float scale = scale_of_triangle[i];
      const bool is_apart = !is_scattered.empty() && is_scattered[i];
      sheets.try_emplace({view, scale, is_apart}, view, scale, is_apart, *cameras[view], page_blocks)
          .first->second.add(i);
    }
  std::vector<const Sheet*> order;
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
