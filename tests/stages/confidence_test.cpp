#include <gtest/gtest.h>

#include "lapseam/context.h"
#include "lapseam/triangulate.h"
#include "support/analytic_views.h"
#include "support/patches.h"

namespace lapseam {
namespace {

Patch make_patch(const View& view, const NoiseModel& noise) {
  Context context(2);
  return test::make_patch(view, noise, context);
}

View plane_view(double distance, double angle_deg) {
  const double a = angle_deg * M_PI / 180;
  return test::make_view("plane", test::small_camera(), Eigen::Isometry3d::Identity(),
                         test::plane({0, 0, distance}, {std::sin(a), 0, std::cos(a)}));
}

constexpr NoiseModel kKinect{0.0015, -0.0015, 0.0019, 1e-4};

TEST(Confidence, IncidenceIsTheCosine) {
  for (const double angle : {0.0, 30.0, 60.0}) {
    const Patch patch = make_patch(plane_view(2, angle), kKinect);
    EXPECT_NEAR(patch.incidence.at(60, 60) / 255.0, std::cos(angle * M_PI / 180), 0.01) << angle;
  }
}

TEST(Confidence, FrontalBeatsObliqueAndNearBeatsFar) {
  const auto centre = [](double distance, double angle) {
    return make_patch(plane_view(distance, angle), kKinect).confidence.at(60, 60);
  };
  EXPECT_GT(centre(2, 0), centre(2, 45));
  EXPECT_GT(centre(1, 0), centre(2, 0));
  // The distance factor: a near oblique measurement beats a far frontal one.
  EXPECT_GT(centre(1, 50), centre(3, 0));
}

TEST(Confidence, FallsOffTowardsBordersAndSteps) {
  const Patch patch = make_patch(
      test::make_view("step", test::small_camera(), Eigen::Isometry3d::Identity(),
                      test::nearest({test::rectangle(1.9, -0.5, 0.5, -0.5, 0.5), test::plane({0, 0, 2.5}, {0, 0, 1})})),
      kKinect);
  const auto confidence = [&](int u, int v) { return confidence_per_m(patch.confidence.at(u, v)); };
  const float inside = confidence(60, 60);
  EXPECT_LT(confidence(1, 60), 0.6f * inside);
  int edge = 60;  // the last column of the nearer rectangle
  while (patch.view.range.at(edge + 1, 60) < 2.2f) ++edge;
  EXPECT_LT(confidence(edge, 60), 0.5f * inside);
  EXPECT_LT(patch.confidence.at(edge, 60), patch.confidence.at(edge - 5, 60));
  EXPECT_NEAR(inside, confidence(64, 63), 0.05f * inside);
}

TEST(Confidence, CodesAreLogarithmicSteps) {
  for (int code = 1; code <= 255; ++code) EXPECT_EQ(confidence_code(confidence_per_m(std::uint8_t(code))), code);
  EXPECT_EQ(confidence_code(1e-9f), 1);
  EXPECT_EQ(confidence_code(1e9f), 255);
  EXPECT_EQ(confidence_per_m(0), 0.0f);
  EXPECT_NEAR(confidence_per_m(116) / confidence_per_m(101), 2.0f, 1e-3f);  // an octave
}

TEST(Confidence, NoTriangleNoConfidence) {
  View view = plane_view(2, 0);
  view.range.at(50, 50) = kInvalidRange;
  const Patch patch = make_patch(view, kKinect);
  EXPECT_EQ(patch.confidence.at(50, 50), 0);
  EXPECT_GT(patch.confidence.at(49, 50), 0);
}

}  // namespace
}  // namespace lapseam
