#include "texture/squeeze_outlines.h"

#include <algorithm>
#include <cmath>
#include <tuple>

#include "core/parallel.h"
#include "lapseam/context.h"
#include "texture/charts.h"
#include "texture/stretch.h"

namespace lapseam {
namespace {

constexpr int kPasses = 2;
// How far an outline is pushed at most: eight pixels along a whole block are as many as it has, and some are pressed
// together to both sides too.
constexpr float kDeepest_px = 5;
// What lies behind is pressed together over this many pixels, and to both sides of a block the push fades out.
constexpr float kBand_px = 12, kFade_px = 8;
// Blocks in a row that are tried together: a long straight outline has two ends to fade at, not two for each block.
constexpr int kLongestRow = 8;
constexpr float kBlockPrice_px = float(kBlock_px * kBlock_px);
constexpr float kHair_px = 0.05f;

struct Bounds {
  Eigen::Vector2f low = Eigen::Vector2f::Constant(3e38f), high = Eigen::Vector2f::Constant(-3e38f);

  bool is_empty() const { return !(low.x() <= high.x()); }
  void extend(const Eigen::Vector2f& p) { low = low.cwiseMin(p), high = high.cwiseMax(p); }
};

/// Adds what of a triangle lies in a rectangle.
void extend_by_clipped(const Corners& p, const Bounds& rectangle, Bounds& bounds) {
  std::array<Eigen::Vector2f, 8> polygon, clipped;
  std::size_t count = 3;
  std::copy(p.begin(), p.end(), polygon.begin());
  for (const int axis : {0, 1})
    for (const int side : {0, 1}) {
      const float at = side ? rectangle.high[axis] : rectangle.low[axis];
      const auto inside = [&](const Eigen::Vector2f& q) { return side ? at - q[axis] : q[axis] - at; };
      std::size_t kept = 0;
      for (std::size_t k = 0; k < count; ++k) {
        const Eigen::Vector2f &a = polygon[k], &b = polygon[(k + 1) % count];
        const float from = inside(a), to = inside(b);
        if (from >= 0) clipped[kept++] = a;
        if ((from >= 0) != (to >= 0)) {
          clipped[kept] = a + (b - a) * (from / (from - to));
          clipped[kept++][axis] = at;
        }
      }
      std::copy_n(clipped.begin(), kept, polygon.begin());
      count = kept;
    }
  for (std::size_t k = 0; k < count; ++k) bounds.extend(polygon[k]);
}

/// Points whose lookups read a block.
Bounds readers_of(int u, int v) {
  constexpr float kHairs_px = 1.0f / 64;  // more than coordinates are rounded by
  Bounds square;
  square.low = Eigen::Vector2f(float(u * kBlock_px), float(v * kBlock_px)).array() - 0.5f - kReach_px - kHairs_px;
  square.high = square.low.array() + float(kBlock_px) + 2 * (kReach_px + kHairs_px);
  return square;
}

/// Moves what lies within `depth` of the side of a square that it is pushed out over, and presses together what lies
/// behind.
struct Push {
  int axis;         // along which
  float sign;       // and which way
  float start;      // where the outline is, times sign
  float depth;      // how far it goes
  float from, to;   // across: all of the push; fading beyond
  float behind_px;  // it begins so far before the outline: there is nothing

  Eigen::Vector2f operator()(const Eigen::Vector2f& p) const {
    const float along = sign * p[axis] - start, across = p[1 - axis];
    const float off = std::max({from - across, across - to, 0.0f});
    if (off >= kFade_px) return p;
    const float strength = along < 0 ? 1 + along / behind_px : 1 - along / (depth + kBand_px);
    if (strength <= 0) return p;
    Eigen::Vector2f moved = p;
    moved[axis] += sign * depth * strength * (1 - off / kFade_px);
    return snap(moved);
  }
  Bounds reach() const {
    Bounds box;
    const float a = sign * (start - behind_px), b = sign * (start + depth + kBand_px);
    box.low[axis] = std::min(a, b), box.high[axis] = std::max(a, b);
    box.low[1 - axis] = from - kFade_px, box.high[1 - axis] = to + kFade_px;
    return box;
  }
};

class SheetSqueeze {
 public:
  SheetSqueeze(const Mesh& mesh, const ColorCameras& cameras, const std::vector<std::uint32_t>& view,
               const std::vector<std::uint32_t>& triangles, const Layout& layout)
      : ids_(triangles), shift_(best_shift(triangles, layout.pixels, int(kDeepest_px)).cast<float>()) {
    find_vertices(mesh, layout);
    for (std::uint32_t n = 0; n < ids_.size(); ++n) measure(mesh, *cameras[view[ids_[n]]], n);
    find_box();
    readers_.resize(std::size_t(box_.width()) * std::size_t(box_.height()));
    shown_ = Image<std::uint16_t>(box_.width() * kBlock_px, box_.height() * kBlock_px);
    for (std::uint32_t n = 0; n < ids_.size(); ++n) put(n);
    is_touched_.assign(ids_.size(), 0);
    is_reached_.assign(at_.size(), 0);
  }

