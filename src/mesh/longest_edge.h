#pragma once

#include <algorithm>
#include <span>

#include "lapseam/mesh.h"

namespace lapseam {

/// Length of a triangle's longest edge.
inline float longest_edge(std::span<const Eigen::Vector3f> positions_m, const Triangle& t) {
  const auto edge = [&](std::size_t k) { return (positions_m[t[k]] - positions_m[t[(k + 1) % 3]]).norm(); };
  return std::max({edge(0), edge(1), edge(2)});
}

}  // namespace lapseam
