// import_tilting_laser DIR OUT: turns the scans of a laser that measures in one plane and tilts it about its x axis
// (scanNNN.3d, a point per line, lines of the same number of samples; scanNNN.pose) into a manifest with range images:
//   OUT/scene.json, OUT/range/NNN.exr
// Points are in centimetres in a left-handed frame, as 3DTK writes them; poses are x y z and Euler degrees, R = Rx Ry
// Rz.

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <numbers>

#include "lapseam/context.h"
#include "lapseam/error.h"
#include "lapseam/io.h"

namespace {

namespace fs = std::filesystem;

constexpr double kMetresPerUnit = 0.01;
// Returns of the scanner's own frame, and of nothing.
constexpr double kNearest_m = 0.15, kFarthest_m = 30;

struct Arguments {
  fs::path folder, out;
  int columns = 360;  // samples of a line
};

// Right-handed: z is turned over.
std::vector<Eigen::Vector3d> read_points(const fs::path& file) {
  std::ifstream stream(file);
  std::vector<Eigen::Vector3d> points;
  double x = 0, y = 0, z = 0;
  while (stream >> x >> y >> z) points.push_back(kMetresPerUnit * Eigen::Vector3d(x, y, -z));
  if (points.empty()) throw lapseam::IoError(file, "has no points");
  return points;
}

Eigen::Isometry3d read_pose(const fs::path& file) {
  std::ifstream stream(file);
  double v[6];
  for (double& number : v)
    if (!(stream >> number)) throw lapseam::IoError(file, "expected six numbers");
  const double rad = std::numbers::pi / 180;
  Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
  pose.linear() = (Eigen::AngleAxisd(v[3] * rad, Eigen::Vector3d::UnitX()) *
                   Eigen::AngleAxisd(v[4] * rad, Eigen::Vector3d::UnitY()) *
                   Eigen::AngleAxisd(v[5] * rad, Eigen::Vector3d::UnitZ()))
                      .toRotationMatrix();
  pose.translation() = kMetresPerUnit * Eigen::Vector3d(v[0], v[1], v[2]);
  const Eigen::DiagonalMatrix<double, 3> flip(1, 1, -1);
  pose.linear() = flip * pose.linear() * flip;
  pose.translation() = flip * pose.translation();
  return pose;
}

double middle(std::vector<double> values) {
  std::nth_element(values.begin(), values.begin() + std::ptrdiff_t(values.size() / 2), values.end());
  return values[values.size() / 2];
}

// The tilting axis is the pole of a spherical sensor: a line of samples is one azimuth, a place in the line an
// elevation. Sensor frame: z along the scanner's x, x against its z (which was turned over), y along its y.
Eigen::Matrix3d scanner_from_sensor() {
  Eigen::Matrix3d R;
  R << 0, 0, 1, 0, 1, 0, -1, 0, 0;
  return R;
}

struct Grid {
  lapseam::SphericalSensor sensor;
  lapseam::RangeImage range;
};

Grid make_grid(const std::vector<Eigen::Vector3d>& points, int samples, const fs::path& file) {
  const auto lines = int(points.size() / std::size_t(samples));
  if (lines < 2) throw lapseam::IoError(file, "has fewer than two lines");
  const Eigen::Matrix3d R = scanner_from_sensor().transpose();
  std::vector<std::vector<double>> azimuths(static_cast<std::size_t>(lines)),
      elevations(static_cast<std::size_t>(samples));
  Grid grid;
  grid.range = lapseam::RangeImage(lines, samples);
  for (int line = 0; line < lines; ++line)
    for (int k = 0; k < samples; ++k) {
      const Eigen::Vector3d p = R * points[std::size_t(line) * std::size_t(samples) + std::size_t(k)];
      const double r = p.norm();
      if (!(r > 1e-6)) continue;
      elevations[std::size_t(k)].push_back(std::asin(std::clamp(p.z() / r, -1.0, 1.0)));
      if (std::hypot(p.x(), p.y()) > 0.05 * r) azimuths[std::size_t(line)].push_back(std::atan2(p.y(), p.x()));
      if (r > kNearest_m && r < kFarthest_m) grid.range.at(line, k) = float(r);
    }
  for (auto& angles : azimuths) grid.sensor.azimuth_rad.push_back(angles.empty() ? 0 : middle(angles));
  for (auto& angles : elevations) grid.sensor.elevation_rad.push_back(angles.empty() ? 0 : middle(angles));
  return grid;
}

void run(const Arguments& arguments) {
  lapseam::Scene scene;
  scene.name = arguments.folder.filename().string();
  std::vector<fs::path> files;
  for (const auto& entry : fs::directory_iterator(arguments.folder))
    if (entry.path().extension() == ".3d") files.push_back(entry.path());
  std::sort(files.begin(), files.end());
  if (files.empty()) throw lapseam::IoError(arguments.folder, "holds no .3d files");
  fs::create_directories(arguments.out / "range");
  for (const fs::path& file : files) {
    const Grid grid = make_grid(read_points(file), arguments.columns, file);
    fs::path pose_file = file;
    Eigen::Isometry3d T_world_view = read_pose(pose_file.replace_extension(".pose"));
    T_world_view.linear() = T_world_view.linear() * scanner_from_sensor();
    lapseam::ViewSource view;
    view.name = file.stem().string();
    view.sensor = grid.sensor;
    view.sensor_id = view.name;
    view.T_world_view = T_world_view;
    view.range.format = lapseam::RangeFormat::kExr;
    view.range.quantity = lapseam::RangeQuantity::kDistance;
    view.range.file = arguments.out / "range" / (view.name + ".exr");
    lapseam::write_range_exr(view.range.file, grid.range, grid.sensor, T_world_view);
    scene.views.push_back(std::move(view));
  }
  lapseam::write_scene(scene, arguments.out / "scene.json");
  fmt::print("{}: {} views\n", (arguments.out / "scene.json").string(), scene.views.size());
}

}  // namespace

int main(int argc, char** argv) {
  Arguments arguments;
  CLI::App app("Turns scans of a tilting plane laser (scanNNN.3d, scanNNN.pose) into a manifest");
  app.add_option("dir", arguments.folder, "Folder with scanNNN.3d and scanNNN.pose")->required();
  app.add_option("out", arguments.out, "Folder to write scene.json and range images to")->required();
  app.add_option("--samples-per-line", arguments.columns, "Points of one line")->capture_default_str();
  CLI11_PARSE(app, argc, argv);
  try {
    run(arguments);
  } catch (const lapseam::Error& error) {
    fmt::print(stderr, "import_tilting_laser: error: {}\n", error.what());
    return 1;
  }
  return 0;
}