  void run() {
    for (int pass = 0; pass < kPasses; ++pass) {
      const std::size_t before = freed_;
      for (const auto& [depth, block] : rim()) squeeze(block);
      if (freed_ == before) break;
    }
  }

  void get(Layout& layout) const {
    for (std::uint32_t n = 0; n < ids_.size(); ++n) {
      Corners& p = layout.pixels[ids_[n]];
      for (std::size_t k = 0; k < 3; ++k) {
        const Eigen::Vector2f q = at_[corners_[n][k]] - shift_;
        if (q == p[k]) continue;
        p[k] = q;
        layout.is_resampled[ids_[n]] = 1;
      }
    }
  }

 private:
  using Moves = std::vector<std::pair<std::uint32_t, Eigen::Vector2f>>;

  /// A vertex has a place for each side of a panorama's seam.
  void find_vertices(const Mesh& mesh, const Layout& layout) {
    std::vector<std::tuple<std::uint32_t, float, float, std::uint32_t>> all;
    for (std::uint32_t n = 0; n < ids_.size(); ++n)
      for (std::uint32_t k = 0; k < 3; ++k) {
        const Eigen::Vector2f& p = layout.pixels[ids_[n]][k];
        all.emplace_back(mesh.triangles[ids_[n]][k], p.x(), p.y(), 3 * n + k);
      }
    std::sort(all.begin(), all.end());
    corners_.resize(ids_.size());
    for (std::size_t m = 0; m < all.size(); ++m) {
      const auto [vertex, x, y, corner] = all[m];
      if (m == 0 || std::tie(vertex, x, y) !=
                        std::tie(std::get<0>(all[m - 1]), std::get<1>(all[m - 1]), std::get<2>(all[m - 1]))) {
        at_.push_back(Eigen::Vector2f(x, y) + shift_);
        first_.push_back(std::uint32_t(m));
      }
      corners_[corner / 3][corner % 3] = std::uint32_t(at_.size() - 1);
      triangles_of_vertices_.push_back(corner / 3);
    }
    first_.push_back(std::uint32_t(all.size()));
  }

  Corners corners_of(std::uint32_t n) const { return {at_[corners_[n][0]], at_[corners_[n][1]], at_[corners_[n][2]]}; }

  void measure(const Mesh& mesh, const ColorCamera& camera, std::uint32_t n) {
    Stretch stretch;
    Corners own;
    if (project_corners(mesh, ids_[n], camera, own) && !is_slender(own)) {
      Eigen::Matrix2f sides;
      sides << own[1] - own[0], own[2] - own[0];
      stretch.from_own = sides.inverse();
      stretch.area_px = 0.5f * std::abs(sides.determinant());
      stretch.is_judged = true;
    }
    stretch_.push_back(stretch);
    // Where a frame was chosen for the whole of a cell, it may be beyond the limits.
    if (!cost_of(n, stretch_.back().cost)) stretch_.back().cost = 0;
  }

  bool cost_of(std::uint32_t n, float& cost) const {
    const Stretch& stretch = stretch_[n];
    cost = 0;
    if (!stretch.is_judged) return true;
    const Corners p = corners_of(n);
    Eigen::Matrix2f sides;
    sides << p[1] - p[0], p[2] - p[0];
    return cost_of_stretch(sides * stretch.from_own, stretch.area_px, cost);
  }

  void find_box() {
    for (std::uint32_t n = 0; n < ids_.size(); ++n) box_.extend(corners_of(n));
    --box_.low_u, --box_.low_v, ++box_.high_u, ++box_.high_v;
  }

