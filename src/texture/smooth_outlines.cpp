#include "texture/smooth_outlines.h"

#include <algorithm>
#include <cmath>
#include <map>

#include "core/parallel.h"
#include "lapseam/context.h"
#include "texture/charts.h"
#include "texture/stretch.h"

namespace lapseam {
namespace {

// Blocks beyond those of a frame that others can go over to.
constexpr int kMargin = 4;
// More triangles than this read no block at a rim, or the surface is far finer than pixels: not worth the time.
constexpr std::size_t kMostTriangles = 512;
// Surfaces that read one block may be apart by this many pixels: beyond it, they are not beside each other.
constexpr float kNear_px = 4 * kBlock_px;
constexpr float kHair_px = 0.05f;

/// What lies where in a sheet.
struct SheetMap {
  Eigen::Vector2f shift = Eigen::Vector2f::Zero();  // of pixels, such that few blocks are read
  BlockBox box;
  std::vector<std::uint32_t> readers;  // triangles that read each block
  std::vector<std::uint32_t> reader;   // one of them, kInvalidIndex: none
  std::vector<std::uint64_t> shown;    // a bit for each pixel of each block

  std::uint64_t& bits(int x, int y) { return shown[box.index(x >> 3, y >> 3)]; }
  static std::uint64_t bit(int x, int y) { return std::uint64_t(1) << ((y & 7) * 8 + (x & 7)); }
  bool has(int x, int y) { return box.contains(x >> 3, y >> 3) && (bits(x, y) & bit(x, y)) != 0; }
};

class OutlineSmoothing {
 public:
  OutlineSmoothing(const Mesh& mesh, const std::vector<SharedEdge>& edges, const ColorCameras& cameras,
                   const std::vector<std::uint32_t>& view, Layout& layout, Context& context)
      : mesh_(mesh),
        edges_(edges),
        cameras_(cameras),
        view_(view),
        layout_(layout),
        sheet_(layout.sheet),
        pixels_(layout.pixels),
        context_(context),
        edges_of_(edges_of_triangles(mesh, edges)),
        own_(mesh.triangle_count()),
        cost_(mesh.triangle_count(), 0),
        is_slender_(mesh.triangle_count(), 1),
        maps_(layout.frame.size()) {
    parallel_for(context, mesh.triangle_count(), 4096, [&](std::size_t i) {
      if (sheet_[i] != kInvalidIndex) measure(std::uint32_t(i));
    });
    const std::vector<std::vector<std::uint32_t>> triangles = triangles_of_sheets(sheet_, maps_.size());
    parallel_for(context, maps_.size(), 1, [&](std::size_t s) { make_map(maps_[s], triangles[s]); });
  }

  void run() {
    const std::vector<std::vector<std::uint32_t>> triangles = triangles_of_sheets(sheet_, maps_.size());
    for (std::uint32_t s = 0; s < maps_.size(); ++s) {
      context_.throw_if_cancelled();
      if (!triangles[s].empty()) smooth(s, triangles[s]);
    }
    for (std::uint32_t i = 0; i < sheet_.size(); ++i)
      if (sheet_[i] != kInvalidIndex)
        for (Eigen::Vector2f& q : pixels_[i]) q -= maps_[sheet_[i]].shift;
  }

 private:
  void measure(std::uint32_t i) {
    Corners& q = own_[i];
    if (!project_corners(mesh_, i, *cameras_[view_[i]], q)) return;
    const Eigen::Vector2f ab = q[1] - q[0], ac = q[2] - q[0];
    const float twice_px = std::abs(ab.x() * ac.y() - ab.y() * ac.x());
    is_slender_[i] = twice_px < kSlender_px * std::max({ab.norm(), ac.norm(), (ac - ab).norm()});
    // Where a frame was chosen for the whole of a cell.
    if (!is_slender_[i] && !cost_of(i, pixels_[i], cost_[i])) cost_[i] = 0;
  }

  bool cost_of(std::uint32_t i, const Corners& p, float& cost) const {
    Eigen::Matrix2f own, there;
    own << own_[i][1] - own_[i][0], own_[i][2] - own_[i][0];
    there << p[1] - p[0], p[2] - p[0];
    return cost_of_stretch(there * own.inverse(), 0.5f * std::abs(own.determinant()), cost);
  }

