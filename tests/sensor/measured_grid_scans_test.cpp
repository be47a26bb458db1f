// The measured-grid sensor on real range grids (Stanford 3D Scanning Repository), where they are there.

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <limits>
#include <sstream>
#include <string>

#include "lapseam/sensor.h"

namespace lapseam {
namespace {

struct RangeGrid {
  int width = 0, height = 0;
  std::vector<Eigen::Vector3d> points;
};

// Rows run upwards in these files: the last becomes the first.
RangeGrid read_range_grid(const std::filesystem::path& file) {
  std::ifstream in(file);
  RangeGrid grid;
  std::size_t vertex_count = 0;
  for (std::string line; std::getline(in, line) && line != "end_header";) {
    std::istringstream words(line);
    std::string first, second;
    words >> first >> second;
    if (second == "num_cols") words >> grid.width;
    if (second == "num_rows") words >> grid.height;
    if (second == "vertex") words >> vertex_count;
  }
  std::vector<Eigen::Vector3d> vertices(vertex_count);
  for (auto& p : vertices) in >> p.x() >> p.y() >> p.z();
  grid.points.assign(std::size_t(grid.width) * std::size_t(grid.height),
                     Eigen::Vector3d::Constant(std::numeric_limits<double>::quiet_NaN()));
  for (int row = grid.height - 1; row >= 0; --row)
    for (int u = 0; u < grid.width; ++u) {
      int count = 0;
      std::size_t index = 0;
      in >> count;
      if (count == 0) continue;
      in >> index;
      // Rows were read bottom-up, so this one goes to where it belongs when v runs downwards.
      grid.points[std::size_t(row) * std::size_t(grid.width) + std::size_t(u)] = vertices.at(index);
    }
  EXPECT_TRUE(in) << file;
  return grid;
}

std::vector<std::filesystem::path> range_grids() {
  const char* given = std::getenv("LAPSEAM_DATA");
  const std::filesystem::path data = given ? given : "../shared/data";
  std::vector<std::filesystem::path> files;
  for (const char* name : {"bunny", "dragon"}) {
    if (!std::filesystem::is_directory(data / name)) continue;
    for (const auto& entry : std::filesystem::directory_iterator(data / name)) {
      const std::string stem = entry.path().stem().string();
      if (entry.path().extension() == ".ply" && stem != "bun_zipper" && stem != "dragon_vrip") files.push_back(entry);
    }
  }
  std::sort(files.begin(), files.end());
  return files;
}

TEST(MeasuredGridScans, StanfordGridsAreFittedAndInverted) {
  const auto files = range_grids();
  if (files.empty()) GTEST_SKIP() << "no Stanford scans in LAPSEAM_DATA or ../shared/data";
  for (const auto& file : files) {
    const RangeGrid grid = read_range_grid(file);
    // The sensor is at +z and looks to −z.
    const MeasuredGrid fitted = fit_measured_grid(grid.width, grid.height, grid.points, -Eigen::Vector3d::UnitZ());
    const MeasuredGridSensor& s = fitted.sensor;
    std::size_t samples = 0, exact = 0, missed = 0;
    for (std::size_t i = 0; i < grid.points.size(); ++i) {
      if (!grid.points[i].allFinite()) continue;
      ++samples;
      ASSERT_GT(fitted.range.pixels[i], 0.0f);
      PixelRange out;
      if (!s.project(grid.points[i], out)) {
        ++missed;
        continue;
      }
      const double u = double(i % std::size_t(grid.width)), v = double(i / std::size_t(grid.width));
      if (std::abs(out.u - u) < 1e-6 && std::abs(out.v - v) < 1e-6) ++exact;
    }
    const auto parallel = [&](int row) {
      return s.rational[std::size_t(row)].head<3>().isZero() ? "parallel" : "perspective";
    };
    std::printf(
        "%-28s %6zu samples, rms %.3f px, columns %s, rows %s, forward (%.3f %.3f %.3f), spacing %.3f mm, "
        "exact %.4f, missed %zu\n",
        file.filename().c_str(), samples, s.fit_rms_px, parallel(1), parallel(3), s.forward.x(), s.forward.y(),
        s.forward.z(), 1e3 * sample_spacing(s, 0.5 * s.width, 0.5 * s.height, double(s.range_offset_m)),
        double(exact) / double(samples), missed);
    EXPECT_EQ(missed, 0u) << file;
    // A few samples share a ray with another where a noisy row crosses its neighbour: either pixel is right then.
    EXPECT_GT(double(exact), 0.995 * double(samples)) << file;
    EXPECT_EQ(handedness(s), 1) << file;
    // The dragon's light planes stand at 28 degrees.
    EXPECT_LT(s.forward.z(), -0.8) << file;
  }
}

}  // namespace
}  // namespace lapseam
