#include "simulate/trajectory.h"

#include <algorithm>
#include <cmath>
#include <fstream>
#include <numbers>
#include <sstream>

#include "lapseam/context.h"
#include "lapseam/error.h"
#include "simulate/counter_rng.h"
#include "simulate/coverage.h"
#include "simulate/free_space.h"

namespace lapseam {
namespace simulation {
namespace {

using Eigen::Isometry3d;
using Eigen::Vector3d;
using Eigen::Vector3f;

constexpr double kPi = std::numbers::pi;

struct Ball {
  Vector3d center;
  double radius;
};

/// Around the middle of the bounding box.
Ball bounding_ball(const SimulatedScene& scene) {
  Eigen::AlignedBox3f box;
  for (const Vector3f& p : scene.mesh.positions_m) box.extend(p);
  float squared = 0;
  for (const Vector3f& p : scene.mesh.positions_m) squared = std::max(squared, (p - box.center()).squaredNorm());
  return {scene.mesh.origin_m + box.center().cast<double>(), std::sqrt(double(squared))};
}

/// From which the ball fits the image, within the sensor's range.
double fitting_distance(const Ball& ball, const SensorRig& rig) {
  double distance = 3 * ball.radius;
  if (const auto* pinhole = std::get_if<PinholeSensor>(&rig.sensor)) {
    const double half_angle =
        std::min(std::atan(0.5 * pinhole->width / pinhole->fx), std::atan(0.5 * pinhole->height / pinhole->fy));
    distance = 1.05 * ball.radius / std::sin(half_angle);
  }
  return std::max(distance, 1.02 * (ball.radius + rig.effects.min_range_m));
}

Vector3d direction(double azimuth, double elevation) {
  return {std::cos(elevation) * std::cos(azimuth), std::cos(elevation) * std::sin(azimuth), std::sin(elevation)};
}

/// Views are shared between rings in proportion to their length; every ring has one at least.
std::vector<Vector3d> ring_directions(int views, int rings, double elevation) {
  std::vector<double> elevations(std::size_t(rings), elevation);
  if (rings > 1)
    for (int i = 0; i < rings; ++i) elevations[std::size_t(i)] = kPi / 3 * (2.0 * i / (rings - 1) - 1);
  double total = 0;
  for (const double e : elevations) total += std::cos(e);
  std::vector<Vector3d> out;
  double share = 0;
  for (std::size_t i = 0; i < elevations.size(); ++i) {
    share += std::cos(elevations[i]) / total;
    const int left = int(elevations.size() - 1 - i);
    const int until = std::clamp(int(std::lround(share * views)), int(out.size()) + 1, views - left);
    const int count = until - int(out.size());
    // Every other ring is turned by half a step.
    for (int k = 0; k < count; ++k)
      out.push_back(direction(2 * kPi * (k + 0.5 * double(i % 2)) / count, elevations[i]));
  }
  return out;
}

std::vector<Vector3d> axis_directions(int views) {
  std::vector<Vector3d> out;
  for (int nonzero = 1; nonzero <= 3; nonzero += nonzero == 1 ? 2 : -1) {
    for (int i = 0; i < 27; ++i) {
      const Vector3d d(1 - i % 3, 1 - i / 3 % 3, 1 - i / 9);
      if (int(d.cwiseAbs().sum()) == nonzero) out.push_back(d.normalized());
    }
    if (nonzero == 2) break;
  }
  out.resize(std::size_t(views), Vector3d::UnitX());
  return out;
}

Poses plan_around(const SimulatedScene& scene, const SensorRig& rig, const TrajectoryOptions& options) {
  const bool is_axes = options.kind == Trajectory::kAxes;
  if (is_axes && options.views > 26) throw InvalidInput({}, {}, "views", "there are only 26 axis directions");
  if (!is_axes && (options.rings < 1 || options.rings > options.views))
    throw InvalidInput({}, {}, "rings", "must be at least 1 and at most the number of views");
  const Ball ball = bounding_ball(scene);
  const double distance = options.distance_m > 0 ? options.distance_m : fitting_distance(ball, rig);
  Poses poses;
  for (const Vector3d& d :
       is_axes ? axis_directions(options.views) : ring_directions(options.views, options.rings, options.elevation_rad))
    poses.push_back(look_at(rig.sensor, ball.center + distance * d, ball.center));
  return poses;
}

Isometry3d pose_from(const std::vector<double>& n, const std::filesystem::path& file, const std::string& line_name) {
  Isometry3d T = Isometry3d::Identity();
  if (n.size() == 7) {
    const Eigen::Quaterniond q(n[6], n[3], n[4], n[5]);
    if (!(std::abs(q.norm() - 1) < 1e-3)) throw InvalidInput(file, line_name, "quaternion", "is not of unit length");
    T.linear() = q.normalized().toRotationMatrix();
    T.translation() = Vector3d(n[0], n[1], n[2]);
  } else if (n.size() == 16) {
    const Eigen::Matrix4d M = Eigen::Map<const Eigen::Matrix<double, 4, 4, Eigen::RowMajor>>(n.data());
    const Eigen::Matrix3d R = M.topLeftCorner<3, 3>();
    if (!((R * R.transpose() - Eigen::Matrix3d::Identity()).norm() < 1e-3 && R.determinant() > 0))
      throw InvalidInput(file, line_name, "pose", "is not rigid");
    T.linear() = Eigen::Quaterniond(R).normalized().toRotationMatrix();
    T.translation() = M.topRightCorner<3, 1>();
  } else {
    throw InvalidInput(file, line_name, "pose", "has " + std::to_string(n.size()) + " numbers, not 7 or 16");
  }
  if (!T.matrix().allFinite()) throw InvalidInput(file, line_name, "pose", "is not finite");
  return T;
}

}  // namespace

Isometry3d look_at(const Sensor& sensor, const Vector3d& eye, const Vector3d& target) {
  const Vector3d forward = (target - eye).normalized();
  // Straight up or down, the image's upper edge points along y.
  const Vector3d up = std::abs(forward.z()) < 0.999 ? Vector3d::UnitZ() : Vector3d::UnitY();
  const Vector3d right = forward.cross(up).normalized(), down = forward.cross(right);
  Isometry3d T = Isometry3d::Identity();
  if (std::holds_alternative<SphericalSensor>(sensor))
    T.linear() << forward, -right, -down;
  else
    T.linear() << right, down, forward;
  T.translation() = eye;
  return T;
}

Poses plan_stations(const SimulatedScene& scene, const SensorRig& rig, const TrajectoryOptions& options,
                    Context& context) {
  Eigen::AlignedBox3f box;
  for (const Vector3f& p : scene.mesh.positions_m) box.extend(p);
  const RayScene rays(scene.mesh.positions_m, scene.mesh.triangles, context);
  // A tripod: 1.3 to 1.6 m high, half a metre clear of things where there is room for that.
  const float floor = box.min().z();
  box.min().z() = floor + 1.3f;
  box.max().z() = std::min(floor + 1.6f, box.max().z() - 0.3f);
  std::vector<Vector3f> places;
  for (const float clearance : {0.5f, 0.3f, 0.15f}) {
    const FreeSpace space(rays, box, clearance, context);
    constexpr std::size_t kMostPlaces = 300;
    const CounterRng rng(options.seed, Stream::kTrajectory, 1);
    const std::size_t count = std::min(kMostPlaces, space.cells().size());
    for (std::size_t i = 0; i < count; ++i)
      places.push_back(space.center(space.cells()[rng.bits(i) % space.cells().size()]));
    if (places.size() >= std::size_t(options.views)) break;
  }
  if (places.size() < std::size_t(options.views))
    throw InvalidInput({}, scene.name, "stations", "there is no room to stand for so many");

  const SurfaceSamples samples = sample_surface(scene.mesh, 8000, options.seed);
  const SightLimits limits{float(rig.effects.min_range_m), float(std::min(rig.effects.max_range_m, 1e6)), 0.17f};
  const auto seen = find_visible_from(places, samples, rays, limits, scene.name, context);
  Poses poses;
  const CounterRng rng(options.seed, Stream::kTrajectory, 2);
  for (const std::size_t i : choose_places(places, seen, samples.points.size(), std::size_t(options.views))) {
    const Vector3d eye = scene.mesh.origin_m + places[i].cast<double>();
    poses.push_back(look_at(rig.sensor, eye, eye + direction(rng.uniform(i, 0, 2 * kPi), 0)));
  }
  return poses;
}

std::vector<ViewSource> views_at(const Poses& poses, const SensorRig& rig) {
  const std::size_t digits = std::max<std::size_t>(3, std::to_string(poses.empty() ? 0 : poses.size() - 1).size());
  std::vector<ViewSource> views;
  for (std::size_t i = 0; i < poses.size(); ++i) {
    ViewSource view;
    view.name = std::to_string(i);
    view.name.insert(0, digits - view.name.size(), '0');
    view.sensor = rig.sensor;
    view.sensor_id = rig.id;
    view.T_world_view = poses[i];
    view.color = rig.color;
    views.push_back(std::move(view));
  }
  return views;
}

}  // namespace simulation

std::vector<ViewSource> make_trajectory(const SimulatedScene& scene, const SensorRig& rig,
                                        const TrajectoryOptions& options, Context& context) {
  using namespace simulation;
  if (options.views < 1) throw InvalidInput({}, {}, "views", "must be at least 1");
  if (scene.mesh.triangles.empty()) throw InvalidInput({}, scene.name, "triangles", "the scene has none");
  StageScope stage(context, "plan trajectory");
  switch (options.kind) {
    case Trajectory::kWalk:
      return views_at(plan_walk(scene, rig, options, context), rig);
    case Trajectory::kStations:
      return views_at(plan_stations(scene, rig, options, context), rig);
    case Trajectory::kOrbit:
    case Trajectory::kAxes:
      break;
  }
  return views_at(plan_around(scene, rig, options), rig);
}

std::vector<ViewSource> read_trajectory(const std::filesystem::path& file, const SensorRig& rig) {
  using namespace simulation;
  std::ifstream in(file);
  if (!in) throw IoError(file, "cannot be opened");
  Poses poses;
  std::string line;
  for (int number = 1; std::getline(in, line); ++number) {
    const std::string line_name = "line " + std::to_string(number);
    std::istringstream words(line.substr(0, line.find('#')));
    std::vector<double> numbers;
    for (std::string word; words >> word;) {
      std::size_t used = 0;
      try {
        numbers.push_back(std::stod(word, &used));
      } catch (const std::exception&) {
        used = 0;
      }
      if (used != word.size()) throw InvalidInput(file, line_name, "pose", "'" + word + "' is not a number");
    }
    if (!numbers.empty()) poses.push_back(pose_from(numbers, file, line_name));
  }
  if (poses.empty()) throw InvalidInput(file, {}, "poses", "there are none");
  return views_at(poses, rig);
}

}  // namespace lapseam
