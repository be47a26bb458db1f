#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <random>
#include <vector>

#include "lapseam/context.h"
#include "spatial/ray_scene.h"

namespace lapseam {
namespace {

/// Nearest of a fine lattice of points on the triangle: an upper bound that slivers cannot fool.
double distance_by_lattice(const Eigen::Vector3d& p, const std::array<Eigen::Vector3f, 3>& t) {
  constexpr int kSteps = 400;
  double best = 1e300;
  for (int i = 0; i <= kSteps; ++i) {
    for (int j = 0; i + j <= kSteps; ++j) {
      const double b1 = double(i) / kSteps, b2 = double(j) / kSteps;
      const Eigen::Vector3d q =
          (1 - b1 - b2) * t[0].cast<double>() + b1 * t[1].cast<double>() + b2 * t[2].cast<double>();
      best = std::min(best, (p - q).norm());
    }
  }
  return best;
}

class ClosestOnSliver : public testing::TestWithParam<float> {};

TEST_P(ClosestOnSliver, is_found_however_thin_the_triangle) {
  // A metre long, off the axes so that rounding bites; from well-shaped down to no area at all.
  const float thickness_m = GetParam();
  std::mt19937 random(5);
  std::uniform_real_distribution<float> coordinate(-0.6f, 0.6f);
  Context context(1);
  for (int trial = 0; trial < 20; ++trial) {
    const Eigen::Vector3f along = Eigen::Vector3f(coordinate(random), coordinate(random), 1).normalized();
    const Eigen::Vector3f aside = along.cross(Eigen::Vector3f::UnitX()).normalized();
    const Eigen::Vector3f base(3.3f, -2.1f, 1.7f);
    const std::vector<Eigen::Vector3f> corners = {base, base + along, base + 0.4f * along + thickness_m * aside};
    const RayScene scene(corners, std::vector<Triangle>{{0, 1, 2}}, context);
    const Eigen::Vector3f p =
        base + 0.5f * along + Eigen::Vector3f(coordinate(random), coordinate(random), coordinate(random));
    const ClosestPoint found = scene.closest(p);
    EXPECT_NEAR(double((found.point - p).norm()), double(found.distance), 1e-6);
    // The lattice misses by half its step across the distance: under 4e-6 m at 0.1 m and more.
    const double expected = distance_by_lattice(p.cast<double>(), {corners[0], corners[1], corners[2]});
    EXPECT_LE(double(found.distance), expected + 1e-6);
    EXPECT_GE(double(found.distance), expected - 1.25e-3 * 1.25e-3 / std::max(expected, 1e-2) - 1e-6);
  }
}

TEST_P(ClosestOnSliver, point_on_it_is_at_no_distance) {
  const float thickness_m = GetParam();
  std::mt19937 random(6);
  std::uniform_real_distribution<float> coordinate(-0.6f, 0.6f), weight(0, 1);
  Context context(1);
  for (int trial = 0; trial < 300; ++trial) {
    const Eigen::Vector3f along = Eigen::Vector3f(coordinate(random), coordinate(random), 1).normalized();
    const Eigen::Vector3f aside = along.cross(Eigen::Vector3f::UnitX()).normalized();
    const Eigen::Vector3f base(3.3f, -2.1f, 1.7f);
    const std::vector<Eigen::Vector3f> corners = {base, base + along,
                                                  base + weight(random) * along + thickness_m * aside};
    const RayScene scene(corners, std::vector<Triangle>{{0, 1, 2}}, context);
    float b1 = weight(random), b2 = weight(random);
    if (b1 + b2 > 1) b1 = 1 - b1, b2 = 1 - b2;
    const Eigen::Vector3f p = corners[0] + b1 * (corners[1] - corners[0]) + b2 * (corners[2] - corners[0]);
    // The point itself is rounded: half a unit of the last place of 4 m in each direction, some operations.
    EXPECT_LT(double(scene.closest(p).distance), 2e-6);
  }
}

INSTANTIATE_TEST_SUITE_P(Thickness_m, ClosestOnSliver, testing::Values(0.5f, 1e-3f, 1e-5f, 1e-6f, 3e-7f, 0.f));

TEST(ClosestPoint, equal_distances_give_the_smaller_index) {
  // Two sheets, one centimetre above and below; and triangles that share the vertex that is closest.
  const std::vector<Eigen::Vector3f> positions = {{0, 0, 0.01f},  {1, 0, 0.01f},  {0, 1, 0.01f},
                                                  {0, 0, -0.01f}, {1, 0, -0.01f}, {0, 1, -0.01f}};
  Context context(1);
  for (const bool is_swapped : {false, true}) {
    std::vector<Triangle> triangles = {{0, 1, 2}, {3, 4, 5}};
    if (is_swapped) std::swap(triangles[0], triangles[1]);
    const RayScene scene(positions, triangles, context);
    EXPECT_EQ(scene.closest({0.2f, 0.2f, 0}).triangle, 0u);
    EXPECT_EQ(scene.closest({-1, -1, 0}).triangle, 0u);
  }
}

}  // namespace
}  // namespace lapseam
