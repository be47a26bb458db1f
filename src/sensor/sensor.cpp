// Access to a sensor of any kind.

#include "lapseam/sensor.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

namespace lapseam {
namespace {

template <class... F>
struct Overloaded : F... {
  using F::operator()...;
};
template <class... F>
Overloaded(F...) -> Overloaded<F...>;

// Neighbours of a measured grid may be staggered or noisy; the spacing is taken over an even number of steps.
constexpr int kSpacingReach_px = 4;

// The part of a displacement that is seen across the ray.
double across(const Eigen::Vector3d& displacement, const Eigen::Vector3d& ray) {
  return (displacement - ray * ray.dot(displacement)).norm();
}

}  // namespace

int width(const Sensor& sensor) {
  return std::visit(
      Overloaded{[](const SphericalSensor& s) { return s.columns(); }, [](const auto& s) { return s.width; }}, sensor);
}

int height(const Sensor& sensor) {
  return std::visit(
      Overloaded{[](const SphericalSensor& s) { return s.rows(); }, [](const auto& s) { return s.height; }}, sensor);
}

std::string_view kind_name(const Sensor& sensor) {
  return std::visit(
      Overloaded{[](const PinholeSensor&) { return "pinhole"; }, [](const SphericalSensor&) { return "spherical"; },
                 [](const OrthographicSensor&) { return "orthographic"; },
                 [](const MeasuredGridSensor&) { return "measured_grid"; }},
      sensor);
}

bool wraps(const Sensor& sensor) {
  const auto* spherical = std::get_if<SphericalSensor>(&sensor);
  return spherical && spherical->wraps();
}

bool is_central(const Sensor& sensor) {
  return std::holds_alternative<PinholeSensor>(sensor) || std::holds_alternative<SphericalSensor>(sensor);
}

Eigen::Vector3d unproject(const Sensor& sensor, double u, double v, double r) {
  return std::visit([&](const auto& s) { return s.unproject(u, v, r); }, sensor);
}

std::optional<PixelRange> project(const Sensor& sensor, const Eigen::Vector3d& p) {
  PixelRange out;
  if (!std::visit([&](const auto& s) { return s.project(p, out); }, sensor)) return std::nullopt;
  return out;
}

Eigen::Vector3d ray_direction(const Sensor& sensor, double u, double v) {
  return (unproject(sensor, u, v, 2.0) - unproject(sensor, u, v, 1.0)).normalized();
}

int handedness(const Sensor& sensor) {
  const auto sign = [](double x) { return x < 0 ? -1 : 1; };
  return std::visit(Overloaded{[&](const PinholeSensor& s) { return sign(s.fx * s.fy); },
                               [&](const SphericalSensor& s) {
                                 // Looking along the ray with z up, azimuth grows to the left and elevation upwards.
                                 const double columns = s.azimuth_rad.back() - s.azimuth_rad.front();
                                 const double rows = s.elevation_rad.back() - s.elevation_rad.front();
                                 return columns * rows == 0 ? 1 : sign(columns * rows);
                               },
                               [&](const OrthographicSensor& s) { return sign(s.pitch_x_m * s.pitch_y_m); },
                               [&](const MeasuredGridSensor& s) {
                                 const double u = 0.5 * (s.width - 1), v = 0.5 * (s.height - 1);
                                 const Eigen::Vector3d a = (s.rational[0] - u * s.rational[1]).head<3>();
                                 const Eigen::Vector3d b = (s.rational[2] - v * s.rational[3]).head<3>();
                                 return sign(a.cross(b).dot(s.forward));
                               }},
                    sensor);
}

double sample_spacing(const Sensor& sensor, double u, double v, double r) {
  const double reach = std::holds_alternative<MeasuredGridSensor>(sensor) ? kSpacingReach_px : 0.5;
  const double w = width(sensor), h = height(sensor);
  const double u0 = std::clamp(u - reach, -0.5, w - 0.5), u1 = std::clamp(u + reach, -0.5, w - 0.5);
  const double v0 = std::clamp(v - reach, -0.5, h - 0.5), v1 = std::clamp(v + reach, -0.5, h - 0.5);
  const Eigen::Vector3d ray = ray_direction(sensor, u, v);
  const double du = across(unproject(sensor, u1, v, r) - unproject(sensor, u0, v, r), ray) / (u1 - u0);
  const double dv = across(unproject(sensor, u, v1, r) - unproject(sensor, u, v0, r), ray) / (v1 - v0);
  return std::sqrt(du * dv);
}

namespace {

// The table as if its steps were all alike; itself where they are.
std::vector<double> evened(const std::vector<double>& table) {
  constexpr double kEven = 1e-9;
  std::vector<double> out = table;
  double farthest = 0;
  for (std::size_t i = 0; i < table.size(); ++i) {
    out[i] =
        table.front() + (table.back() - table.front()) * double(i) / double(std::max<std::size_t>(1, table.size() - 1));
    farthest = std::max(farthest, std::abs(out[i] - table[i]));
  }
  return farthest < kEven ? table : out;
}

}  // namespace

SpacingLine spacing_line(const Sensor& given) {
  Sensor sensor = given;
  if (auto* spherical = std::get_if<SphericalSensor>(&sensor)) {
    spherical->azimuth_rad = evened(spherical->azimuth_rad);
    spherical->elevation_rad = evened(spherical->elevation_rad);
  }
  const double u = 0.5 * (width(sensor) - 1), v = 0.5 * (height(sensor) - 1);
  const double at_one = sample_spacing(sensor, u, v, 1.0), at_two = sample_spacing(sensor, u, v, 2.0);
  return {2 * at_one - at_two, at_two - at_one};
}

}  // namespace lapseam