  /// False where it goes beyond the box.
  bool put(std::uint32_t n) {
    const Corners p = corners_of(n);
    bool is_within = true;
    for_blocks(p, [&](int u, int v) {
      if (!box_.contains(u, v)) {
        is_within = false;
        return;
      }
      std::vector<std::uint32_t>& readers = readers_[box_.index(u, v)];
      owned_ += readers.empty();
      readers.push_back(n);
    });
    for_shown(n, p, [&](std::uint16_t& count) { overlaps_ += count++ > 0; });
    return is_within;
  }

  void take(std::uint32_t n) {
    const Corners p = corners_of(n);
    for_blocks(p, [&](int u, int v) {
      if (!box_.contains(u, v)) return;
      std::vector<std::uint32_t>& readers = readers_[box_.index(u, v)];
      const auto found = std::find(readers.begin(), readers.end(), n);
      *found = readers.back();
      readers.pop_back();
      owned_ -= readers.empty();
    });
    for_shown(n, p, [&](std::uint16_t& count) { overlaps_ -= --count > 0; });
  }

  template <typename Visit>
  void for_shown(std::uint32_t n, const Corners& p, const Visit& visit) {
    if (!stretch_[n].is_judged) return;
    for_pixels(p, -kHair_px, [&](int x, int y, float, float) {
      const int u = x - box_.low_u * kBlock_px, v = y - box_.low_v * kBlock_px;
      if (u >= 0 && v >= 0 && u < shown_.width && v < shown_.height) visit(shown_.at(u, v));
    });
  }

  bool is_read(int u, int v) const { return box_.contains(u, v) && !readers_[box_.index(u, v)].empty(); }

  /// Ways out of a block for what reads it, the shortest first.
  std::vector<Push> ways_out(int u, int v) const {
    const Bounds square = readers_of(u, v);
    Bounds within;
    for (const std::uint32_t n : readers_[box_.index(u, v)]) extend_by_clipped(corners_of(n), square, within);
    std::vector<Push> ways;
    if (within.is_empty()) return ways;
    for (const int axis : {0, 1})
      for (const float sign : {1.0f, -1.0f}) {
        const float start = sign > 0 ? within.low[axis] : -within.high[axis];
        const float edge = sign > 0 ? square.high[axis] : -square.low[axis];
        const float begin = sign > 0 ? square.low[axis] : -square.high[axis];
        const float depth = edge - start;
        if (depth > kDeepest_px) continue;
        ways.push_back({axis, sign, start, depth, within.low[1 - axis], within.high[1 - axis], start - begin});
      }
    std::stable_sort(ways.begin(), ways.end(), [](const Push& a, const Push& b) { return a.depth < b.depth; });
    return ways;
  }

  /// Blocks that may be freed, by depth.
  std::vector<std::pair<float, std::pair<int, int>>> rim() const {
    std::vector<std::pair<float, std::pair<int, int>>> blocks;
    for (int v = box_.low_v; v <= box_.high_v; ++v)
      for (int u = box_.low_u; u <= box_.high_u; ++u) {
        if (!is_read(u, v)) continue;
        if (is_read(u - 1, v) && is_read(u + 1, v) && is_read(u, v - 1) && is_read(u, v + 1)) continue;
        const std::vector<Push> ways = ways_out(u, v);
        if (!ways.empty()) blocks.emplace_back(ways.front().depth, std::pair(u, v));
      }
    std::sort(blocks.begin(), blocks.end());
    return blocks;
  }

  void squeeze(const std::pair<int, int>& block) {
    if (!is_read(block.first, block.second)) return;
    for (const Push& way : ways_out(block.first, block.second))
      if (push_row(block, way)) return;
  }

  /// A block, then those beside it, until they are worth it together.
  bool push_row(const std::pair<int, int>& block, const Push& way) {
    std::vector<Moves> undo;
    float change_px = 0;
    const std::size_t owned_before = owned_;
    for (int k = 0; k < kLongestRow; ++k) {
      const int u = block.first + (way.axis == 1 ? k : 0), v = block.second + (way.axis == 0 ? k : 0);
      if (!is_read(u, v)) break;
      const std::vector<Push> ways = ways_out(u, v);
      const auto same = std::find_if(ways.begin(), ways.end(),
                                     [&](const Push& w) { return w.axis == way.axis && w.sign == way.sign; });
      if (same == ways.end()) break;
      undo.push_back(moves_of(*same));
      if (!move(undo.back(), change_px)) break;
      if (change_px < 0) {
        freed_ += owned_before - owned_;
        return true;
      }
    }
    float ignored_px = 0;
    for (; !undo.empty(); undo.pop_back()) move(undo.back(), ignored_px);
    return false;
  }

