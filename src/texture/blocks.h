#pragma once

// Triangles laid out on a grid of pixels and of the blocks that charts own.

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cmath>
#include <span>
#include <vector>

namespace lapseam {

/// Charts own whole blocks of the page. A texel of mip level 3 is the mean of a block, and a JPEG image is coded by
/// blocks: neither mixes charts.
inline constexpr int kBlock_px = 8;
// Bilinear lookup in mip level 3 reads the blocks of the four nearest block centres: half a block around each point.
inline constexpr int kHalfBlock_px = kBlock_px / 2;
inline constexpr float kReach_px = float(kHalfBlock_px) + 0.02f;

using Corners = std::array<Eigen::Vector2f, 3>;

/// To 1/256 of a pixel: so that moves by whole pixels change no last digit, and what reads a block in a sheet reads it
/// in a chart.
inline Eigen::Vector2f snap(const Eigen::Vector2f& p) { return (p * 256).array().round() / 256; }

/// Whether a triangle meets a rectangle: no side of either parts them.
bool meets(const Corners& p, const Eigen::Vector2f& low, const Eigen::Vector2f& high);

/// Block of a pixel: pixel x lies in block floor((x + ½) / size).
inline int block_of(float x) { return int(std::floor((x + 0.5f) / float(kBlock_px))); }

/// Visits the blocks that lookups in a triangle read.
template <typename Visit>
void for_blocks(const Corners& p, const Visit& visit) {
  const Eigen::Vector2f low = p[0].cwiseMin(p[1]).cwiseMin(p[2]), high = p[0].cwiseMax(p[1]).cwiseMax(p[2]);
  for (int v = block_of(low.y() - kReach_px); v <= block_of(high.y() + kReach_px); ++v)
    for (int u = block_of(low.x() - kReach_px); u <= block_of(high.x() + kReach_px); ++u) {
      const Eigen::Vector2f from(float(u * kBlock_px) - 0.5f - kReach_px, float(v * kBlock_px) - 0.5f - kReach_px);
      const Eigen::Vector2f to = from.array() + float(kBlock_px) + 2 * kReach_px;
      if (meets(p, from, to)) visit(u, v);
    }
}

/// A rectangle of blocks.
struct BlockBox {
  int low_u = 1 << 30, low_v = 1 << 30, high_u = -(1 << 30), high_v = -(1 << 30);  // both ends within

  bool is_empty() const { return high_u < low_u; }
  int width() const { return high_u - low_u + 1; }
  int height() const { return high_v - low_v + 1; }
  std::size_t index(int u, int v) const {
    return std::size_t(v - low_v) * std::size_t(width()) + std::size_t(u - low_u);
  }
  bool contains(int u, int v) const { return u >= low_u && u <= high_u && v >= low_v && v <= high_v; }
  void extend(const BlockBox& other) {
    low_u = std::min(low_u, other.low_u), low_v = std::min(low_v, other.low_v);
    high_u = std::max(high_u, other.high_u), high_v = std::max(high_v, other.high_v);
  }
  /// By the blocks that a triangle reads.
  void extend(const Corners& p);
};

/// Those of some triangles.
BlockBox box_of(std::span<const std::uint32_t> triangles, const std::vector<Corners>& pixels);

/// Of each of some triangles a label that it shares with those whose blocks meet.
std::vector<std::uint32_t> connect_by_blocks(std::span<const std::uint32_t> triangles,
                                             const std::vector<Corners>& pixels);

/// Visits the pixels whose centres lie in a triangle, widened by `margin_px`: visit(x, y, b1, b2) with the weights of
/// the second and third corner.
template <typename Visit>
void for_pixels(const Corners& p, float margin_px, const Visit& visit) {
  const Eigen::Vector2f ab = p[1] - p[0], ac = p[2] - p[0];
  const float area = ab.x() * ac.y() - ab.y() * ac.x();
  if (area == 0) return;
  const Eigen::Vector2f low = p[0].cwiseMin(p[1]).cwiseMin(p[2]), high = p[0].cwiseMax(p[1]).cwiseMax(p[2]);
  // A weight falls from 1 to 0 over the height above its side.
  const float scale = margin_px / std::abs(area);
  const float m0 = scale * (ac - ab).norm(), m1 = scale * ac.norm(), m2 = scale * ab.norm();
  for (int y = int(std::ceil(low.y() - margin_px)); float(y) <= high.y() + margin_px; ++y)
    for (int x = int(std::ceil(low.x() - margin_px)); float(x) <= high.x() + margin_px; ++x) {
      const Eigen::Vector2f ap(float(x) - p[0].x(), float(y) - p[0].y());
      const float b1 = (ap.x() * ac.y() - ap.y() * ac.x()) / area, b2 = (ab.x() * ap.y() - ab.y() * ap.x()) / area;
      if (b1 >= -m1 && b2 >= -m2 && 1 - b1 - b2 >= -m0) visit(x, y, b1, b2);
    }
}

}  // namespace lapseam
