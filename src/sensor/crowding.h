#pragma once

// Rows of a scanner meet in its poles.

#include <algorithm>

#include "lapseam/sensor.h"

namespace lapseam {

/// How many samples of a row fit into the distance between rows there: thousands next to a pole, 1 where samples lie no
/// closer together than rows, and for all other sensors.
inline int samples_per_row_step(const Sensor& sensor, int v) {
  if (!std::holds_alternative<SphericalSensor>(sensor) || width(sensor) < 2 || height(sensor) < 2) return 1;
  const auto ray = [&](int x, int y) { return unproject(sensor, double(x), double(y), 1.0); };
  const double along = (ray(1, v) - ray(0, v)).norm(), across = (ray(0, v > 0 ? v - 1 : 1) - ray(0, v)).norm();
  if (!(across < double(width(sensor)) * along)) return width(sensor);
  return std::max(1, int(across / along));
}

}  // namespace lapseam