  Moves moves_of(const Push& push) {
    const Bounds reach = push.reach();
    Moves moves;
    for (int v = std::max(box_.low_v, block_of(reach.low.y())); v <= std::min(box_.high_v, block_of(reach.high.y()));
         ++v)
      for (int u = std::max(box_.low_u, block_of(reach.low.x())); u <= std::min(box_.high_u, block_of(reach.high.x()));
           ++u)
        for (const std::uint32_t n : readers_[box_.index(u, v)])
          for (const std::uint32_t vertex : corners_[n]) {
            if (is_reached_[vertex]) continue;
            is_reached_[vertex] = 1;
            reached_.push_back(vertex);
            const Eigen::Vector2f moved = push(at_[vertex]);
            if (moved != at_[vertex]) moves.emplace_back(vertex, moved);
          }
    for (const std::uint32_t vertex : reached_) is_reached_[vertex] = 0;
    reached_.clear();
    return moves;
  }

  /// Moves vertices, and puts where they were in `moves`. False where it must not stay so; change_px is added to.
  bool move(Moves& moves, float& change_px) {
    std::vector<std::uint32_t> touched;
    for (const auto& [vertex, to] : moves)
      for (std::uint32_t m = first_[vertex]; m < first_[vertex + 1]; ++m) {
        const std::uint32_t n = triangles_of_vertices_[m];
        if (is_touched_[n]) continue;
        is_touched_[n] = 1;
        touched.push_back(n);
      }
    const std::size_t owned_before = owned_, overlaps_before = overlaps_;
    for (const std::uint32_t n : touched) take(n), is_touched_[n] = 0;
    for (auto& [vertex, to] : moves) std::swap(at_[vertex], to);
    bool is_allowed = true;
    for (const std::uint32_t n : touched) {
      float cost = 0;
      is_allowed = cost_of(n, cost) && is_allowed;
      change_px += cost - stretch_[n].cost;
      stretch_[n].cost = cost;
      is_allowed = put(n) && is_allowed;
    }
    change_px += kBlockPrice_px * (float(owned_) - float(owned_before));
    return is_allowed && overlaps_ <= overlaps_before;
  }

  struct Stretch {
    Eigen::Matrix2f from_own = Eigen::Matrix2f::Zero();  // of sides in the image to ones along the axes
    float area_px = 0, cost = 0;
    bool is_judged = false;  // no sliver
  };

  const std::vector<std::uint32_t>& ids_;
  const Eigen::Vector2f shift_;
  std::vector<Eigen::Vector2f> at_;  // of each vertex
  std::vector<std::array<std::uint32_t, 3>> corners_;
  std::vector<std::uint32_t> first_, triangles_of_vertices_;
  std::vector<Stretch> stretch_;
  BlockBox box_;
  std::vector<std::vector<std::uint32_t>> readers_;  // of each block
  Image<std::uint16_t> shown_;                       // triangles that show each pixel
  std::size_t owned_ = 0, overlaps_ = 0, freed_ = 0;
  std::vector<std::uint8_t> is_touched_, is_reached_;
  std::vector<std::uint32_t> reached_;
};

}  // namespace

void squeeze_outlines(const Mesh& mesh, const ColorCameras& cameras, const std::vector<std::uint32_t>& view_of_triangle,
                      Layout& layout, Context& context) {
  const std::vector<std::vector<std::uint32_t>> triangles = triangles_of_sheets(layout.sheet, layout.frame.size());
  parallel_for(context, triangles.size(), 1, [&](std::size_t s) {
    if (triangles[s].empty()) return;
    context.throw_if_cancelled();
    SheetSqueeze sheet(mesh, cameras, view_of_triangle, triangles[s], layout);
    sheet.run();
    sheet.get(layout);
  });
}

}  // namespace lapseam
