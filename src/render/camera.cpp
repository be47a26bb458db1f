#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "lapseam/error.h"
#include "lapseam/render.h"

namespace lapseam {
namespace {

PinholeSensor make_pinhole(int width, int height, double fov_rad) {
  if (width <= 0 || height <= 0) throw InvalidInput({}, {}, "size", "a picture has at least one pixel");
  if (!(fov_rad > 0 && fov_rad < std::numbers::pi))
    throw InvalidInput({}, {}, "fov", "must be between 0 and 180 degrees");
  PinholeSensor pinhole;
  pinhole.width = width;
  pinhole.height = height;
  pinhole.fx = pinhole.fy = 0.5 * height / std::tan(0.5 * fov_rad);
  pinhole.cx = 0.5 * (width - 1);
  pinhole.cy = 0.5 * (height - 1);
  return pinhole;
}

/// Columns: right, down, forward.
Eigen::Matrix3d look_along(const Eigen::Vector3d& forward, const Eigen::Vector3d& up) {
  Eigen::Vector3d right = forward.cross(up);
  // Looking straight up or down: any right will do, but always the same.
  if (right.norm() < 1e-9 * up.norm()) right = forward.cross(Eigen::Vector3d(up.y(), up.z(), up.x()));
  right.normalize();
  Eigen::Matrix3d R;
  R << right, forward.cross(right), forward;
  return R;
}

/// Orthonormal: right and front of an observer who stands before the object.
struct Stand {
  Eigen::Vector3d right, front, up;
};

Stand stand_on(const Eigen::Vector3d& up_direction) {
  Stand stand;
  stand.up = up_direction.normalized();
  const bool is_x_up = std::abs(stand.up.x()) > 0.9;
  const Eigen::Vector3d reference = is_x_up ? Eigen::Vector3d::UnitY() : Eigen::Vector3d::UnitX();
  stand.right = (reference - reference.dot(stand.up) * stand.up).normalized();
  stand.front = stand.right.cross(stand.up);
  return stand;
}

Eigen::Vector3d area_normal(const Mesh& mesh, const Triangle& t) {
  const Eigen::Vector3d a = mesh.positions_m[t[0]].cast<double>();
  return 0.5 * (mesh.positions_m[t[1]].cast<double>() - a).cross(mesh.positions_m[t[2]].cast<double>() - a);
}

}  // namespace

RenderCamera look_at_camera(const LookAt& settings) {
  const Eigen::Vector3d forward = settings.target_m - settings.eye_m;
  if (!(forward.norm() > 0) || !forward.allFinite())
    throw InvalidInput({}, {}, "camera", "eye and target have to be two different points");
  const Eigen::Vector3d up = settings.up.isZero(0) ? Eigen::Vector3d::UnitY() : settings.up.normalized();
  RenderCamera camera;
  camera.sensor = make_pinhole(settings.width, settings.height, settings.fov_rad);
  camera.T_world_camera.linear() = look_along(forward.normalized(), up);
  camera.T_world_camera.translation() = settings.eye_m;
  return camera;
}

RenderCamera orbit_camera(const Mesh& mesh, const Orbit& settings) {
  if (mesh.triangles.empty()) throw InvalidInput({}, {}, "mesh", "has no triangles to look at");
  if (!(settings.zoom > 0)) throw InvalidInput({}, {}, "zoom", "must be greater than 0");
  const Stand stand = stand_on(settings.up.isZero(0) ? guess_up(mesh) : settings.up);
  const double az = settings.azimuth_rad, el = settings.elevation_rad;
  const Eigen::Vector3d level = std::cos(az) * stand.front + std::sin(az) * stand.right;
  const Eigen::Vector3d forward = -(std::cos(el) * level + std::sin(el) * stand.up);
  // Past the pole the picture would turn over; the upward direction of the orbit itself does not.
  const Eigen::Vector3d up = std::cos(el) * stand.up - std::sin(el) * level;
  const Eigen::Matrix3d R = look_along(forward, up);

  Eigen::AlignedBox3f box;
  for (const Triangle& t : mesh.triangles)
    for (const std::uint32_t v : t) box.extend(mesh.positions_m[v]);
  const Eigen::Vector3d center = box.center().cast<double>();

  PinholeSensor pinhole = make_pinhole(settings.width, settings.height, settings.fov_rad);
  constexpr double kMargin = 1.06;
  const double reach_x = 0.5 * settings.width / pinhole.fx / kMargin,
               reach_y = 0.5 * settings.height / pinhole.fy / kMargin;
  // A point is in the picture when |x − shift_x| ≤ reach_x · (distance + z): two lines in (shift, distance) on each
  // axis, whose extremes over all points meet at the nearest stand.
  Eigen::Array2d upper = Eigen::Array2d::Constant(-std::numeric_limits<double>::infinity()), lower = -upper;
  const Eigen::Array2d reach(reach_x, reach_y);
  for (const Triangle& t : mesh.triangles) {
    for (const std::uint32_t v : t) {
      const Eigen::Vector3d p = R.transpose() * (mesh.positions_m[v].cast<double>() - center);
      upper = upper.max(p.head<2>().array() - p.z() * reach);
      lower = lower.min(p.head<2>().array() + p.z() * reach);
    }
  }
  const Eigen::Array2d shift = 0.5 * (upper + lower);
  const double distance = (0.5 * (upper - lower) / reach).maxCoeff();
  pinhole.fx *= settings.zoom;
  pinhole.fy *= settings.zoom;
  RenderCamera camera;
  camera.sensor = pinhole;
  camera.T_world_camera.linear() = R;
  camera.T_world_camera.translation() = mesh.origin_m + center + R * Eigen::Vector3d(shift.x(), shift.y(), -distance);
  return camera;
}

Eigen::Vector3d guess_up(const Mesh& mesh) {
  constexpr double kAcross = 0.985;  // within 10 degrees
  constexpr double kShare = 0.2;
  Eigen::Vector3d positive = Eigen::Vector3d::Zero(), negative = Eigen::Vector3d::Zero();
  double total = 0;
  for (const Triangle& t : mesh.triangles) {
    const Eigen::Vector3d n = area_normal(mesh, t);
    const double area = n.norm();
    total += area;
    for (int axis = 0; axis < 3; ++axis) {
      if (n[axis] > kAcross * area) positive[axis] += area;
      if (-n[axis] > kAcross * area) negative[axis] += area;
    }
  }
  int axis = 0;
  const double most = (positive + negative).maxCoeff(&axis);
  if (!(most > kShare * total)) return Eigen::Vector3d::UnitY();
  const double sign = negative[axis] > 1.1 * positive[axis] ? -1.0 : 1.0;
  return sign * Eigen::Vector3d::Unit(axis);
}

}  // namespace lapseam
