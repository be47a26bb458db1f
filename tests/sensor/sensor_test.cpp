#include "lapseam/sensor.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <limits>
#include <numbers>
#include <random>
#include <vector>

#include "sensor/crowding.h"

namespace lapseam {
namespace {

constexpr double kPi = std::numbers::pi;
constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

// unproject -> project gives the pixel back; project -> unproject gives the point back.
template <typename S>
void expect_inverse_at(const S& sensor, double u, double v, double r) {
  const Eigen::Vector3d p = sensor.unproject(u, v, r);
  PixelRange out;
  ASSERT_TRUE(sensor.project(p, out)) << "u " << u << " v " << v << " r " << r;
  // On a full circle the image's left and right edge are one.
  const double turn = wraps(Sensor(sensor)) ? width(Sensor(sensor)) : 1e300;
  EXPECT_NEAR(std::remainder(out.u - u, turn), 0, 1e-8);
  EXPECT_NEAR(out.v, v, 1e-8);
  EXPECT_NEAR(out.r, r, 1e-12 * r);
  EXPECT_LT((sensor.unproject(out.u, out.v, out.r) - p).norm(), 1e-12 * p.norm());
}

template <typename S>
void expect_inverse(const S& sensor, double far_m) {
  const double w = width(Sensor(sensor)), h = height(Sensor(sensor));
  for (const double u : {-0.5, 0.0, w - 1, w - 0.5})
    for (const double v : {-0.5, 0.0, h - 1, h - 0.5}) {
      expect_inverse_at(sensor, u, v, 0.01);
      expect_inverse_at(sensor, u, v, far_m);
    }
  std::mt19937 rng(7);
  std::uniform_real_distribution<double> unit(0, 1);
  for (int i = 0; i < 2000; ++i)
    expect_inverse_at(sensor, unit(rng) * w - 0.5, unit(rng) * h - 0.5, 0.01 + unit(rng) * far_m);
}

TEST(Pinhole, IsInvertible) { expect_inverse(PinholeSensor{640, 480, 525, 530, 319.5, 241.25, {}}, 10); }

TEST(Pinhole, WithDistortionIsInvertible) {
  expect_inverse(PinholeSensor{640, 480, 525, 530, 319.5, 241.25, {-0.28, 0.09, 0.001, -0.0007, -0.012}}, 10);
  expect_inverse(PinholeSensor{640, 480, 525, 525, 300, 250, {0.26, -0.95, -0.005, 0.0026, 1.16}}, 10);
  expect_inverse(PinholeSensor{1920, 1080, 900, 900, 959, 539, {-0.10, 0.01, 0, 0, 0}}, 10);
}

TEST(Pinhole, DistortionIsBrowns) {
  // Worked by hand: x = 0.4, y = -0.2, r² = 0.2, radial = 1 − 0.3·0.2 + 0.1·0.04 + 0.05·0.008 = 0.9444.
  BrownDistortion d{-0.3, 0.1, 0.01, -0.02, 0.05};
  double x = 0.4, y = -0.2;
  ASSERT_TRUE(d.distort(x, y));
  EXPECT_NEAR(x, 0.4 * 0.9444 + 2 * 0.01 * 0.4 * -0.2 + -0.02 * (0.2 + 2 * 0.16), 1e-15);
  EXPECT_NEAR(y, -0.2 * 0.9444 + 0.01 * (0.2 + 2 * 0.04) + 2 * -0.02 * 0.4 * -0.2, 1e-15);
}

TEST(Pinhole, RejectsFoldedDistortion) {
  // r·(1 − 0.5 r²) turns back at r² = 2/3.
  const PinholeSensor sensor{100, 100, 50, 50, 50, 50, {-0.5, 0, 0, 0, 0}};
  PixelRange out;
  EXPECT_TRUE(sensor.project({0.8, 0, 1}, out));
  EXPECT_FALSE(sensor.project({0.83, 0, 1}, out));
  EXPECT_FALSE(sensor.project({5, 5, 1}, out));
}

TEST(Pinhole, RejectsPointsBeyondAFoldWhereTheRadiusGrowsAgain) {
  // 1 − 3 s + 5·0.4 s² is negative between s = 0.5 and s = 1.
  const PinholeSensor sensor{100, 100, 50, 50, 50, 50, {-1, 0.4, 0, 0, 0}};
  PixelRange out;
  EXPECT_TRUE(sensor.project({0.69, 0, 1}, out));
  EXPECT_FALSE(sensor.project({0.9, 0, 1}, out));
  EXPECT_FALSE(sensor.project({1.2, 0, 1}, out));
}

TEST(Pinhole, PixelsThatNoRayReachesStayFinite) {
  const PinholeSensor sensor{2000, 2000, 50, 50, 1000, 1000, {-0.5, 0, 0, 0, 0}};
  for (const double u : {0.0, 500.0, 1999.0}) EXPECT_TRUE(sensor.unproject(u, 3, 1).allFinite());
}

TEST(Pinhole, RejectsPointsBehind) {
  const PinholeSensor sensor{64, 48, 50, 50, 31.5, 23.5, {}};
  PixelRange out;
  EXPECT_FALSE(sensor.project({0.1, 0.1, 0}, out));
  EXPECT_FALSE(sensor.project({0.1, 0.1, -1}, out));
  EXPECT_FALSE(sensor.project({kNan, 0.1, 1}, out));
  EXPECT_FALSE(sensor.project({0.1, 0.1, kNan}, out));
}

TEST(Orthographic, IsInvertible) {
  const OrthographicSensor sensor{320, 200, 0.001, 0.0005, 159.5, 99.5};
  expect_inverse(sensor, 2);
  PixelRange out;
  EXPECT_FALSE(sensor.project({0, 0, 0}, out));
}

std::vector<double> irregular_table(int n, double begin, double end, unsigned seed) {
  std::mt19937 rng(seed);
  std::uniform_real_distribution<double> step(0.2, 1.8);
  std::vector<double> table(1, 0.0);
  for (int i = 1; i < n; ++i) table.push_back(table.back() + step(rng));
  const double last = table.back();
  for (double& a : table) a = begin + a / last * (end - begin);
  return table;
}

TEST(Spherical, WithLimitsIsInvertible) {
  expect_inverse(SphericalSensor::from_limits(200, 100, -1.0, 1.2, 0.7, -0.9), 50);
  expect_inverse(SphericalSensor::from_limits(200, 100, 3.5, 2.2, -0.7, 0.9), 50);
}

TEST(Spherical, WithTablesIsInvertible) {
  // Azimuth and elevation, rising and falling, through the discontinuity of atan2.
  expect_inverse(SphericalSensor{irregular_table(90, 2.5, 4.5, 1), irregular_table(50, -1.0, 0.8, 2)}, 50);
  expect_inverse(SphericalSensor{irregular_table(90, -2.0, -4.5, 3), irregular_table(50, 0.9, -1.1, 4)}, 50);
  // One dense end: an even first guess is far off.
  std::vector<double> skewed;
  for (int i = 0; i < 300; ++i) skewed.push_back(1e-6 + 2.0 * std::pow(i / 299.0, 6) + 1e-5 * i);
  expect_inverse(SphericalSensor{skewed, {0.1, 0.0, -0.1}}, 50);
}

TEST(Spherical, TableEntriesAreExact) {
  const SphericalSensor sensor{irregular_table(90, 2.5, 4.5, 1), irregular_table(50, 1.0, -0.8, 2)};
  for (int u = 0; u < sensor.columns(); u += 7)
    for (int v = 0; v < sensor.rows(); v += 7) {
      const double az = sensor.azimuth_rad[std::size_t(u)], el = sensor.elevation_rad[std::size_t(v)];
      const Eigen::Vector3d expected(std::cos(el) * std::cos(az), std::cos(el) * std::sin(az), std::sin(el));
      EXPECT_LT((sensor.unproject(u, v, 3.0) - 3.0 * expected).norm(), 1e-14);
    }
}

TEST(Spherical, FullCircleWraps) {
  const auto full = SphericalSensor::from_limits(2000, 100, -kPi, kPi, 0.7, -0.9);
  EXPECT_TRUE(full.wraps());
  expect_inverse(full, 50);
  const auto falling = SphericalSensor::from_limits(500, 100, 2 * kPi, 0, 0.7, -0.9);
  EXPECT_TRUE(falling.wraps());
  expect_inverse(falling, 50);
  EXPECT_FALSE(SphericalSensor::from_limits(500, 100, -kPi, kPi - 0.05, 0.7, -0.9).wraps());
  EXPECT_FALSE(SphericalSensor::from_limits(1, 100, -kPi, kPi, 0.7, -0.9).wraps());
}

TEST(Spherical, EveryDirectionOfAFullCircleHasAPixel) {
  // The gap between last and first column is 1.4 steps: still a circle, and no direction falls through.
  std::vector<double> azimuth;
  for (int i = 0; i < 100; ++i) azimuth.push_back(0.3 + i * 2 * kPi / 100.4);
  const SphericalSensor sensor{azimuth, {0.5, 0.0, -0.5}};
  ASSERT_TRUE(sensor.wraps());
  for (int i = 0; i < 5000; ++i) {
    const double a = i * 2 * kPi / 5000;
    PixelRange out;
    const Eigen::Vector3d p(2 * std::cos(a), 2 * std::sin(a), 0.1);
    ASSERT_TRUE(sensor.project(p, out)) << a;
    EXPECT_GE(out.u, -0.5 - 1e-9);
    EXPECT_LE(out.u, 99.5 + 1e-9);
    EXPECT_LT((sensor.unproject(out.u, out.v, out.r) - p).norm(), 1e-12);
  }
}

TEST(Spherical, RejectsWhatIsOutsideTheTable) {
  const auto sensor = SphericalSensor::from_limits(200, 100, -1.0, 1.0, 0.7, -0.7);
  PixelRange out;
  EXPECT_FALSE(sensor.project({0, 0, 0}, out));
  EXPECT_FALSE(sensor.project({-1, 0, 0}, out));
  EXPECT_FALSE(sensor.project({std::cos(1.001), std::sin(1.001), 0}, out));
  EXPECT_TRUE(sensor.project({std::cos(0.999), std::sin(0.999), 0}, out));
  EXPECT_FALSE(sensor.project({0, 0, 1}, out));
  EXPECT_FALSE(sensor.project({kNan, 0, 1}, out));
}

TEST(AnySensor, HandednessIsTheSignOfColumnsRowsAndRay) {
  const std::vector<Sensor> sensors = {
      PinholeSensor{64, 48, 50, 50, 31.5, 23.5, {}},          PinholeSensor{64, 48, -50, 50, 31.5, 23.5, {}},
      OrthographicSensor{64, 48, 0.01, 0.01, 31.5, 23.5},     OrthographicSensor{64, 48, 0.01, -0.01, 31.5, 23.5},
      SphericalSensor::from_limits(64, 48, -1, 1, 0.5, -0.5), SphericalSensor::from_limits(64, 48, 1, -1, 0.5, -0.5),
      SphericalSensor::from_limits(64, 48, -1, 1, -0.5, 0.5),
  };
  const std::vector<int> expected = {1, -1, 1, -1, -1, 1, 1};
  for (std::size_t i = 0; i < sensors.size(); ++i) {
    const Eigen::Vector3d p = unproject(sensors[i], 30, 20, 2);
    const Eigen::Vector3d along_u = unproject(sensors[i], 31, 20, 2) - p,
                          along_v = unproject(sensors[i], 30, 21, 2) - p;
    EXPECT_EQ(handedness(sensors[i]), along_u.cross(along_v).dot(ray_direction(sensors[i], 30, 20)) > 0 ? 1 : -1) << i;
    EXPECT_EQ(handedness(sensors[i]), expected[i]) << i;
  }
}

TEST(AnySensor, RayDirectionIsUnitAndLeadsAway) {
  const std::vector<Sensor> sensors = {PinholeSensor{64, 48, 50, 50, 31.5, 23.5, {0.1, 0, 0, 0, 0}},
                                       OrthographicSensor{64, 48, 0.01, 0.01, 31.5, 23.5},
                                       SphericalSensor::from_limits(64, 48, -1, 1, 0.5, -0.5)};
  for (const Sensor& sensor : sensors)
    for (const double u : {0.0, 20.0, 63.0}) {
      const Eigen::Vector3d d = ray_direction(sensor, u, 11);
      EXPECT_NEAR(d.norm(), 1, 1e-14);
      EXPECT_GT(d.dot(unproject(sensor, u, 11, 5) - unproject(sensor, u, 11, 1)), 0);
    }
}

TEST(AnySensor, SampleSpacing) {
  EXPECT_NEAR(sample_spacing(PinholeSensor{64, 48, 50, 100, 31.5, 23.5, {}}, 31.5, 23.5, 2.0), 2 / std::sqrt(5000),
              1e-9);
  EXPECT_NEAR(sample_spacing(OrthographicSensor{64, 48, 0.01, 0.04, 31.5, 23.5}, 3, 4, 2.0), 0.02, 1e-12);
  const auto spherical = SphericalSensor::from_limits(1000, 500, -kPi, kPi, kPi / 2, -kPi / 2);
  EXPECT_NEAR(sample_spacing(spherical, 500, 249.5, 3), 3 * kPi / 500, 1e-6);
}

TEST(AnySensor, GenericAccess) {
  const Sensor sensor = SphericalSensor::from_limits(64, 48, -1, 1, 0.5, -0.5);
  EXPECT_EQ(width(sensor), 64);
  EXPECT_EQ(height(sensor), 48);
  EXPECT_EQ(kind_name(sensor), "spherical");
  EXPECT_FALSE(wraps(sensor));
  const auto back = project(sensor, unproject(sensor, 12.25, 40.5, 3));
  ASSERT_TRUE(back);
  EXPECT_NEAR(back->u, 12.25, 1e-9);
  EXPECT_FALSE(project(sensor, {-1, 0, 0}));
}

TEST(Sensor, SamplesCrowdTowardsPoles) {
  const Sensor scanner = SphericalSensor::from_limits(2000, 1000, -kPi, kPi, kPi / 2, -kPi / 2);
  EXPECT_EQ(samples_per_row_step(scanner, 500), 1);
  EXPECT_NEAR(samples_per_row_step(scanner, 166), 2, 1);  // 60°
  EXPECT_NEAR(samples_per_row_step(scanner, 50), 6, 1);   // 81°
  EXPECT_GT(samples_per_row_step(scanner, 0), 600);
  EXPECT_GT(samples_per_row_step(scanner, 999), 600);
  EXPECT_LE(samples_per_row_step(scanner, 999), 2000);
  EXPECT_EQ(samples_per_row_step(PinholeSensor{640, 480, 500, 500, 320, 240, {}}, 0), 1);
}

}  // namespace
}  // namespace lapseam
