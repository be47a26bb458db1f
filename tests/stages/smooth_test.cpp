#include "lapseam/smooth.h"

#include <gtest/gtest.h>

#include <cstring>
#include <random>

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

// σ is a fortieth of the range: means of inverse ranges are too near by a sixteen-hundredth of it, 2.5 mm. Tamed and
// gated, a wall comes out half as far off; what is corrected is the whole (docs/method.md says why).
TEST(Smooth, NoiseSymmetricInTheRangeMovesMeansBackByItsVariance) {
  Context context(2);
  const PinholeSensor camera{320, 240, 525, 525, 159.5, 119.5, {}};
  const test::Shape wall = test::plane(4 * Eigen::Vector3d::UnitZ(), Eigen::Vector3d::UnitZ());
  const View noisy = test::make_view("p", camera, Eigen::Isometry3d::Identity(), wall, 0.1);
  const auto mean_moved_by = [&](const NoiseModel& noise) {
    double sum = 0;
    const RangeImage smoothed = smooth(noisy, noise, {}, context).range;
    for (std::size_t i = 0; i < smoothed.size(); ++i) sum += double(smoothed.pixels[i]) - double(noisy.range.pixels[i]);
    return sum / double(smoothed.size());
  };
  NoiseModel noise{0, 0, 0.1 / 16, 0};
  const double uncorrected = mean_moved_by(noise);
  EXPECT_LT(uncorrected, -0.001);
  noise.is_symmetric_in_range = true;
  EXPECT_NEAR(mean_moved_by(noise) - uncorrected, 0.0025, 0.0001);
  EXPECT_LE(std::abs(mean_moved_by(noise)), std::abs(uncorrected));
}

TEST(Smooth, StepsOfRoundingGoIfNeighborsAreKnownToShareThem) {
  // A wall aslant, in whole disparities: terraces of about ten samples.
  Context context(2);
  const test::Shape wall = test::plane({0, 0, 2}, Eigen::Vector3d(0.2, 0.1, 1).normalized());
  const View clean = test::make_view("p", test::small_camera(), Eigen::Isometry3d::Identity(), wall);
  View rounded = clean;
  constexpr float kStep_per_m = 0.0028f;  // of inverse range
  for (float& r : rounded.range.pixels) r = 1 / (kStep_per_m * std::round(1 / (r * kStep_per_m)));
  const auto left = [&](double correlation) {
    const NoiseModel noise{.s2_per_m = double(kStep_per_m) / std::sqrt(12.0), .correlation = correlation};
    return rms_difference(smooth(rounded, noise, {}, context).range, clean.range, 16);
  };
  const double before = rms_difference(rounded.range, clean.range, 16);
  EXPECT_LT(left(4), 0.35 * before);
  EXPECT_LT(left(4), 0.7 * left(1));
}

