#pragma once

// Views of shapes whose every ray is known in closed form, with exact poses. For tests only.

#include <Eigen/Geometry>
#include <cmath>
#include <functional>
#include <limits>
#include <optional>
#include <random>
#include <vector>

#include "lapseam/view.h"

namespace lapseam::test {

/// Distance along a unit ray (origin, direction) to the surface, if it is hit.
using Shape = std::function<std::optional<double>(const Eigen::Vector3d&, const Eigen::Vector3d&)>;

inline Shape plane(const Eigen::Vector3d& point, const Eigen::Vector3d& normal) {
  return [=](const Eigen::Vector3d& o, const Eigen::Vector3d& d) -> std::optional<double> {
    const double t = (point - o).dot(normal) / d.dot(normal);
    return t > 1e-9 && std::isfinite(t) ? std::optional(t) : std::nullopt;
  };
}

/// A rectangle in a plane of constant z, [x0, x1] × [y0, y1].
inline Shape rectangle(double z, double x0, double x1, double y0, double y1) {
  return [=](const Eigen::Vector3d& o, const Eigen::Vector3d& d) -> std::optional<double> {
    const double t = (z - o.z()) / d.z();
    if (!(t > 1e-9) || !std::isfinite(t)) return std::nullopt;
    const Eigen::Vector3d p = o + t * d;
    if (p.x() < x0 || p.x() > x1 || p.y() < y0 || p.y() > y1) return std::nullopt;
    return t;
  };
}

inline Shape sphere(const Eigen::Vector3d& center, double radius) {
  return [=](const Eigen::Vector3d& o, const Eigen::Vector3d& d) -> std::optional<double> {
    const Eigen::Vector3d to = center - o;
    const double along = to.dot(d), squared = to.squaredNorm() - along * along;
    if (squared > radius * radius) return std::nullopt;
    const double half = std::sqrt(radius * radius - squared);
    if (along - half > 1e-9) return along - half;
    if (along + half > 1e-9) return along + half;
    return std::nullopt;
  };
}

/// Inside of an axis-aligned box.
inline Shape box_room(const Eigen::Vector3d& low, const Eigen::Vector3d& high) {
  return [=](const Eigen::Vector3d& o, const Eigen::Vector3d& d) -> std::optional<double> {
    double best = std::numeric_limits<double>::infinity();
    for (int k = 0; k < 3; ++k) {
      if (d[k] == 0) continue;
      best = std::min(best, ((d[k] > 0 ? high[k] : low[k]) - o[k]) / d[k]);
    }
    return best > 1e-9 && std::isfinite(best) ? std::optional(best) : std::nullopt;
  };
}

inline Shape nearest(std::vector<Shape> shapes) {
  return [shapes = std::move(shapes)](const Eigen::Vector3d& o, const Eigen::Vector3d& d) -> std::optional<double> {
    std::optional<double> best;
    for (const Shape& shape : shapes)
      if (const auto t = shape(o, d); t && (!best || *t < *best)) best = t;
    return best;
  };
}

/// A camera at `eye` that looks at `target`: x right, y down, z forward.
inline Eigen::Isometry3d look_at(const Eigen::Vector3d& eye, const Eigen::Vector3d& target) {
  const Eigen::Vector3d forward = (target - eye).normalized();
  const Eigen::Vector3d up = std::abs(forward.z()) < 0.9 ? Eigen::Vector3d::UnitZ() : Eigen::Vector3d::UnitY();
  const Eigen::Vector3d right = forward.cross(up).normalized(), down = forward.cross(right);
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.linear().col(0) = right;
  T.linear().col(1) = down;
  T.linear().col(2) = forward;
  T.translation() = eye;
  return T;
}

inline PinholeSensor small_camera(int size = 120, double focal = 110) {
  return {size, size, focal, focal, 0.5 * (size - 1), 0.5 * (size - 1), {}};
}

/// Ray-casts a view. sigma_m: Gaussian noise of the range, seeded.
inline View make_view(const std::string& name, const Sensor& sensor, const Eigen::Isometry3d& T_world_view,
                      const Shape& shape, double sigma_m = 0, unsigned seed = 1) {
  View view{name, "test", sensor, RangeImage(width(sensor), height(sensor)), T_world_view};
  std::mt19937 random(seed);
  std::normal_distribution<double> noise(0, 1);
  for (int v = 0; v < view.range.height; ++v)
    for (int u = 0; u < view.range.width; ++u) {
      const Eigen::Vector3d a = T_world_view * unproject(sensor, u, v, 1.0),
                            b = T_world_view * unproject(sensor, u, v, 2.0);
      const Eigen::Vector3d direction = (b - a).normalized();
      const Eigen::Vector3d origin = a - (b - a);
      if (const auto t = shape(origin, direction)) {
        const double r = *t / (b - a).norm() + sigma_m * noise(random);
        if (r > 0) view.range.at(u, v) = float(r);
      }
    }
  return view;
}

/// The same as a source that needs no file.
inline ViewSource as_source(View view) {
  ViewSource source;
  source.name = view.name;
  source.sensor = view.sensor;
  source.sensor_id = view.sensor_id;
  source.T_world_view = view.T_world_view;
  source.range.format = RangeFormat::kMemory;
  source.range.memory = std::make_shared<RangeImage>(std::move(view.range));
  return source;
}

}  // namespace lapseam::test
