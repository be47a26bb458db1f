#include "register/rounding.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <filesystem>

#include "lapseam/context.h"
#include "lapseam/io.h"
#include "lapseam/noise.h"
#include "lapseam/register_scene.h"
#include "lapseam/smooth.h"
#include "support/analytic_views.h"

namespace lapseam {
namespace {

// Ranges whose inverse is whole steps, 22 mm at 2 m.
constexpr double kStep_per_m = 0.0055;
float rounded(float r) { return float(1 / (kStep_per_m * std::round(1 / (kStep_per_m * double(r))))); }

View view_of_a_room(double aside_m = 0) {
  const auto shape = test::nearest({test::box_room({-2, -2, -1.2}, {2, 2, 1.4}), test::sphere({0.4, 1.2, -0.4}, 0.5)});
  const Eigen::Isometry3d T = test::look_at({-1 + aside_m, -1.2, 0.1}, {0.9, 1.8, 0.2});
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

Scene scene_of_a_room(bool is_rounded) {
  Scene scene;
  for (int i = 0; i < 3; ++i) {
    View view = view_of_a_room(0.1 * i);
    view.name = std::to_string(i);
    view.sensor_id = "camera";
    for (float& r : view.range.pixels)
      if (is_rounded && r > 0) r = rounded(r);
    scene.views.push_back(test::as_source(view));
    scene.views.back().sensor_id = "camera";
  }
  return scene;
}

TEST(Rounding, RangeImagesAreWrittenWithoutStepsWhereThereWereSome) {
  Context context;
  const std::filesystem::path folder = std::filesystem::path(testing::TempDir()) / "lapseam_rounding";
  RegisterSceneOptions options;
  options.registration.calibrate = true;
  options.corrected_ranges = folder;
  const Scene given = scene_of_a_room(true);
  const RegisterSceneResult result = register_scene(given, options, context);
  EXPECT_EQ(result.report.unrounded, std::vector<std::string>{"camera"});
  EXPECT_TRUE(result.report.corrections.empty());  // of three views alone nothing else is found
  for (std::size_t i = 0; i < given.views.size(); ++i) {
    const View before = load_view(given.views[i]), after = load_view(result.scene.views[i]);
    std::size_t moved = 0;
    for (std::size_t k = 0; k < before.range.size(); ++k) {
      if (!(before.range.pixels[k] > 0)) continue;
      const double by = std::abs(1 / double(after.range.pixels[k]) - 1 / double(before.range.pixels[k]));
      EXPECT_LE(by, 0.5001 * kStep_per_m);
      moved += by > 0;
    }
    EXPECT_GT(moved, before.range.size() / 2);
  }
  std::filesystem::remove_all(folder);
  EXPECT_TRUE(register_scene(scene_of_a_room(false), options, context).report.unrounded.empty());
  EXPECT_FALSE(std::filesystem::exists(folder));
}

}  // namespace
}  // namespace lapseam
