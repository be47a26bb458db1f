#include "register/surfels.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "support/analytic_views.h"

namespace lapseam {
namespace {

// Of blocks of 2 × 2 samples, 20 mm apart from 2 m away, a fifth of that is left: three values in a row do not tell
// an edge of 90° from noise.
constexpr double kNoise_m = 0.008;

double off_the_walls(const Eigen::Vector3d& p, const Eigen::Vector3d& low, const Eigen::Vector3d& high) {
  return std::min((p - low).cwiseAbs().minCoeff(), (high - p).cwiseAbs().minCoeff());
}

TEST(Surfels, AreOnTheSurfaceUpToEdges) {
  const Eigen::Vector3d low(-2, -2, -1.2), high(2, 2, 1.4);
  const Sensor sensor = PinholeSensor{240, 180, 200, 200, 119.5, 89.5, {}};
  // The noise is what the model says of ranges that have none: what is off is off to the same side in every view.
  for (const double x : {0.0, 0.004, 0.008, 0.012}) {
    const View view = test::make_view("corner", sensor, test::look_at({0.6, 0.5, 0.1}, {2 - x, 2 + x, 0.1}),
                                      test::box_room(low, high), 0, 1);
    const SurfelPyramid pyramid = make_surfels(view, NoiseModel{kNoise_m, 0, 0, 0}, 25'000, {});
    const SurfelImage& finest = pyramid.levels.front();
    ASSERT_EQ(finest.factor, 2);
    std::size_t used_beside = 0, beside = 0;
    double most_off = 0, most_turned = 0;
    for (const Surfel& surfel : finest.surfels) {
      const Eigen::Vector3d p = view.T_world_view * surfel.point.cast<double>();
      const Eigen::Vector3d room = (high - p).cwiseMin(p - low);
      // Between one and two spacings from the upright edge, far from floor and ceiling.
      const double from_edge = std::max(room.x(), room.y());
      const bool is_beside = room.z() > 0.2 && from_edge > 0.03 && from_edge < 0.06;
      beside += is_beside;
      if (!surfel.is_usable()) continue;
      used_beside += is_beside;
      most_off = std::max(most_off, off_the_walls(p, low, high) / double(surfel.sigma_m));
      const Eigen::Vector3d normal = view.T_world_view.linear() * surfel.normal.cast<double>();
      if (is_beside) most_turned = std::max(most_turned, std::acos(std::min(1.0, normal.cwiseAbs().maxCoeff())));
    }
    // A mean over an edge of 90° is up to a quarter of a spacing off the walls.
    EXPECT_LT(most_off, 0.5) << x;
    // Runs that lead away from the edge tell normals beside it: to 6°, as is asked of normals.
    EXPECT_GT(used_beside, beside / 2) << x;
    EXPECT_LT(most_turned, 0.1) << x;
  }
}

}  // namespace
}  // namespace lapseam
