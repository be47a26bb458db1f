#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <random>
#include <set>

#include "lapseam/context.h"
#include "lapseam/error.h"
#include "lapseam/noise.h"
#include "lapseam/view.h"
#include "support/analytic_views.h"

namespace lapseam {
namespace {

const Eigen::Vector3d kRoomLow(-2, -1.5, -1), kRoomHigh(3, 1.5, 1.6);

// Of a ray with the wall that it meets at a point.
double cosine_in_room(const Eigen::Vector3d& point, const Eigen::Vector3d& ray) {
  int axis = 0;
  (point - kRoomLow).cwiseAbs().cwiseMin((point - kRoomHigh).cwiseAbs()).minCoeff(&axis);
  return std::abs(ray[axis]) / ray.norm();
}

// The sensor stands in a box room, where surfaces at all slants and ranges are planes.
View room_view(const Sensor& sensor, const NoiseModel& noise, unsigned seed, const Eigen::Vector3d& target) {
  View view;
  view.name = "room";
  view.sensor = sensor;
  view.range = RangeImage(width(sensor), height(sensor));
  const Eigen::Isometry3d T = std::holds_alternative<SphericalSensor>(sensor) ? Eigen::Isometry3d::Identity()
                                                                              : test::look_at({-1.5, 0, 0}, target);
  const auto room = test::box_room(kRoomLow, kRoomHigh);
  std::mt19937 rng(seed);
  std::normal_distribution<double> normal(0, 1);
  for (int v = 0; v < view.range.height; ++v)
    for (int u = 0; u < view.range.width; ++u) {
      // r is proportional to distance for a central sensor, and distance less a constant for parallel rays.
      const Eigen::Vector3d at_one = unproject(sensor, u, v, 1), ray = ray_direction(sensor, u, v);
      const double t = *room(T * at_one, T.linear() * ray);
      const double r =
          1 + t * (unproject(sensor, u, v, 2) - at_one).norm() / (unproject(sensor, u, v, 2) - at_one).squaredNorm();
      view.range.at(u, v) =
          float(r + normal(rng) * noise.sigma(r, cosine_in_room(T * (t * ray + at_one), T.linear() * ray)));
    }
  return view;
}

void expect_recovered(const NoiseModel& found, const NoiseModel& truth, double from, double to, double off = 0.1) {
  for (double r = from; r <= to; r += 0.02 * (to - from))
    EXPECT_NEAR(found.sigma(r) / truth.sigma(r), 1, off) << "range " << r;
}

NoiseModel estimate(const std::vector<View>& views, int threads = 2) {
  Context context(threads);
  std::vector<const View*> pointers;
  for (const View& v : views) pointers.push_back(&v);
  return estimate_noise(pointers, context);
}

TEST(EstimateNoise, PinholeRoom) {
  const PinholeSensor sensor{640, 480, 525, 525, 319.5, 239.5, {}};
  for (const NoiseModel& truth :
       {NoiseModel{0.002, 0, 0, 0}, NoiseModel{0.0005, 0, 0.0019, 0}, NoiseModel{0, 0.002, 0, 0}})
    expect_recovered(estimate({room_view(sensor, truth, 1, {1, 0.4, -0.3}), room_view(sensor, truth, 2, {0, -1, 0.5})}),
                     truth, 1.3, 4.6);
}

TEST(EstimateNoise, PointingMakesSlantedWallsRougher) {
  const auto scanner = SphericalSensor::from_limits(1000, 450, -std::numbers::pi, std::numbers::pi, 1.5, -1.0);
  const PinholeSensor camera{640, 480, 525, 525, 319.5, 239.5, {}};
  for (const Sensor& sensor : {Sensor(scanner), Sensor(camera)}) {
    const NoiseModel truth{.s0_m = 0.001, .pointing_rad = 0.0008};
    const NoiseModel found =
        estimate({room_view(sensor, truth, 1, {1, 0.4, -0.3}), room_view(sensor, truth, 2, {0, -1, 0.5})});
    EXPECT_NEAR(found.pointing_rad / truth.pointing_rad, 1, 0.15) << kind_name(sensor);
    expect_recovered(found, truth, 1.3, 3.2);
    // Without, the same walls say nothing of the kind.
    const NoiseModel none = estimate({room_view(sensor, {.s0_m = 0.001}, 1, {1, 0.4, -0.3})});
    EXPECT_EQ(none.pointing_rad, 0) << kind_name(sensor);
  }
}

// Every wall in patches of eight intensities, and their noise.
View with_intensities(View view, const NoiseModel& noise, unsigned seed) {
  std::mt19937 rng(seed);
  std::normal_distribution<double> normal(0, 1);
  view.intensity = Image<std::uint8_t>(view.range.width, view.range.height);
  for (int v = 0; v < view.range.height; ++v)
    for (int u = 0; u < view.range.width; ++u) {
      view.intensity.at(u, v) = std::uint8_t(20 + 30 * (((u + 31 * int(seed)) / 50 + v / 45) % 8));
      float& r = view.range.at(u, v);
      r += float(normal(rng) * noise.intensity_factor(view.intensity.at(u, v)) * noise.sigma(double(r)));
    }
  return view;
}

TEST(EstimateNoise, DarkSurfacesAreRougherWhereIntensitiesSaySo) {
  const auto scanner = SphericalSensor::from_limits(1000, 450, -std::numbers::pi, std::numbers::pi, 1.5, -1.0);
  const NoiseModel truth{.s0_m = 0.002, .intensity_power = 0.6, .intensity_reference = 100}, none{};
  const View clean = room_view(scanner, none, 1, {});
  const NoiseModel found = estimate({with_intensities(clean, truth, 2), with_intensities(clean, truth, 3),
                                     with_intensities(clean, truth, 4), with_intensities(clean, truth, 5)});
  EXPECT_NEAR(found.intensity_power, 0.6, 0.06);
  for (const std::uint8_t intensity : {20, 60, 110, 230})
    EXPECT_NEAR(
        found.sigma(2, 1, found.intensity_factor(intensity)) / truth.sigma(2, 1, truth.intensity_factor(intensity)), 1,
        0.1)
        << int(intensity);
  EXPECT_EQ(estimate({with_intensities(clean, {.s0_m = 0.002}, 3)}).intensity_power, 0);
}

TEST(NoiseModel, IntensityCountsWithinLimits) {
  const NoiseModel noise{.s0_m = 0.002, .intensity_power = 1, .intensity_reference = 100};
  EXPECT_DOUBLE_EQ(noise.intensity_factor(50), 2);
  EXPECT_DOUBLE_EQ(noise.intensity_factor(0), NoiseModel::kLargestFactor);
  EXPECT_DOUBLE_EQ(NoiseModel{.s0_m = 0.002}.intensity_factor(3), 1);
  EXPECT_LE(noise.sigma_across(2, 1, noise.intensity_factor(1)), noise.largest_across(2));
}

TEST(NoiseModel, IncidenceCountsByItsTangent) {
  const NoiseModel noise{.s0_m = 0.002, .pointing_rad = 0.001};
  EXPECT_DOUBLE_EQ(noise.sigma(3, 1), 0.002);
  // At 45° the range is off by what the ray is off by sideways: 3 mm.
  EXPECT_NEAR(noise.sigma(3, std::sqrt(0.5)), std::hypot(0.002, 0.003), 1e-12);
  for (const double cosine : {0.05, 0.3, 0.7, 1.0}) {
    EXPECT_NEAR(noise.sigma_across(3, cosine), cosine * noise.sigma(3, cosine), 1e-12);
    EXPECT_LE(noise.sigma_across(3, cosine), noise.largest_across(3));
  }
  EXPECT_DOUBLE_EQ(noise.scaled(2).sigma(3, 0.5), 2 * noise.sigma(3, 0.5));
}

TEST(EstimateNoise, DistortedPinhole) {
  const PinholeSensor sensor{640, 480, 525, 525, 319.5, 239.5, {-0.25, 0.08, 0.001, 0, 0}};
  const NoiseModel truth{0.0004, 0, 0.0003, 0};
  expect_recovered(estimate({room_view(sensor, truth, 1, {1, 0.4, -0.3})}), truth, 1.3, 4.5);
}

TEST(EstimateNoise, SphericalRoom) {
  const auto sensor = SphericalSensor::from_limits(1000, 450, -std::numbers::pi, std::numbers::pi, 1.5, -1.0);
  for (const NoiseModel& truth : {NoiseModel{0.0005, 0, 0, 0}, NoiseModel{0.0003, 0.0005, 0, 0}})
    expect_recovered(estimate({room_view(sensor, truth, 3, {})}), truth, 1.2, 3.2);
}

TEST(EstimateNoise, ParallelRays) {
  const OrthographicSensor sensor{320, 240, 0.001, 0.001, 159.5, 119.5};
  const NoiseModel truth{0.0001, 0, 0, 0};
  // Looks into a corner: three slanted planes.
  expect_recovered(estimate({room_view(sensor, truth, 4, {3, 0.3, -0.2})}), truth, 4.49, 4.53);
}

TEST(EstimateNoise, CurvatureIsNotNoise) {
  // A sphere of 30 samples' radius bends by more than the noise from sample to sample.
  const OrthographicSensor sensor{200, 200, 0.002, 0.002, 99.5, 99.5};
  View view;
  view.sensor = sensor;
  view.range = RangeImage(200, 200);
  std::mt19937 rng(8);
  std::normal_distribution<double> normal(0, 2e-5);
  for (int v = 0; v < 200; ++v)
    for (int u = 0; u < 200; ++u) {
      const double x = (u % 67 - 33) * 0.002, y = (v % 67 - 33) * 0.002, square = 0.06 * 0.06 - x * x - y * y;
      if (square > 0) view.range.at(u, v) = float(0.3 - std::sqrt(square) + normal(rng));
    }
  const NoiseModel found = estimate({view});
  // Bending alone, seen by one step of the filter, is a sagitta of 2·h²/(2R)·… ≈ 3e-5 and more towards the rim.
  EXPECT_NEAR(found.sigma(0.25) / 2e-5, 1, 0.25);
}

TEST(EstimateNoise, StepsAndHolesAreOutvoted) {
  const PinholeSensor sensor{640, 480, 525, 525, 319.5, 239.5, {}};
  const NoiseModel truth{0.001, 0, 0.001, 0};
  View view = room_view(sensor, truth, 5, {1, 0.4, -0.3});
  for (int v = 0; v < 480; ++v)
    for (int u = 0; u < 640; ++u) {
      if ((u / 40 + v / 40) % 5 == 0) view.range.at(u, v) *= 0.8f;
      if ((u / 30) % 7 == 0 && (v / 30) % 3 == 0) view.range.at(u, v) = kInvalidRange;
    }
  // A fifth of the image stands out, so that one filtered value in three has an edge in it.
  expect_recovered(estimate({view}), truth, 1.3, 4.5, 0.2);
}

TEST(EstimateNoise, RoundingSetsTheFloor) {
  // 1 mm steps on surfaces without noise: triples of samples often agree to the step, and would show no noise at all.
  const PinholeSensor sensor{640, 480, 525, 525, 319.5, 239.5, {}};
  View view = room_view(sensor, {0, 0, 0, 0}, 1, {1, 0.4, -0.3});
  for (float& r : view.range.pixels) r = std::round(r * 1000) / 1000;
  const NoiseModel found = estimate({view});
  EXPECT_NEAR(found.floor_m, 0.001 / std::sqrt(12.0), 2e-5);
  for (const double r : {1.0, 2.0, 4.0}) {
    EXPECT_GE(found.sigma(r), 0.00028);
    EXPECT_LE(found.sigma(r), 0.00045);
  }
  EXPECT_GT(found.correlation, 1.2);
  EXPECT_LE(found.correlation, 4);
}

TEST(EstimateNoise, RoundingBelowTheNoiseLeavesNeighborsIndependent) {
  const PinholeSensor sensor{640, 480, 525, 525, 319.5, 239.5, {}};
  View view = room_view(sensor, {0.002, 0, 0, 0}, 1, {1, 0.4, -0.3});
  EXPECT_EQ(estimate({view}).correlation, 1);
  for (float& r : view.range.pixels) r = std::round(r * 1000) / 1000;
  EXPECT_EQ(estimate({view}).correlation, 1);
}

TEST(EstimateNoise, NoNoiseIsTinyButPositive) {
  const PinholeSensor sensor{640, 480, 525, 525, 319.5, 239.5, {}};
  const NoiseModel found = estimate({room_view(sensor, {0, 0, 0, 0}, 1, {1, 0.4, -0.3})});
  for (const double r : {0.0, 0.5, 2.0, 10.0}) {
    EXPECT_GT(found.sigma(r), 0);
    EXPECT_LT(found.sigma(r), 1e-5);
  }
}

TEST(EstimateNoise, SameForAnyNumberOfThreads) {
  const PinholeSensor sensor{160, 120, 130, 130, 79.5, 59.5, {}};
  std::vector<View> views;
  for (unsigned i = 0; i < 7; ++i) views.push_back(room_view(sensor, {0.001, 0, 0.001, 0}, i, {1, 0.1 * i, 0}));
  const NoiseModel one = estimate(views, 1);
  for (const int threads : {2, 3, 8}) {
    const NoiseModel other = estimate(views, threads);
    EXPECT_EQ(one.s0_m, other.s0_m);
    EXPECT_EQ(one.s1, other.s1);
    EXPECT_EQ(one.s2_per_m, other.s2_per_m);
    EXPECT_EQ(one.floor_m, other.floor_m);
    EXPECT_EQ(one.correlation, other.correlation);
  }
}

TEST(EstimateNoise, FewSamplesGiveACautiousGuess) {
  View view;
  view.sensor = PinholeSensor{8, 8, 10, 10, 3.5, 3.5, {}};
  view.range = RangeImage(8, 8);
  view.range.at(3, 3) = 2;
  const NoiseModel found = estimate({view});
  EXPECT_GT(found.sigma(2), 0.002);
  EXPECT_LT(found.sigma(2), 0.05);
}

TEST(EstimateNoise, RefusesNothing) {
  EXPECT_THROW(estimate({}), InvalidInput);
  View empty;
  empty.sensor = PinholeSensor{8, 8, 10, 10, 3.5, 3.5, {}};
  empty.range = RangeImage(8, 8);
  EXPECT_THROW(estimate({empty}), InvalidInput);
}

}  // namespace
}  // namespace lapseam
