#pragma once

// What it costs to lay surface out otherwise than the image that it shows.

#include <Eigen/Core>
#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>

namespace lapseam {

/// Pixels of a page that a pixel of border between charts costs: padding for mip level 3, and for whole blocks, on
/// either side, six to eight pixels each; and what packing leaves free, which lies along outlines too.
inline constexpr float kPadding = 60;
/// Triangles so thin show little of any image: slivers, whose normals are noise. They may face away, lie over their
/// neighbours and be of any size.
inline constexpr float kSlender_px = 1.5f;

inline bool is_slender(const std::array<Eigen::Vector2f, 3>& p) {
  const Eigen::Vector2f ab = p[1] - p[0], ac = p[2] - p[0];
  const float twice_px = std::abs(ab.x() * ac.y() - ab.y() * ac.x());
  return twice_px < kSlender_px * std::max({ab.norm(), ac.norm(), (ac - ab).norm()});
}

/// Pixels that `area_px` of an image cost when each is mapped so: one for e times coarser, and those that are more.
/// False where some direction becomes too coarse, or the whole too large, or it is turned over.
inline bool cost_of_stretch(const Eigen::Matrix2f& map, float area_px, float& cost) {
  constexpr float kCoarser = 1, kLeastDensity = 0.5f, kMostPixels = 4;
  const float pixels = map.determinant();
  // Singular values of two rows and columns.
  const float squares = map.squaredNorm();
  const float least =
      std::sqrt(std::max(0.0f, 0.5f * (squares - std::sqrt(std::max(0.0f, squares * squares - 4 * pixels * pixels)))));
  if (!(pixels > 0) || pixels > kMostPixels || !(least >= kLeastDensity)) return false;
  cost = area_px * (kCoarser * std::max(0.0f, -std::log(least)) + std::max(0.0f, pixels - 1));
  return true;
}

}  // namespace lapseam
