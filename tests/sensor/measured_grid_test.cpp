#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <functional>
#include <limits>
#include <numbers>
#include <random>

#include "lapseam/error.h"
#include "lapseam/sensor.h"

namespace lapseam {
namespace {

constexpr int kWidth = 120, kHeight = 90;
constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
const Eigen::Vector3d kMissing(kNan, 0, 0);

// Where the ray of pixel (u, v) is at depth z.
using PointAt = std::function<Eigen::Vector3d(double u, double v, double z)>;

Eigen::Vector3d pinhole_point(double u, double v, double z) { return {(u - 59.5) / 100 * z, (v - 44.5) / 100 * z, z}; }
// Parallel in x, through a line at z = 0 in y: what a laser line swept sideways gives.
Eigen::Vector3d pushbroom_point(double u, double v, double z) { return {(u - 59.5) * 0.0005, (v - 44.5) / 900 * z, z}; }
Eigen::Vector3d interlaced_point(double u, double v, double z) {
  // Staggered rows, as the Cyberware scanner of the Stanford models delivers them.
  const double shift = 0.25 * std::cos(std::numbers::pi * v);
  return pushbroom_point(u + shift, v, z);
}
Eigen::Vector3d parallel_point(double u, double v, double z) { return {u * 0.001, v * 0.002, z}; }

double bumpy_depth(int u, int v) { return 1.0 + 0.08 * std::sin(u * 0.11) * std::cos(v * 0.07) + 0.0004 * u; }

struct Scan {
  std::vector<Eigen::Vector3d> points;
  MeasuredGrid grid;
};

// A bumpy surface with a step and, if asked for, holes; placed anywhere.
Scan scan(const PointAt& point_at, bool has_holes, const Eigen::Isometry3d& T_sensor_scan) {
  std::mt19937 rng(3);
  std::uniform_real_distribution<double> unit(0, 1);
  Scan out;
  for (int v = 0; v < kHeight; ++v)
    for (int u = 0; u < kWidth; ++u) {
      const double z = bumpy_depth(u, v) + (u > 70 && v > 40 ? 0.15 : 0.0);
      const bool is_hole = has_holes && (std::hypot(u - 40, v - 30) < 12 || unit(rng) < 0.1);
      out.points.push_back(is_hole ? kMissing : T_sensor_scan * point_at(u, v, z));
    }
  out.grid = fit_measured_grid(kWidth, kHeight, out.points, T_sensor_scan.linear() * Eigen::Vector3d(0.3, -0.2, 1));
  return out;
}

Eigen::Isometry3d some_pose() {
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.rotate(Eigen::AngleAxisd(1.1, Eigen::Vector3d(1, -2, 0.5).normalized()));
  T.pretranslate(Eigen::Vector3d(0.3, -4, 2));
  return T;
}

void expect_exact_at_samples(const Scan& scan) {
  std::size_t samples = 0;
  for (std::size_t i = 0; i < scan.points.size(); ++i) {
    const float r = scan.grid.range.pixels[i];
    ASSERT_EQ(r > 0, scan.points[i].allFinite());
    if (!(r > 0)) continue;
    ++samples;
    PixelRange out;
    ASSERT_TRUE(scan.grid.sensor.project(scan.points[i], out)) << i;
    EXPECT_NEAR(out.u, double(i % kWidth), 1e-6);
    EXPECT_NEAR(out.v, double(i / kWidth), 1e-6);
    // The range image is single precision.
    EXPECT_NEAR(out.r, double(r), 1e-7 * out.r);
    EXPECT_LT((scan.grid.sensor.unproject(out.u, out.v, out.r) - scan.points[i]).norm(), 1e-9);
  }
  EXPECT_GT(samples, scan.points.size() / 2);
}

// Everywhere, not only at samples: a pixel's ray leads back to it.
void expect_invertible(const MeasuredGridSensor& sensor, float r_min, float r_max) {
  std::mt19937 rng(11);
  std::uniform_real_distribution<double> unit(0, 1);
  for (int i = 0; i < 3000; ++i) {
    const double u = unit(rng) * kWidth - 0.5, v = unit(rng) * kHeight - 0.5;
    const double r = double(r_min) + unit(rng) * double(r_max - r_min);
    PixelRange out;
    ASSERT_TRUE(sensor.project(sensor.unproject(u, v, r), out)) << u << ' ' << v;
    EXPECT_NEAR(out.u, u, 1e-8);
    EXPECT_NEAR(out.v, v, 1e-8);
    EXPECT_NEAR(out.r, r, 1e-10);
  }
}

void expect_good(const PointAt& point_at, bool has_holes) {
  const Eigen::Isometry3d T = some_pose();
  const Scan s = scan(point_at, has_holes, T);
  expect_exact_at_samples(s);
  expect_invertible(s.grid.sensor, 0.05f, 0.6f);
  // The rays are the scanner's: a point far from every sample still falls into the right pixel.
  for (int v = 0; v < kHeight; v += 6)
    for (int u = 0; u < kWidth; u += 7)
      for (const double z : {0.9, 1.5}) {
        PixelRange out;
        ASSERT_TRUE(s.grid.sensor.project(T * point_at(u, v, z), out));
        // In a hole the rows' stagger of ±0.25 is unknown, and next to it half of it may be lost.
        EXPECT_NEAR(out.u, u, has_holes ? 0.5 : 0.02);
        EXPECT_NEAR(out.v, v, 0.02);
      }
  EXPECT_GT(s.grid.sensor.forward.dot(T.linear() * Eigen::Vector3d::UnitZ()), 0.99);
  EXPECT_EQ(handedness(s.grid.sensor), 1);
}

TEST(MeasuredGrid, Pinhole) {
  expect_good(pinhole_point, false);
  EXPECT_LT(scan(pinhole_point, false, some_pose()).grid.sensor.fit_rms_px, 1e-6);
}
TEST(MeasuredGrid, Pushbroom) {
  expect_good(pushbroom_point, false);
  EXPECT_LT(scan(pushbroom_point, false, some_pose()).grid.sensor.fit_rms_px, 1e-6);
}
TEST(MeasuredGrid, ParallelRays) {
  expect_good(parallel_point, false);
  const MeasuredGridSensor sensor = scan(parallel_point, false, Eigen::Isometry3d::Identity()).grid.sensor;
  EXPECT_LT(sensor.fit_rms_px, 1e-6);
  EXPECT_TRUE(sensor.rational[1].head<3>().isZero());  // no perspective made up
  EXPECT_TRUE(sensor.rational[3].head<3>().isZero());
  EXPECT_NEAR(sample_spacing(sensor, 60, 45, 0.4), 0.001 * std::sqrt(2), 1e-8);
}
TEST(MeasuredGrid, InterlacedWithHoles) {
  expect_good(interlaced_point, true);
  EXPECT_NEAR(scan(interlaced_point, true, some_pose()).grid.sensor.fit_rms_px, 0.25, 0.01);
}

TEST(MeasuredGrid, AnglesOfAPolarScannerAreAWarp) {
  // Equal angles, 80 degrees wide: not of the fitted kind, so the warp has to be large.
  const PointAt polar = [](double u, double v, double z) {
    const double az = (u - 59.5) * 1.4 / kWidth, el = (v - 44.5) * 0.7 / kHeight;
    return Eigen::Vector3d(z * std::sin(az) * std::cos(el), z * std::sin(el), z * std::cos(az) * std::cos(el));
  };
  const Scan s = scan(polar, false, Eigen::Isometry3d::Identity());
  EXPECT_GT(s.grid.sensor.fit_rms_px, 0.3);
  EXPECT_LT(s.grid.sensor.fit_rms_px, 3.0);
  expect_exact_at_samples(s);
  expect_invertible(s.grid.sensor, 0.3f, 0.8f);
}

TEST(MeasuredGrid, JitteredRaysStayExactAtSamples) {
  std::mt19937 rng(5);
  std::normal_distribution<double> jitter(0, 0.08);
  const Scan s = scan([&](double u, double v, double z) { return pinhole_point(u + jitter(rng), v + jitter(rng), z); },
                      false, some_pose());
  expect_exact_at_samples(s);
  EXPECT_NEAR(s.grid.sensor.fit_rms_px, 0.08 * std::sqrt(2), 0.01);
}

TEST(MeasuredGrid, ShallowScanKeepsParallelRays) {
  // 1 mm of relief seen from 10 m, rounded as in a text file: perspective is there but cannot be told.
  std::vector<Eigen::Vector3d> points;
  const auto rounded = [](double x) { return std::round(x * 1e5) / 1e5; };
  for (int v = 0; v < kHeight; ++v)
    for (int u = 0; u < kWidth; ++u)
      points.emplace_back(rounded(u * 0.0005), rounded(v * 0.0005), rounded(bumpy_depth(u, v) * 0.01));
  const MeasuredGridSensor sensor = fit_measured_grid(kWidth, kHeight, points, Eigen::Vector3d::UnitZ()).sensor;
  EXPECT_GT(sensor.forward.z(), 0.9999);
  for (const double u : {0.0, 119.0}) EXPECT_GT(ray_direction(sensor, u, 45).z(), 0.999);
}

TEST(MeasuredGrid, RangeIsPositiveAndGrowsAlongTheRays) {
  for (const PointAt& point_at : {PointAt(pinhole_point), PointAt(pushbroom_point), PointAt(parallel_point)}) {
    const Scan s = scan(point_at, false, some_pose());
    for (const float r : s.grid.range.pixels) ASSERT_GT(r, 0.0f);
    EXPECT_GT((some_pose().linear().transpose() * ray_direction(s.grid.sensor, 60, 45)).z(), 0.9);
  }
}

TEST(MeasuredGrid, MirroredGridIsLeftHanded) {
  const Scan s =
      scan([](double u, double v, double z) { return pinhole_point(kWidth - 1 - u, v, z); }, false, some_pose());
  EXPECT_EQ(handedness(s.grid.sensor), -1);
}

TEST(MeasuredGrid, RejectsPointsBehindTheSensor) {
  const Scan s = scan(pinhole_point, false, Eigen::Isometry3d::Identity());
  PixelRange out;
  EXPECT_FALSE(s.grid.sensor.project({0, 0, -1}, out));
  EXPECT_FALSE(s.grid.sensor.project({0.1, 0.1, -0.01}, out));
  EXPECT_FALSE(s.grid.sensor.project({kNan, 0, 1}, out));
}

TEST(MeasuredGrid, RejectsDegenerateSamples) {
  const auto fit = [](const std::function<Eigen::Vector3d(int, int)>& make) {
    std::vector<Eigen::Vector3d> points;
    for (int v = 0; v < 20; ++v)
      for (int u = 0; u < 30; ++u) points.push_back(make(u, v));
    return fit_measured_grid(30, 20, points, Eigen::Vector3d::UnitZ());
  };
  const auto bumpy = [](int u, int v) { return Eigen::Vector3d(u * 0.01, v * 0.01, bumpy_depth(u * 4, v * 4)); };
  EXPECT_NO_THROW(fit(bumpy));
  EXPECT_THROW(fit([](int, int) { return kMissing; }), InvalidInput);
  EXPECT_THROW(fit([&](int u, int v) { return u < 5 && v < 3 ? bumpy(u, v) : kMissing; }), InvalidInput);
  EXPECT_NO_THROW(fit([&](int u, int v) { return u < 4 && v < 4 ? bumpy(u, v) : kMissing; }));
  EXPECT_THROW(fit([](int, int) { return Eigen::Vector3d(1, 2, 3); }), InvalidInput);
  EXPECT_THROW(fit([](int u, int v) { return Eigen::Vector3d(u, v, u + v); }), InvalidInput);
  EXPECT_THROW(fit([](int u, int) { return Eigen::Vector3d(u, 2 * u, 3); }), InvalidInput);
  EXPECT_THROW(fit([&](int u, int v) { return v == 7 ? bumpy(u, v) : kMissing; }), InvalidInput);
  EXPECT_THROW(fit([](int u, int v) { return Eigen::Vector3d(u * 7919 % 101, v * 104729 % 97, u * v * 31 % 89); }),
               InvalidInput);
  EXPECT_THROW(fit_measured_grid(30, 20, {}, Eigen::Vector3d::UnitZ()), InvalidInput);
}

}  // namespace
}  // namespace lapseam
