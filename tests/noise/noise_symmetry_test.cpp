#include "noise/noise_symmetry.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "support/analytic_views.h"

namespace lapseam {
namespace {

constexpr NoiseModel kNoise{0, 0, 0.006, 0};

// A room with a ball before its far wall, at most 5 m away; σ is 6 mm · r², symmetric in the range or in its inverse.
View noisy_view(bool is_symmetric_in_range, unsigned seed) {
  const auto shape = test::nearest({test::box_room({-2, -1, -1.2}, {2, 4.5, 1.4}), test::sphere({0.4, 3, -0.4}, 0.5)});
  const Sensor sensor = PinholeSensor{640, 480, 525, 525, 319.5, 239.5, {}};
  View view = test::make_view("v", sensor, test::look_at({-0.6, 0, 0}, {0, 4, 0}), shape, 0, 1);
  std::mt19937 random(seed);
  std::normal_distribution<double> normal;
  for (float& r : view.range.pixels) {
    if (!(r > 0)) continue;
    const double relative = kNoise.sigma(double(r)) / double(r) * normal(random);
    r = float(is_symmetric_in_range ? double(r) * (1 + relative) : double(r) / (1 + relative));
  }
  return view;
}

bool is_judged_symmetric_in_range(bool is_symmetric_in_range, double noise_factor = 1) {
  std::vector<View> views;
  for (unsigned seed = 1; seed <= 4; ++seed) views.push_back(noisy_view(is_symmetric_in_range, seed));
  NoiseModel believed = kNoise;
  believed.s2_per_m *= noise_factor;
  std::vector<const View*> of_view;
  for (const View& view : views) of_view.push_back(&view);
  const std::vector<const NoiseModel*> noise(views.size(), &believed);
  Context context(2);
  return lapseam::is_symmetric_in_range(of_view, noise, context);
}

TEST(NoiseSymmetry, TimesOfFlightAreToldFromDisparities) {
  EXPECT_TRUE(is_judged_symmetric_in_range(true));
  EXPECT_FALSE(is_judged_symmetric_in_range(false));
}

TEST(NoiseSymmetry, ANoiseModelThatIsATenthOffDecidesNothing) {
  for (const double factor : {0.9, 1.1}) {
    EXPECT_TRUE(is_judged_symmetric_in_range(true, factor)) << factor;
    EXPECT_FALSE(is_judged_symmetric_in_range(false, factor)) << factor;
  }
}

TEST(NoiseSymmetry, FalseWhereNothingTells) {
  View view = noisy_view(true, 1);
  const View* const views[] = {&view};
  const NoiseModel tiny{0, 0, 1e-6, 0};
  const NoiseModel* const noise[] = {&tiny};
  Context context(1);
  EXPECT_FALSE(is_symmetric_in_range(views, noise, context));
  EXPECT_FALSE(is_symmetric_in_range({}, {}, context));
}

}  // namespace
}  // namespace lapseam
