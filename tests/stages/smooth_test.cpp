#include "lapseam/smooth.h"

#include <gtest/gtest.h>

#include <cstring>

#include "lapseam/context.h"
#include "support/analytic_views.h"

namespace lapseam {
namespace {

double rms_difference(const RangeImage& a, const RangeImage& b, int margin) {
  double sum = 0;
  int n = 0;
  for (int v = margin; v < a.height - margin; ++v)
    for (int u = margin; u < a.width - margin; ++u) {
      if (!(a.at(u, v) > 0) || !(b.at(u, v) > 0)) continue;
      sum += std::pow(double(a.at(u, v)) - double(b.at(u, v)), 2);
      ++n;
    }
  return std::sqrt(sum / n);
}

std::vector<Sensor> sensors() {
  return {test::small_camera(), OrthographicSensor{120, 120, 0.01, 0.01, 59.5, 59.5},
          SphericalSensor::from_limits(360, 120, -1, 1, 0.4, -0.4)};
}

TEST(Smooth, SlantedPlaneIsUnchanged) {
  Context context(2);
  for (const Sensor& sensor : sensors()) {
    // Spherical scanners look along x, the others along z.
    const bool is_spherical = std::holds_alternative<SphericalSensor>(sensor);
    const Eigen::Vector3d normal = is_spherical ? Eigen::Vector3d(1, 0.4, 0.3) : Eigen::Vector3d(0.4, 0.3, 1);
    const Eigen::Vector3d point = is_spherical ? Eigen::Vector3d(3, 0, 0) : Eigen::Vector3d(0, 0, 3);
    const View view =
        test::make_view("p", sensor, Eigen::Isometry3d::Identity(), test::plane(point, normal.normalized()));
    const SmoothResult result = smooth(view, {0.01, 0, 0, 0}, {}, context);
    // Pinhole and orthographic: exact to float rounding. Spherical: what the pair correction leaves at taps of 8
    // samples, 44 mrad apart, on a plane aslant: a tenth of a part in a thousand of the range.
    EXPECT_LT(rms_difference(result.range, view.range, 0), is_spherical ? 4e-4 : 2e-6) << kind_name(sensor);
  }
}

TEST(Smooth, RemovesMostOfTheNoiseWithoutBias) {
  Context context(2);
  for (const Sensor& sensor : sensors()) {
    const bool is_spherical = std::holds_alternative<SphericalSensor>(sensor);
    const Eigen::Vector3d normal = is_spherical ? Eigen::Vector3d::UnitX() : Eigen::Vector3d::UnitZ();
    const test::Shape shape = test::plane(2.5 * normal, normal);
    const View clean = test::make_view("p", sensor, Eigen::Isometry3d::Identity(), shape);
    const View noisy = test::make_view("p", sensor, Eigen::Isometry3d::Identity(), shape, 0.01);
    const SmoothResult result = smooth(noisy, {0.01, 0, 0, 0}, {}, context);
    const double left = rms_difference(result.range, clean.range, 10);
    EXPECT_LT(left, 0.2 * 0.01) << kind_name(sensor);
    EXPECT_LT(result.remaining_sigma_factor, 0.2);
    EXPECT_GT(result.remaining_sigma_factor, 0.3 * left / 0.01);
  }
}

TEST(Smooth, StepsAndHolesStay) {
  Context context(2);
  const test::Shape shape =
      test::nearest({test::rectangle(2.0, -0.4, 0.4, -0.4, 0.4), test::rectangle(2.1, -2, 2, -2, 0.8)});
  const View clean = test::make_view("s", test::small_camera(), Eigen::Isometry3d::Identity(), shape);
  const View noisy = test::make_view("s", test::small_camera(), Eigen::Isometry3d::Identity(), shape, 0.004);
  const SmoothResult result = smooth(noisy, {0.004, 0, 0, 0}, {}, context);
  int samples = 0;
  for (std::size_t i = 0; i < noisy.range.size(); ++i) {
    ASSERT_EQ(noisy.range.pixels[i] > 0, result.range.pixels[i] > 0);
    if (!(clean.range.pixels[i] > 0)) continue;
    ++samples;
    // Nothing may end up between the two surfaces, 25 sigma apart: not even at the edge.
    EXPECT_LT(std::abs(result.range.pixels[i] - clean.range.pixels[i]), 5 * 0.004f);
  }
  EXPECT_GT(samples, 5000);
}

TEST(Smooth, SameBytesForAnyThreads) {
  allow_threads(8);  // or threads beyond the processors would not be made
  const View noisy =
      test::make_view("s", test::small_camera(), Eigen::Isometry3d::Identity(), test::sphere({0, 0, 3}, 1.5), 0.01);
  Context one(1);
  const RangeImage reference = smooth(noisy, {0.01, 0, 0, 0}, {}, one).range;
  for (const int threads : {2, 3, 8}) {
    Context context(threads);
    const RangeImage other = smooth(noisy, {0.01, 0, 0, 0}, {}, context).range;
    EXPECT_EQ(0, std::memcmp(reference.pixels.data(), other.pixels.data(), reference.size() * sizeof(float)));
  }
}

}  // namespace
}  // namespace lapseam
