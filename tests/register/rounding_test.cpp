#include "register/rounding.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "lapseam/context.h"
#include "lapseam/noise.h"
#include "lapseam/smooth.h"
#include "support/analytic_views.h"

namespace lapseam {
namespace {

// Ranges whose inverse is whole steps, 22 mm at 2 m.
constexpr double kStep_per_m = 0.0055;
float rounded(float r) { return float(1 / (kStep_per_m * std::round(1 / (kStep_per_m * double(r))))); }

View view_of_a_room() {
  const auto shape = test::nearest({test::box_room({-2, -2, -1.2}, {2, 2, 1.4}), test::sphere({0.4, 1.2, -0.4}, 0.5)});
  const Eigen::Isometry3d T = test::look_at({-1, -1.2, 0.1}, {0.9, 1.8, 0.2});
  return test::make_view("a", PinholeSensor{240, 180, 200, 200, 119.5, 89.5, {}}, T, shape, 0, 1);
}

TEST(Rounding, RangesAreSmoothedWithinTheStepThatTheyWereRoundedTo) {
  Context context;
  const View truth = view_of_a_room();
  View view = truth;
  for (float& r : view.range.pixels)
    if (r > 0) r = rounded(r);
  const std::vector<float> values = range_values(std::vector<const View*>{&view}, context);
  const NoiseModel noise = estimate_noise(std::vector<const View*>{&view}, context);
  ASSERT_GT(noise.correlation, 1);
  const RangeImage out = within_rounding(view.range, smooth(view, noise, {.reach_px = 32}, context).range, values);
  std::vector<double> before, after;
  for (std::size_t i = 0; i < out.size(); ++i) {
    const float given = view.range.pixels[i];
    ASSERT_EQ(out.pixels[i] > 0, given > 0);
    if (!(given > 0)) continue;
    // Nothing is moved beyond its step; the outermost values are known on one side only.
    EXPECT_LE(std::abs(1 / double(out.pixels[i]) - 1 / double(given)), 0.5001 * kStep_per_m);
    before.push_back(std::abs(double(given - truth.range.pixels[i])));
    after.push_back(std::abs(double(out.pixels[i] - truth.range.pixels[i])));
  }
  std::sort(before.begin(), before.end());
  std::sort(after.begin(), after.end());
  // Half of what rounding does; the rest is at creases, where no plane tells.
  EXPECT_LT(after[after.size() / 2], 0.5 * before[before.size() / 2]);
}

TEST(Rounding, ValuesThatAreCloseTogetherStay) {
  Context context;
  View view = view_of_a_room();
  const std::vector<float> values = range_values(std::vector<const View*>{&view}, context);
  EXPECT_TRUE(std::is_sorted(values.begin(), values.end()));
  RangeImage smoothed = view.range;
  for (float& r : smoothed.pixels) r *= 1.01f;
  const RangeImage out = within_rounding(view.range, smoothed, values);
  double moved = 0, count = 0;
  for (std::size_t i = 0; i < out.size(); ++i) {
    if (!(view.range.pixels[i] > 0)) continue;
    moved += std::abs(double(out.pixels[i] - view.range.pixels[i]));
    ++count;
  }
  EXPECT_LT(moved / count, 0.001);  // 1 % would be 20 mm
}

}  // namespace
}  // namespace lapseam