  void make_map(SheetMap& map, const std::vector<std::uint32_t>& triangles) {
    if (triangles.empty()) return;
    map.shift = best_shift(triangles, pixels_, 0).cast<float>();
    for (const std::uint32_t i : triangles)
      for (Eigen::Vector2f& q : pixels_[i]) q += map.shift;  // see run
    map.box = box_of(triangles, pixels_);
    map.box.low_u -= kMargin, map.box.low_v -= kMargin, map.box.high_u += kMargin, map.box.high_v += kMargin;
    const std::size_t count = std::size_t(map.box.width()) * std::size_t(map.box.height());
    map.readers.assign(count, 0);
    map.reader.assign(count, kInvalidIndex);
    map.shown.assign(count, 0);
    for (const std::uint32_t i : triangles) add(map, i);
  }

  void add(SheetMap& map, std::uint32_t i) {
    for_blocks(pixels_[i], [&](int u, int v) {
      const std::size_t block = map.box.index(u, v);
      ++map.readers[block];
      std::uint32_t& reader = map.reader[block];
      if (reader == kInvalidIndex || is_slender_[reader]) reader = i;
    });
    if (!is_slender_[i])
      for_pixels(pixels_[i], 0, [&](int x, int y, float, float) { map.bits(x, y) |= SheetMap::bit(x, y); });
  }

  /// Tries the triangles that read a block together, block after block.
  void smooth(std::uint32_t s, const std::vector<std::uint32_t>& triangles) {
    SheetMap& map = maps_[s];
    std::vector<std::pair<std::uint32_t, std::uint32_t>> by_block;
    std::vector<std::uint8_t> is_at_rim(map.readers.size(), 0);
    for (const std::uint32_t i : triangles) {
      bool is_border = false;
      for (const std::uint32_t e : edges_of_[i]) {
        if (e == kNoEdge) continue;
        const std::uint32_t other = sheet_[edges_[e].a == i ? edges_[e].b : edges_[e].a];
        is_border = is_border || (other != s && other != kInvalidIndex);
      }
      if (is_border) for_blocks(pixels_[i], [&](int u, int v) { is_at_rim[map.box.index(u, v)] = 1; });
    }
    for (const std::uint32_t i : triangles)
      for_blocks(pixels_[i], [&](int u, int v) {
        const std::size_t block = map.box.index(u, v);
        if (is_at_rim[block]) by_block.emplace_back(std::uint32_t(block), i);
      });
    std::sort(by_block.begin(), by_block.end());
    std::vector<std::uint32_t> some;
    for (std::size_t first = 0, next = 0; first < by_block.size(); first = next) {
      const std::uint32_t block = by_block[first].first;
      some.clear();
      for (next = first; next < by_block.size() && by_block[next].first == block; ++next)
        if (sheet_[by_block[next].second] == s) some.push_back(by_block[next].second);
      // Some came here since.
      if (some.empty() || some.size() != map.readers[block] || some.size() > kMostTriangles) continue;
      for (const std::uint32_t other : neighbours(s, some))
        if (move(s, other, some)) break;
    }
  }

  /// Sheets beside some triangles, longest border first.
  std::vector<std::uint32_t> neighbours(std::uint32_t s, const std::vector<std::uint32_t>& some) const {
    std::map<std::uint32_t, float> length_m;
    for (const std::uint32_t i : some)
      for (std::size_t k = 0; k < 3; ++k) {
        const std::uint32_t e = edges_of_[i][k];
        if (e == kNoEdge) continue;
        const std::uint32_t other = sheet_[edges_[e].a == i ? edges_[e].b : edges_[e].a];
        if (other == s || other == kInvalidIndex) continue;
        const Triangle& t = mesh_.triangles[i];
        length_m[other] += (mesh_.positions_m[t[k]] - mesh_.positions_m[t[(k + 1) % 3]]).norm();
      }
    std::vector<std::pair<float, std::uint32_t>> order;
    for (const auto& [other, length] : length_m) order.emplace_back(-length, other);
    std::sort(order.begin(), order.end());
    std::vector<std::uint32_t> sheets;
    for (const auto& [length, other] : order) sheets.push_back(other);
    return sheets;
  }

