#pragma once

// Axis-aligned boxes of float coordinates, and the Morton order that puts near ones next to each other.

#include <Eigen/Core>
#include <cstdint>

namespace lapseam {

struct Box {
  Eigen::Vector3f low = Eigen::Vector3f::Constant(3.0e38f);
  Eigen::Vector3f high = Eigen::Vector3f::Constant(-3.0e38f);

  void extend(const Eigen::Vector3f& p) { low = low.cwiseMin(p), high = high.cwiseMax(p); }
  void extend(const Box& box) { low = low.cwiseMin(box.low), high = high.cwiseMax(box.high); }
  bool overlaps(const Box& o) const {
    return low.x() <= o.high.x() && o.low.x() <= high.x() && low.y() <= o.high.y() && o.low.y() <= high.y() &&
           low.z() <= o.high.z() && o.low.z() <= high.z();
  }
};

/// Spreads the low 21 bits of x to every third bit.
inline std::uint64_t spread_bits(std::uint64_t x) {
  x = (x | x << 32) & 0x1F00000000FFFFull;
  x = (x | x << 16) & 0x1F0000FF0000FFull;
  x = (x | x << 8) & 0x100F00F00F00F00Full;
  x = (x | x << 4) & 0x10C30C30C30C30C3ull;
  return (x | x << 2) & 0x1249249249249249ull;
}

}  // namespace lapseam
