#include <algorithm>
#include <cmath>
#include <numbers>

#include "lapseam/sensor.h"
#include "sensor/warped_grid.h"

namespace lapseam {
namespace {

constexpr double kPi = std::numbers::pi, kTwoPi = 2 * kPi;

using Table = std::vector<double>;

double mean_step(const Table& table) { return (table.back() - table.front()) / double(table.size() - 1); }

// Angles at fractional indices of a monotone table: linear between entries, and beyond the ends with a given step.
struct AngleAxis {
  const Table& table;
  double step_before, step_after;

  int last_index() const { return int(table.size()) - 1; }

  double angle_at(double index) const {
    const int last = last_index();
    if (index <= 0) return table.front() + index * step_before;
    if (index >= last) return table.back() + (index - last) * step_after;
    const int i = int(index);
    const double t = index - i;
    return table[std::size_t(i)] * (1 - t) + table[std::size_t(i) + 1] * t;
  }

  // The inverse of angle_at. Interpolation search: on a uniform table the first guess is right, or one off by rounding.
  double index_of(double angle) const {
    const int last = last_index();
    const double sign = step_after > 0 ? 1 : -1;
    if (sign * (angle - table.front()) <= 0) return (angle - table.front()) / step_before;
    if (sign * (angle - table.back()) >= 0) return last + (angle - table.back()) / step_after;
    const auto is_in = [&](int i) {
      return sign * (angle - table[std::size_t(i)]) >= 0 && sign * (angle - table[std::size_t(i) + 1]) < 0;
    };
    int i = std::clamp(int((angle - table.front()) / (table.back() - table.front()) * last), 0, last - 1);
    if (!is_in(i)) {
      if (i > 0 && is_in(i - 1)) {
        --i;
      } else {
        const auto after = std::upper_bound(table.begin(), table.end(), angle,
                                            [&](double value, double entry) { return sign * (entry - value) > 0; });
        i = std::clamp(int(after - table.begin()) - 1, 0, last - 1);
      }
    }
    const double a = table[std::size_t(i)], b = table[std::size_t(i) + 1];
    return i + (angle - a) / (b - a);
  }
};

// A single row or column has no step of its own: its pixels are taken to be square.
AngleAxis open_axis(const Table& table, const Table& other) {
  const std::size_t n = table.size();
  if (n > 1) return {table, table[1] - table[0], table[n - 1] - table[n - 2]};
  const double step = other.size() > 1 ? std::abs(mean_step(other)) : kPi / 180;
  return {table, step, step};
}

AngleAxis azimuth_axis(const SphericalSensor& sensor, bool wraps) {
  if (!wraps) return open_axis(sensor.azimuth_rad, sensor.elevation_rad);
  const Table& table = sensor.azimuth_rad;
  const double span = table.back() - table.front();
  const double gap = (span > 0 ? kTwoPi : -kTwoPi) - span;
  return {table, gap, gap};
}

Table angles_between(int count, double begin, double end) {
  Table table(static_cast<std::size_t>(count));
  for (int i = 0; i < count; ++i) table[std::size_t(i)] = begin + (i + 0.5) / count * (end - begin);
  return table;
}

// From where the tables put a direction to the pixel that looks there. On a full circle pixels near one end may look
// beyond the other.
bool invert_warp(const SphericalSensor& sensor, bool is_circle, PixelRange& pixel) {
  const int columns = sensor.columns();
  const Eigen::Vector2d q(pixel.u, pixel.v);
  if (!WarpedGrid(columns, sensor.rows(), *sensor.warp, is_circle).invert(q, pixel.u, pixel.v)) return false;
  if (is_circle && pixel.u < -0.5) pixel.u += columns;
  if (is_circle && pixel.u > columns - 0.5) pixel.u -= columns;
  return true;
}

}  // namespace

SphericalSensor SphericalSensor::from_limits(int width, int height, double az_begin_rad, double az_end_rad,
                                             double el_begin_rad, double el_end_rad) {
  return {angles_between(width, az_begin_rad, az_end_rad), angles_between(height, el_begin_rad, el_end_rad)};
}

bool SphericalSensor::wraps() const {
  if (azimuth_rad.size() < 2) return false;
  const double step = std::abs(mean_step(azimuth_rad));
  return std::abs(std::abs(azimuth_rad.back() - azimuth_rad.front()) + step - kTwoPi) <= 0.5 * step;
}

Eigen::Vector3d SphericalSensor::unproject(double u, double v, double r) const {
  if (warp) {
    const Eigen::Vector2d q = WarpedGrid(columns(), rows(), *warp, wraps()).at(u, v);
    u = q.x();
    v = q.y();
  }
  const double azimuth = azimuth_axis(*this, wraps()).angle_at(u);
  const double elevation = open_axis(elevation_rad, azimuth_rad).angle_at(v);
  const double level = r * std::cos(elevation);
  return {level * std::cos(azimuth), level * std::sin(azimuth), r * std::sin(elevation)};
}

bool SphericalSensor::project(const Eigen::Vector3d& p, PixelRange& out) const {
  const double r = p.norm();
  if (!(r > 0) || !std::isfinite(r)) return false;
  const bool is_circle = wraps();
  // The turn that brings the angle nearest to the middle of the table; a full circle has no other.
  double azimuth = std::atan2(p.y(), p.x());
  const double middle = 0.5 * (azimuth_rad.front() + azimuth_rad.back());
  azimuth += kTwoPi * std::round((middle - azimuth) / kTwoPi);
  const double u = azimuth_axis(*this, is_circle).index_of(azimuth);
  const double elevation = std::atan2(p.z(), std::hypot(p.x(), p.y()));
  const double v = open_axis(elevation_rad, azimuth_rad).index_of(elevation);
  out = {u, v, r};
  if (warp && !invert_warp(*this, is_circle, out)) return false;
  // What rounding moves over the edge of the image still belongs to it.
  constexpr double kSlack_px = 1e-9;
  const double below = -0.5 - kSlack_px, above = -0.5 + kSlack_px;
  return out.u >= below && out.u <= columns() + above && out.v >= below && out.v <= rows() + above;
}

}  // namespace lapseam
