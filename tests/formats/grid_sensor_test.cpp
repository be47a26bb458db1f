#include "io/grid_sensor.h"

#include <random>

#include "room_scene.h"

namespace lapseam::test {
namespace {

/// The samples of a view as a scanner's file has them; `jitter_px` turns each ray a little.
std::vector<GridSample> samples_of(const SphericalSensor& sensor, double jitter_px) {
  std::mt19937 random(7);
  std::uniform_real_distribution<double> jitter(-jitter_px, jitter_px);
  std::vector<GridSample> samples;
  for (int v = 0; v < sensor.rows(); ++v) {
    for (int u = 0; u < sensor.columns(); ++u) {
      const Eigen::Vector3d ray = sensor.unproject(u + jitter(random), v + jitter(random), 1.0);
      const auto distance = ball_in_box()(Eigen::Vector3d::Zero(), ray);
      if (!distance || (u + 3 * v) % 13 == 0) continue;
      GridSample sample;
      sample.u = u;
      sample.v = v;
      sample.stored = ray * *distance;
      samples.push_back(sample);
    }
  }
  return samples;
}

/// In pieces, as a scan with many points.
Sensor fit(const Source& source, ImageSize size, const std::vector<GridSample>& samples, std::size_t pieces = 1) {
  Context context(2);
  const auto visit = [&](std::size_t piece, const VisitSample& visit_sample) {
    const std::size_t n = samples.size();
    for (std::size_t i = piece * n / pieces; i < (piece + 1) * n / pieces; ++i) visit_sample(samples[i]);
  };
  return fit_grid_sensor(source, size, {pieces, visit}, context);
}

double worst_m(const Sensor& sensor, const std::vector<GridSample>& samples) {
  double worst = 0;
  for (const GridSample& s : samples)
    worst = std::max(worst, (unproject(sensor, s.u, s.v, double(range_of(sensor, s))) - s.stored).norm());
  return worst;
}

TEST(GridSensor, APolarGridGetsTables) {
  const auto truth = small_scanner();
  const std::vector<GridSample> samples = samples_of(truth, 0);
  const Sensor found = fit({}, {truth.columns(), truth.rows()}, samples);
  const auto& polar = std::get<SphericalSensor>(found);
  EXPECT_FALSE(polar.warp);
  EXPECT_TRUE(polar.wraps());
  for (int u = 0; u < truth.columns(); ++u)
    EXPECT_NEAR(
        std::remainder(polar.azimuth_rad[std::size_t(u)] - truth.azimuth_rad[std::size_t(u)], 6.283185307179586), 0,
        1e-12);
  EXPECT_LT(worst_m(found, samples), 1e-6);  // ranges are floats
}

TEST(GridSensor, JitteredRaysKeepTheirPoints) {
  const auto truth = small_scanner();
  const std::vector<GridSample> samples = samples_of(truth, 0.3);
  const Sensor found = fit({}, {truth.columns(), truth.rows()}, samples);
  const auto& polar = std::get<SphericalSensor>(found);
  ASSERT_TRUE(polar.warp);
  // A warp of 0.3 px in single precision: 3e-8 px of 0.07 rad at 3 m.
  EXPECT_LT(worst_m(found, samples), 1e-6);
  std::size_t lost = 0;
  for (const GridSample& s : samples) {
    const auto pixel = project(found, s.stored);
    lost += !pixel || std::hypot(pixel->u - s.u, pixel->v - s.v) > 1e-3;
  }
  // Between strongly jittered neighbours cells may fold, where another pixel of the fold is as good.
  EXPECT_LE(lost, samples.size() / 100);
}

TEST(GridSensor, ACameraIsRecognised) {
  const PinholeSensor truth = lens_camera();
  std::vector<GridSample> samples;
  for (int v = 0; v < truth.height; ++v) {
    for (int u = 0; u < truth.width; ++u) {
      GridSample sample;
      sample.u = u;
      sample.v = v;
      sample.stored = truth.unproject(u, v, 1.5 + 0.01 * ((u * 7 + v * 3) % 31));
      samples.push_back(sample);
    }
  }
  const Sensor found = fit({}, {truth.width, truth.height}, samples);
  const auto& camera = std::get<PinholeSensor>(found);
  EXPECT_NEAR(camera.fx, truth.fx, 1e-9);
  EXPECT_NEAR(camera.cy, truth.cy, 1e-9);
}

TEST(GridSensor, AnythingElseIsAMeasuredGrid) {
  std::vector<GridSample> samples;
  for (int v = 0; v < 40; ++v) {
    for (int u = 0; u < 50; ++u) {
      GridSample sample;
      sample.u = u;
      sample.v = v;
      sample.stored = {0.01 * u, 0.01 * v, 1 + 0.1 * std::sin(0.3 * u) * std::cos(0.2 * v)};  // parallel rays
      samples.push_back(sample);
    }
  }
  const Sensor found = fit({}, {50, 40}, samples);
  ASSERT_TRUE(std::holds_alternative<MeasuredGridSensor>(found));
  EXPECT_LT(worst_m(found, samples), 1e-6);
}

TEST(GridSensor, TooFewSamplesAreRefused) {
  std::vector<GridSample> samples(5);
  for (GridSample& sample : samples) sample.stored = {1, 2, 3};
  expect_refused([&] { fit({"a.ptx", "v"}, {10, 10}, samples); }, {"a.ptx", "'v'", "5 valid samples"});
  expect_refused([&] { fit({"a.ptx", "v"}, {10, 10}, {}); }, {"a.ptx", "no valid sample"});
  expect_refused([&] { make_polar_grid({"a.e57", "v"}, samples); }, {"a.e57", "5 valid samples"});
}

TEST(PolarGrid, PointsWithoutRowsGetPixelsAndKeepTheirPlaces) {
  const auto truth = SphericalSensor::from_limits(120, 60, -1.0, 1.2, 0.7, -0.5);
  std::vector<GridSample> samples = samples_of(truth, 0.1);
  for (GridSample& sample : samples) sample.u = sample.v = -1;
  const SphericalSensor grid = make_polar_grid({}, samples);
  // As many pixels as the scanner had, give or take the tenth that the jitter makes of the spacing.
  EXPECT_NEAR(grid.columns(), 120, 18);
  EXPECT_NEAR(grid.rows(), 60, 9);
  std::size_t kept = 0;
  for (const GridSample& s : samples) {
    if (s.u < 0) continue;
    ++kept;
    EXPECT_LT((grid.unproject(s.u, s.v, s.distance_m()) - s.stored).norm(), 1e-5);
  }
  // Where two points share a pixel the farther one goes; on a regular scan few do.
  EXPECT_GT(kept, samples.size() * 8 / 10);
}

}  // namespace
}  // namespace lapseam::test