  bool move(std::uint32_t from, std::uint32_t to, const std::vector<std::uint32_t>& some) {
    SheetMap &old_map = maps_[from], &new_map = maps_[to];
    const std::uint32_t frame = layout_.frame[to];
    std::vector<Corners> there(some.size());
    std::vector<std::uint8_t> is_copy(some.size());
    std::vector<float> cost(some.size(), 0);
    float more_px = 0;
    for (std::size_t n = 0; n < some.size(); ++n) {
      const std::uint32_t i = some[n];
      bool is_affine = false;
      if (!project_triangle(mesh_, i, *cameras_[frame], there[n], is_affine)) return false;
      is_copy[n] = is_affine && frame == view_[i];
      for (Eigen::Vector2f& q : there[n]) q += new_map.shift;
      if (!is_slender_[i] && !cost_of(i, there[n], cost[n])) return false;
      more_px += cost[n] - cost_[i];
    }
    int more_blocks = 0;
    if (!has_room(new_map, some, there, more_blocks)) return false;
    // How many blocks nothing reads any more.
    for (const std::uint32_t i : some)
      for_blocks(pixels_[i], [&](int u, int v) { more_blocks -= --old_map.readers[old_map.box.index(u, v)] == 0; });
    const bool is_better = more_px + float(more_blocks * kBlock_px * kBlock_px) < 0;
    if (!is_better) {
      for (const std::uint32_t i : some)
        for_blocks(pixels_[i], [&](int u, int v) { ++old_map.readers[old_map.box.index(u, v)]; });
      return false;
    }
    take_out(old_map, some);
    for (std::size_t n = 0; n < some.size(); ++n) {
      const std::uint32_t i = some[n];
      sheet_[i] = to, pixels_[i] = there[n], cost_[i] = cost[n];
      layout_.is_resampled[i] = !is_copy[n];
      add(new_map, i);
    }
    return true;
  }

  void take_out(SheetMap& map, const std::vector<std::uint32_t>& some) {
    for (const std::uint32_t i : some) {
      for_blocks(pixels_[i], [&](int u, int v) {
        const std::size_t block = map.box.index(u, v);
        if (map.readers[block] == 0) map.reader[block] = kInvalidIndex;
      });
      if (!is_slender_[i])
        for_pixels(pixels_[i], -kHair_px, [&](int x, int y, float, float) { map.bits(x, y) &= ~SheetMap::bit(x, y); });
    }
  }

  /// Whether nothing lies where triangles come to lie, and beside them nothing that is not beside them on the surface.
  /// more_blocks: that nothing read before.
  bool has_room(SheetMap& map, const std::vector<std::uint32_t>& some, const std::vector<Corners>& there,
                int& more_blocks) const {
    std::vector<std::size_t> fresh;
    for (std::size_t n = 0; n < some.size(); ++n) {
      const std::uint32_t i = some[n];
      bool is_free = true;
      for_blocks(there[n], [&](int u, int v) {
        if (!is_free || !map.box.contains(u, v)) {
          is_free = false;
          return;
        }
        const std::size_t block = map.box.index(u, v);
        if (map.readers[block] == 0)
          fresh.push_back(block);
        else if (!is_slender_[i])
          is_free = are_near(i, map.reader[block]);
      });
      if (is_free && !is_slender_[i])
        for_pixels(there[n], -kHair_px, [&](int x, int y, float, float) { is_free = is_free && !map.has(x, y); });
      if (!is_free) return false;
    }
    std::sort(fresh.begin(), fresh.end());
    more_blocks = int(std::unique(fresh.begin(), fresh.end()) - fresh.begin());
    return true;
  }

  Eigen::Vector3f middle_m(std::uint32_t i) const {
    const Triangle& t = mesh_.triangles[i];
    return (mesh_.positions_m[t[0]] + mesh_.positions_m[t[1]] + mesh_.positions_m[t[2]]) / 3;
  }

  bool are_near(std::uint32_t i, std::uint32_t other) const {
    if (other == kInvalidIndex) return true;
    const Triangle& t = mesh_.triangles[i];
    const float side_m = (mesh_.positions_m[t[1]] - mesh_.positions_m[t[0]]).norm();
    const float side_px = (own_[i][1] - own_[i][0]).norm();
    return (middle_m(i) - middle_m(other)).norm() * side_px <= kNear_px * side_m;
  }

  const Mesh& mesh_;
  const std::vector<SharedEdge>& edges_;
  const ColorCameras& cameras_;
  const std::vector<std::uint32_t>& view_;
  Layout& layout_;
  std::vector<std::uint32_t>& sheet_;
  std::vector<Corners>& pixels_;  // shifted meanwhile
  Context& context_;
  const std::vector<std::array<std::uint32_t, 3>> edges_of_;
  std::vector<Corners> own_;  // of each triangle in the image that it shows
  std::vector<float> cost_;   // of where it lies
  std::vector<std::uint8_t> is_slender_;
  std::vector<SheetMap> maps_;
};

}  // namespace

void smooth_outlines(const Mesh& mesh, const std::vector<SharedEdge>& edges, const ColorCameras& cameras,
                     const std::vector<std::uint32_t>& view_of_triangle, Layout& layout, Context& context) {
  OutlineSmoothing(mesh, edges, cameras, view_of_triangle, layout, context).run();
}

}  // namespace lapseam
