#pragma once

// Triangles that cut through or touch others where they share no vertex or only one.

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "lapseam/mesh.h"

namespace lapseam {

class Context;

struct SelfIntersections {
  std::uint64_t triangles = 0;                      ///< that meet at least one other
  std::vector<std::array<std::uint32_t, 2>> pairs;  ///< sorted; the smaller index first
  std::vector<std::uint8_t> is_meeting;             ///< per triangle: 1 where it meets another
};

/// Exact. Pairs with one common vertex meet when the edge opposite to it meets the other triangle; pairs with two or
/// three common vertices are not tested, nor triangles of zero area.
SelfIntersections find_self_intersections(std::span<const Eigen::Vector3f> positions_m,
                                          std::span<const Triangle> triangles, Context& context);

}  // namespace lapseam
