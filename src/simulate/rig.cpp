// Sensors as they come out of the box.

#include <algorithm>
#include <cmath>
#include <numbers>
#include <string>

#include "lapseam/error.h"
#include "lapseam/simulate.h"

namespace lapseam {
namespace {

void check_size(int width, int height) {
  if (width < 2 || height < 2) throw InvalidInput({}, {}, "sensor size", "must be at least 2 × 2 pixels");
}

}  // namespace

SensorRig make_rgbd_rig(int width, int height, double focal_px) {
  check_size(width, height);
  const double f = focal_px > 0 ? focal_px : 525.0 / 640.0 * width;
  const PinholeSensor camera{width, height, f, f, 0.5 * (width - 1), 0.5 * (height - 1), {}};
  SensorRig rig{"rgbd", camera, ColorSource{{}, camera, Eigen::Isometry3d::Identity(), nullptr}, {}};
  // 0.0012 + 0.0019 (z − 0.4)², multiplied out (Nguyen, Izadi, Lovell 2012).
  rig.effects.noise = {0.0012 + 0.0019 * 0.16, -0.0019 * 0.8, 0.0019, 0.0012};
  rig.effects.min_range_m = 0.4;
  rig.effects.max_range_m = 4.5;
  rig.effects.grazing_cosine = 0.08;
  return rig;
}

SensorRig make_laser_rig(int width, int height, double el_top_rad, double el_bottom_rad) {
  check_size(width, height);
  constexpr double kHalfTurn = std::numbers::pi;
  if (!(el_top_rad > el_bottom_rad && el_top_rad <= 0.5 * kHalfTurn + 1e-9 && el_bottom_rad >= -0.5 * kHalfTurn - 1e-9))
    throw InvalidInput({}, {}, "elevation limits", "must lie within ±90°, the upper above the lower");
  // Azimuth falls with u, so that the panorama is not mirrored.
  const Sensor sensor = SphericalSensor::from_limits(width, height, kHalfTurn, -kHalfTurn, el_top_rad, el_bottom_rad);
  SensorRig rig{"laser", sensor, ColorSource{{}, sensor, Eigen::Isometry3d::Identity(), nullptr}, {}};
  rig.effects.noise = {0.002, 0, 0, 0};
  rig.effects.min_range_m = 0.3;
  rig.effects.max_range_m = 60;
  rig.effects.grazing_cosine = 0.05;
  return rig;
}

SensorRig make_ortho_rig(int width, int height, double extent_m) {
  check_size(width, height);
  if (!(extent_m > 0)) throw InvalidInput({}, {}, "extent", "must be positive");
  const double pitch = extent_m / std::min(width, height);
  const OrthographicSensor camera{width, height, pitch, pitch, 0.5 * (width - 1), 0.5 * (height - 1)};
  SensorRig rig{"ortho", camera, ColorSource{{}, camera, Eigen::Isometry3d::Identity(), nullptr}, {}};
  rig.effects.noise = {0.0001, 0, 0, 0};
  rig.effects.grazing_cosine = 0.08;
  return rig;
}

SensorEffects scaled(const SensorEffects& effects, double scale) {
  if (!(scale >= 0)) throw InvalidInput({}, {}, "noise scale", "must not be negative");
  SensorEffects out = effects;
  out.noise = effects.noise.scaled(scale);
  if (scale == 0) {
    out.quantization_m = out.quantization_2_per_m = 0;
    out.grazing_cosine = out.dark_dropout = out.specular_dropout = 0;
    out.has_mixed_pixels = false;
  }
  return out;
}

}  // namespace lapseam
