#include <gtest/gtest.h>

#include <numbers>

#include "lapseam/context.h"
#include "lapseam/poses.h"
#include "lapseam/register.h"
#include "support/analytic_views.h"

namespace lapseam {
namespace {

constexpr double kRangeSigma_m = 0.002, kPitch_m = 0.4;
// Standard deviations beyond which a view is reported.
constexpr double kReported = 2 * 4.685;

// A wall with a row of equal balls before it, like the ribs of a radiator, and one larger ball. Views are along it.
std::vector<View> radiator_views() {
  std::vector<test::Shape> shapes = {test::box_room({-3, -2, -1.2}, {3, 2, 1.4}), test::sphere({0.4, 1.8, 0.5}, 0.3)};
  for (int k = -6; k <= 6; ++k) shapes.push_back(test::sphere({kPitch_m * k, 1.95, -0.4}, 0.45 * kPitch_m));
  const auto shape = [=](const Eigen::Vector3d& o, const Eigen::Vector3d& d) {
    std::optional<double> nearest;
    for (const test::Shape& one : shapes)
      if (const auto t = one(o, d); t && (!nearest || *t < *nearest)) nearest = t;
    return nearest;
  };
  const Sensor sensor = PinholeSensor{64, 48, 53, 53, 31.5, 23.5, {}};
  std::vector<View> views;
  for (int i = 0; i < 7; ++i) {
    const double x = 0.2 * i - 0.8;
    views.push_back(test::make_view("r" + std::to_string(i), sensor,
                                    test::look_at({x, -0.6 + 0.1 * (i % 3), 0.1}, {x + 0.15, 1.9, -0.1}), shape,
                                    kRangeSigma_m, unsigned(i + 1)));
  }
  return views;
}

// All roughly placed, and the fifth by so many repeats of the balls beside its place.
std::vector<View> displaced(std::vector<View> views, double repeats) {
  std::vector<Eigen::Isometry3d> poses;
  for (const View& view : views) poses.push_back(view.T_world_view);
  poses = perturb_poses(poses, {0.05, std::numbers::pi / 180, 1});
  for (std::size_t i = 0; i < views.size(); ++i) views[i].T_world_view = poses[i];
  views[4].T_world_view.pretranslate(Eigen::Vector3d(repeats * kPitch_m, 0, 0));
  return views;
}

RegisterResult place(const std::vector<View>& views) {
  Context context(2);
  const std::vector<NoiseModel> noise(views.size(), NoiseModel{kRangeSigma_m, 0, 0, 0});
  return register_views(views, noise, {}, {.capture_m = 0.5}, context);
}

double off_m(const RegisterResult& result, const std::vector<View>& truth, std::size_t i) {
  return (result.views[i].T_world_view.translation() - truth[i].T_world_view.translation()).norm();
}

TEST(Misplaced, AViewOneRepeatOffIsBroughtBack) {
  const std::vector<View> truth = radiator_views(), views = displaced(truth, 0.75);
  const RegisterResult result = place(views);
  for (std::size_t i = 0; i < views.size(); ++i) {
    EXPECT_LT(off_m(result, truth, i), kRangeSigma_m) << i;  // as where nothing repeats
    EXPECT_TRUE(result.views[i].problem.empty()) << result.views[i].problem;
  }
}

TEST(Misplaced, AViewThatIsNotIsReported) {
  const std::vector<View> truth = radiator_views();
  const RegisterResult result = place(displaced(truth, -0.8));
  // Every start is nearer to the next repeat than to the right one.
  ASSERT_GT(off_m(result, truth, 4), 0.5 * kPitch_m);
  EXPECT_GT(result.views[4].strain, kReported);
  EXPECT_NE(warning_about("x", result.views[4]).find("view x may be misplaced"), std::string::npos);
  for (const std::size_t i : {1, 2, 3, 5, 6}) {
    EXPECT_LT(result.views[i].strain, kReported);
    EXPECT_TRUE(warning_about("x", result.views[i]).empty());
    EXPECT_LT(off_m(result, truth, i), kRangeSigma_m) << i;  // and pulls none of the others along
  }
}

}  // namespace
}  // namespace lapseam
