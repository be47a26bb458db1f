// import_tilting_laser DIR OUT: turns the scans of a laser that measures in one plane and tilts it about its x axis
// (scanNNN.3d, a point per line, lines of the same number of samples; scanNNN.pose) into a manifest with range images:
//   OUT/scene.json, OUT/range/NNN.exr
// Points are in centimetres in a left-handed frame, as 3DTK writes them; poses are x y z and Euler degrees, R = Rx Ry
// Rz.
// The laser measures every second sample of a line in one turn of its mirror and those between in the next, while the
// tilt goes on by half a line; points come as if both were measured at once. Which of the two was first changes
// wherever turns were lost, and is told from the scans; then samples are moved to the middle of both.

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
// Surfaces whose range changes by less than this share from line to line do not tell which line a sample belongs to.
constexpr double kLeastSlope = 0.005;
// Neighbours whose ranges differ by more than this share are not taken for one surface.
constexpr float kLargestStep = 0.1f;
constexpr std::size_t kFewestPlaces = 8;  // of a line, for a middle one
constexpr int kFewestLines = 5;           // that vote together

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
  if (values.empty()) return 0;
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

// Ranges and angles as they came: a column is a line.
struct Lines {
  lapseam::RangeImage range;
  std::vector<double> azimuth_rad, elevation_rad;
};

Lines make_lines(const std::vector<Eigen::Vector3d>& points, int samples, const fs::path& file) {
  const auto lines = int(points.size() / std::size_t(samples));
  if (lines < 3 || samples < 4) throw lapseam::IoError(file, "has fewer than three lines of four samples");
  const Eigen::Matrix3d R = scanner_from_sensor().transpose();
  std::vector<std::vector<double>> azimuths(static_cast<std::size_t>(lines)),
      elevations(static_cast<std::size_t>(samples));
  Lines out;
  out.range = lapseam::RangeImage(lines, samples);
  for (int line = 0; line < lines; ++line)
    for (int k = 0; k < samples; ++k) {
      const Eigen::Vector3d p = R * points[std::size_t(line) * std::size_t(samples) + std::size_t(k)];
      const double r = p.norm();
      if (!(r > 1e-6)) continue;
      elevations[std::size_t(k)].push_back(std::asin(std::clamp(p.z() / r, -1.0, 1.0)));
      if (std::hypot(p.x(), p.y()) > 0.05 * r) azimuths[std::size_t(line)].push_back(std::atan2(p.y(), p.x()));
      if (r > kNearest_m && r < kFarthest_m) out.range.at(line, k) = float(r);
    }
  for (const auto& angles : azimuths) out.azimuth_rad.push_back(middle(angles));
  for (const auto& angles : elevations) out.elevation_rad.push_back(middle(angles));
  return out;
}

// How much later than the odd samples of a line its even ones were measured, in lines, as the middle one of the smooth
// places has it; 0 where there are too few. What the next line measures elsewhere, they measure a little of already.
double even_behind_odd(const lapseam::RangeImage& range, int line) {
  std::vector<double> found;
  for (int k = 1; k + 1 < range.height; ++k) {
    const float r = range.at(line, k), a = range.at(line, k - 1), b = range.at(line, k + 1);
    const float before = range.at(line - 1, k), after = range.at(line + 1, k);
    if (!(r > 0) || !(a > 0) || !(b > 0) || !(before > 0) || !(after > 0)) continue;
    const double per_line = 0.5 * double(after - before), ahead = double(r) - 0.5 * double(a + b);
    const float least = 0.5f * std::abs(after - before);
    const bool is_smooth = std::abs(after + before - 2 * r) < least && std::abs(b - a) < least;
    if (is_smooth && std::abs(per_line) > kLeastSlope * double(r))
      found.push_back((k % 2 == 0 ? 1 : -1) * ahead / per_line);
  }
  return found.size() < kFewestPlaces ? 0 : middle(found);
}

// Of each line, whether its even samples were measured after its odd ones. Lines that do not tell are like the nearest
// ones that do.
std::vector<bool> even_is_later(const lapseam::RangeImage& range) {
  std::vector<double> behind(std::size_t(range.width), 0.0);
  for (int line = 1; line + 1 < range.width; ++line) behind[std::size_t(line)] = even_behind_odd(range, line);
  std::vector<bool> out(behind.size());
  for (int line = 0; line < range.width; ++line) {
    double votes = 0;
    for (int reach = kFewestLines / 2; votes == 0 && reach < range.width; ++reach)
      for (int other = std::max(0, line - reach); other <= std::min(range.width - 1, line + reach); ++other)
        votes += std::clamp(behind[std::size_t(other)], -0.5, 0.5);
    out[std::size_t(line)] = votes > 0;
  }
  return out;
}

struct Grid {
  lapseam::SphericalSensor sensor;
  lapseam::RangeImage range;
};

// Moves each sample by a quarter of a line, to where both turns of the line meet: on a plane, inverse ranges change
// evenly. Samples beside a step stay as they are.
Grid make_grid(const Lines& lines) {
  const std::vector<bool> is_even_later = even_is_later(lines.range);
  Grid grid{{lines.azimuth_rad, lines.elevation_rad}, lines.range};
  for (int line = 0; line < lines.range.width; ++line)
    for (int k = 0; k < lines.range.height; ++k) {
      const bool is_later = is_even_later[std::size_t(line)] == (k % 2 == 0);
      const int from = line + (is_later ? -1 : 1);
      if (from < 0 || from >= lines.range.width) continue;
      const float here = lines.range.at(line, k), there = lines.range.at(from, k);
      if (!(here > 0) || !(there > 0) || std::abs(there - here) > kLargestStep * std::min(here, there)) continue;
      grid.range.at(line, k) = 4 / (3 / here + 1 / there);
    }
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
    const Grid grid = make_grid(make_lines(read_points(file), arguments.columns, file));
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
