#include "texture/spots.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <utility>

namespace lapseam {
namespace {

/// Points of the unit square without clusters: M. Roberts, The Unreasonable Effectiveness of Quasirandom Sequences,
/// 2018.
std::pair<float, float> quasirandom(std::size_t k) {
  const double x = 0.7548776662466927 * double(k + 1), y = 0.5698402909980532 * double(k + 1);
  return {float(x - std::floor(x)), float(y - std::floor(y))};
}

}  // namespace

std::vector<Spot> choose_spots(const Mesh& mesh, std::size_t most) {
  std::vector<double> up_to(mesh.triangle_count());
  double sum = 0;
  const auto corner = [&](std::size_t i, std::size_t k) { return mesh.positions_m[mesh.triangles[i][k]]; };
  const auto cross = [&](std::size_t i) -> Eigen::Vector3f {
    return (corner(i, 1) - corner(i, 0)).cross(corner(i, 2) - corner(i, 0));
  };
  for (std::size_t i = 0; i < up_to.size(); ++i) up_to[i] = sum += double(cross(i).norm());
  std::vector<Spot> spots;
  if (!(sum > 0)) return spots;
  const std::size_t count = std::min(most, mesh.triangle_count());
  for (std::size_t k = 0; k < count; ++k) {
    const double at = (double(k) + 0.5) / double(count) * sum;
    const auto found = std::size_t(std::lower_bound(up_to.begin(), up_to.end(), at) - up_to.begin());
    const std::size_t i = std::min(found, up_to.size() - 1);
    auto [a, b] = quasirandom(k);
    if (a + b > 1) a = 1 - a, b = 1 - b;
    spots.push_back(
        {std::uint32_t(i), (1 - a - b) * corner(i, 0) + a * corner(i, 1) + b * corner(i, 2), cross(i).normalized()});
  }
  return spots;
}

}  // namespace lapseam