TEST(Smooth, SlantedWallsAreSmoothedWithinTheNoiseThatSlantMakes) {
  Context context(2);
  // 76° between ray and normal.
  const Eigen::Vector3d across = Eigen::Vector3d(4, 0, 1).normalized();
  const NoiseModel noise{.s0_m = 0.001, .pointing_rad = 0.002};
  const View clean = test::make_view("p", OrthographicSensor{120, 120, 0.01, 0.01, 59.5, 59.5},
                                     Eigen::Isometry3d::Identity(), test::plane({0, 0, 5}, across));
  View noisy = clean;
  std::mt19937 rng(5);
  std::normal_distribution<double> normal(0, 1);
  for (float& r : noisy.range.pixels) r += float(normal(rng) * noise.sigma(double(r), across.z()));
  const double before = rms_difference(noisy.range, clean.range, 12);
  const double knowing = rms_difference(smooth(noisy, noise, {}, context).range, clean.range, 12);
  const double not_knowing = rms_difference(smooth(noisy, {.s0_m = 0.001}, {}, context).range, clean.range, 12);
  EXPECT_LT(knowing, 0.35 * before);
  EXPECT_LT(knowing, 0.5 * not_knowing);
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

// The outside of a box corner that points at the sensor: a right angle along a vertical edge at z = 1.
test::Shape right_angle() {
  const Eigen::Vector3d apex(0, 0, 1);
  const double h = std::sqrt(0.5);
  const test::Shape left = test::plane(apex, {h, 0, -h}), right = test::plane(apex, {-h, 0, -h});
  return [=](const Eigen::Vector3d& o, const Eigen::Vector3d& d) {
    const auto a = left(o, d), b = right(o, d);
    return a && b ? std::optional(std::max(*a, *b)) : a ? a : b;
  };
}

// An arc of radius ρ between two planes at right angles is (√2 − 1) ρ from their edge. Noise up to the distance between
// samples; with three times as much it is three distances.
TEST(Smooth, RightAngleKeepsItsRadiusUnderTwoSpacings) {
  Context context(2);
  const PinholeSensor sensor = test::small_camera(121, 110);
  const double spacing = 1 / sensor.fx;
  const View clean = test::make_view("e", sensor, Eigen::Isometry3d::Identity(), right_angle());
  for (const double noise_in_spacings : {0.1, 0.3, 1.0}) {
    const double sigma = noise_in_spacings * spacing;
    // The edge is column 60; averaged over rows and noises, what is left is the shape of its section.
    double off = 0;
    int n = 0;
    for (unsigned seed = 1; seed <= 4; ++seed) {
      const View noisy = test::make_view("e", sensor, Eigen::Isometry3d::Identity(), right_angle(), sigma, seed);
      const RangeImage result = smooth(noisy, {sigma, 0, 0, 0}, {}, context).range;
      for (int v = 20; v < 100; ++v, ++n) off += double(result.at(60, v)) - double(clean.range.at(60, v));
    }
    EXPECT_LT(std::abs(off / n) / (std::sqrt(2.0) - 1), 2 * spacing) << noise_in_spacings;
  }
}

TEST(Smooth, RodOfThreeSamplesWidthSurvives) {
  Context context(2);
  const PinholeSensor sensor = test::small_camera(121, 110);
  // Columns 59, 60 and 61, 1.5 / 110 m apart; the rod stands 0.2 m before a wall.
  const double half = 1.5 * 1.5 / 110;
  const test::Shape shape =
      test::nearest({test::rectangle(1.5, -half, half, -2, 2), test::rectangle(1.7, -2, 2, -2, 2)});
  const double sigma = 0.004;
  const View clean = test::make_view("r", sensor, Eigen::Isometry3d::Identity(), shape);
  const View noisy = test::make_view("r", sensor, Eigen::Isometry3d::Identity(), shape, sigma);
  const RangeImage result = smooth(noisy, {sigma, 0, 0, 0}, {}, context).range;
  double squares = 0;
  int rod = 0;
  for (std::size_t i = 0; i < result.size(); ++i) {
    if (!(clean.range.pixels[i] < 1.6f)) continue;
    const double error = double(result.pixels[i]) - double(clean.range.pixels[i]);
    EXPECT_LT(std::abs(error), 3 * sigma);
    squares += error * error;
    ++rod;
  }
  ASSERT_EQ(rod, 3 * 121);
  EXPECT_LT(std::sqrt(squares / rod), 0.6 * sigma);  // smoothed, along its length
}

// One surface from 4 m and another from 0.6 m, with a depth camera's noise: both come out smooth without an option, and
// what is 6 mm high on the near one is still there.
TEST(Smooth, RoughAtFourMetresAndFineNearByBothComeOutRight) {
  Context context(2);
  const NoiseModel noise{0.0005, 0, 0.002, 0};
  const PinholeSensor sensor = test::small_camera(120, 400);
  const auto smoothed = [&](const test::Shape& shape, double range_m, View& clean) {
    clean = test::make_view("a", sensor, Eigen::Isometry3d::Identity(), shape);
    const View noisy = test::make_view("a", sensor, Eigen::Isometry3d::Identity(), shape, noise.sigma(range_m));
    return smooth(noisy, noise, {}, context).range;
  };
  View clean;
  const RangeImage far = smoothed(test::plane({0, 0, 4}, {0.3, 0, 1}), 4, clean);
  EXPECT_LT(rms_difference(far, clean.range, 0), 0.2 * noise.sigma(4));
  const test::Shape plate_on_wall =
      test::nearest({test::rectangle(0.594, -0.02, 0.02, -0.02, 0.02), test::plane({0, 0, 0.6}, {0, 0, 1})});
  const RangeImage near = smoothed(plate_on_wall, 0.6, clean);
  EXPECT_LT(rms_difference(near, clean.range, 0), 0.3 * noise.sigma(0.6));
  const std::size_t wall = 5 + 120 * 60, plate = 60 + 120 * 60;
  EXPECT_NEAR(near.pixels[wall] - near.pixels[plate], 0.006, noise.sigma(0.6));
}

// A sample in sixty is off by more than 2.4 sigma. Beside dropouts and at the border of the image few pairs lie about
// it, and it stayed as it was: a spike on a wall.
TEST(Smooth, NoSpikeStaysBesideDropoutsAndBorders) {
  Context context(2);
  std::vector<Sensor> all = sensors();
  for (const Sensor& sensor : all) {
    const bool is_spherical = std::holds_alternative<SphericalSensor>(sensor);
    const Eigen::Vector3d normal = is_spherical ? Eigen::Vector3d(1, 0.3, 0.2) : Eigen::Vector3d(0.3, 0.2, 1);
    const test::Shape shape =
        test::plane(is_spherical ? Eigen::Vector3d(2.5, 0, 0) : Eigen::Vector3d(0, 0, 2.5), normal.normalized());
    const View clean = test::make_view("p", sensor, Eigen::Isometry3d::Identity(), shape);
    View noisy = test::make_view("p", sensor, Eigen::Isometry3d::Identity(), shape, 0.01);
    std::mt19937 random(7);
    for (float& r : noisy.range.pixels)
      if (random() % 10 == 0) r = 0;
    const RangeImage result = smooth(noisy, {0.01, 0, 0, 0}, {}, context).range;
    int samples = 0, spikes_before = 0, spikes = 0;
    for (std::size_t i = 0; i < result.size(); ++i) {
      if (!(noisy.range.pixels[i] > 0)) continue;
      // Spherical: where the plane runs away from the scanner, noise along the ray is not what is tested.
      if (clean.range.pixels[i] > 4) continue;
      ++samples;
      spikes_before += std::abs(noisy.range.pixels[i] - clean.range.pixels[i]) > 0.02f;
      spikes += std::abs(result.pixels[i] - clean.range.pixels[i]) > 0.02f;
    }
    EXPECT_GT(spikes_before, samples / 30) << kind_name(sensor);  // 4.6 % of a normal distribution
    EXPECT_LE(spikes, samples / 10000) << kind_name(sensor);
  }
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
