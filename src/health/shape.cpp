#include "health/shape.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <utility>

namespace lapseam {

TriangleShape shape_of(const Eigen::Vector3f& a, const Eigen::Vector3f& b, const Eigen::Vector3f& c) {
  const std::array<Eigen::Vector3d, 3> corner = {a.cast<double>(), b.cast<double>(), c.cast<double>()};
  std::array<std::pair<double, std::size_t>, 3> sides;
  for (std::size_t k = 0; k < 3; ++k) sides[k] = {(corner[(k + 1) % 3] - corner[(k + 2) % 3]).norm(), k};
  std::sort(sides.begin(), sides.end());
  const std::size_t tip = sides[0].second;  // the smallest angle faces the shortest side
  const Eigen::Vector3d u = corner[(tip + 1) % 3] - corner[tip], v = corner[(tip + 2) % 3] - corner[tip];
  const double twice_area = u.cross(v).norm();
  const double angle = std::atan2(twice_area, u.dot(v));
  return {float(angle * 180 / std::numbers::pi), float(sides[1].first), twice_area / 2};
}

}  // namespace lapseam
