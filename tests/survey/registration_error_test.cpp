#include <gtest/gtest.h>

#include "lapseam/context.h"
#include "lapseam/error.h"
#include "lapseam/survey.h"
#include "support/analytic_views.h"

namespace lapseam {
namespace {

constexpr double kSigma_m = 0.002;

// Views from points on a line in a box room, each pose off by `shift_m` in a direction of its own.
std::vector<View> room_views(double shift_m, double sigma_m) {
  const auto room = test::box_room({-2, -2, -1.2}, {2, 2, 1.4});
  const Sensor sensor = PinholeSensor{240, 180, 200, 200, 119.5, 89.5, {}};
  std::mt19937 rng(9);
  std::normal_distribution<double> normal(0, 1);
  std::vector<View> views;
  for (unsigned i = 0; i < 8; ++i) {
    const Eigen::Isometry3d T = test::look_at({-1.2 + 0.15 * i, -1.0, 0.1 * i - 0.3}, {0.3, 1.8, 0.1});
    views.push_back(test::make_view("view", sensor, T, room, sigma_m, i));
    Eigen::Vector3d shift;
    for (const int k : {2, 1, 0}) shift[k] = normal(rng);  // one by one: arguments have no order
    views.back().T_world_view.pretranslate(shift_m * shift);
  }
  return views;
}

RegistrationError estimate(const std::vector<View>& views, const NoiseModel& noise, int threads = 2) {
  Context context(threads);
  const std::vector<NoiseModel> each(views.size(), noise);
  return estimate_registration_error(views, each, context);
}

TEST(RegistrationError, ZeroWhenNoiseExplainsIt) {
  const RegistrationError error = estimate(room_views(0, kSigma_m), {kSigma_m, 0, 0, 0});
  EXPECT_EQ(error.median_m, 0);
  EXPECT_EQ(error.p90_m, 0);
  EXPECT_EQ(error.pairs, 8u * 7u);
}

TEST(RegistrationError, ShiftedPosesShow) {
  // Two poses each off by s in every direction differ by √2·s across a plane.
  for (const double shift : {0.005, 0.01, 0.02}) {
    const RegistrationError error = estimate(room_views(shift, kSigma_m), {kSigma_m, 0, 0, 0});
    EXPECT_GT(error.median_m, 0.6 * shift) << shift;
    EXPECT_LT(error.median_m, 2.0 * shift) << shift;
    EXPECT_GT(error.p90_m, error.median_m);
    EXPECT_LT(error.p90_m, 5.0 * shift) << shift;
  }
}

TEST(RegistrationError, NoiselessViewsInPlaceDoNotDisagree) {
  // Bilinear interpolation of inverse range is exact on planes; what is left is the precision of floats.
  EXPECT_LT(estimate(room_views(0, 0), {1e-7, 0, 0, 0}).median_m, 1e-6);
}

TEST(RegistrationError, ViewsThatDoNotMeetTellNothing) {
  std::vector<View> views = room_views(0, kSigma_m);
  for (std::size_t i = 0; i < views.size(); ++i)
    views[i].T_world_view.pretranslate(Eigen::Vector3d(100.0 * double(i), 0, 0));
  const RegistrationError error = estimate(views, {kSigma_m, 0, 0, 0});
  EXPECT_EQ(error.pairs, 0u);
  EXPECT_EQ(error.median_m, 0);
}

TEST(RegistrationError, TwoSidesOfAThinWallAreNotOneSurface) {
  // Seen from both sides, 10 mm apart: facing away from each other, so nothing is compared.
  const Sensor sensor = PinholeSensor{120, 120, 200, 200, 59.5, 59.5, {}};
  std::vector<View> views = {
      test::make_view("front", sensor, test::look_at({0, 0, 1.2}, {0, 0, 0}), test::rectangle(0.005, -1, 1, -1, 1)),
      test::make_view("back", sensor, test::look_at({0, 0, -1.2}, {0, 0, 0}), test::rectangle(-0.005, -1, 1, -1, 1))};
  EXPECT_EQ(estimate(views, {0.0005, 0, 0, 0}).pairs, 0u);
}

TEST(RegistrationError, SameForAnyNumberOfThreads) {
  const std::vector<View> views = room_views(0.01, kSigma_m);
  const RegistrationError one = estimate(views, {kSigma_m, 0, 0, 0}, 1);
  for (const int threads : {2, 3, 8}) {
    const RegistrationError other = estimate(views, {kSigma_m, 0, 0, 0}, threads);
    EXPECT_EQ(one.median_m, other.median_m);
    EXPECT_EQ(one.p90_m, other.p90_m);
    EXPECT_EQ(one.pairs, other.pairs);
  }
}

TEST(RegistrationError, NeedsANoiseModelForEachView) {
  Context context(1);
  const std::vector<View> views = room_views(0, kSigma_m);
  EXPECT_THROW(estimate_registration_error(views, {}, context), InvalidInput);
}

}  // namespace
}  // namespace lapseam
