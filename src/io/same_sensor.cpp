#include "io/scene_formats.h"

namespace lapseam {
namespace {

bool is_same(const PinholeSensor& a, const PinholeSensor& b) {
  const BrownDistortion &da = a.distortion, &db = b.distortion;
  return a.width == b.width && a.height == b.height && a.fx == b.fx && a.fy == b.fy && a.cx == b.cx && a.cy == b.cy &&
         da.k1 == db.k1 && da.k2 == db.k2 && da.p1 == db.p1 && da.p2 == db.p2 && da.k3 == db.k3;
}

bool is_same(const SphericalSensor& a, const SphericalSensor& b) {
  const bool has_same_warp = a.warp == b.warp || (a.warp && b.warp && *a.warp == *b.warp);
  return has_same_warp && a.azimuth_rad == b.azimuth_rad && a.elevation_rad == b.elevation_rad;
}

bool is_same(const OrthographicSensor& a, const OrthographicSensor& b) {
  return a.width == b.width && a.height == b.height && a.pitch_x_m == b.pitch_x_m && a.pitch_y_m == b.pitch_y_m &&
         a.cx == b.cx && a.cy == b.cy;
}

bool is_same(const MeasuredGridSensor& a, const MeasuredGridSensor& b) {
  return a.width == b.width && a.height == b.height && a.rational == b.rational && a.forward == b.forward &&
         a.range_offset_m == b.range_offset_m && a.warp == b.warp;
}

}  // namespace

bool is_same_sensor(const Sensor& a, const Sensor& b) {
  if (a.index() != b.index()) return false;
  return std::visit(
      [&](const auto& model) {
        using Model = std::decay_t<decltype(model)>;
        return is_same(model, std::get<Model>(b));
      },
      a);
}

bool is_same_noise(const NoiseModel& a, const NoiseModel& b) {
  return a.s0_m == b.s0_m && a.s1 == b.s1 && a.s2_per_m == b.s2_per_m && a.floor_m == b.floor_m &&
         a.correlation == b.correlation && a.pointing_rad == b.pointing_rad && a.intensity_power == b.intensity_power &&
         a.intensity_reference == b.intensity_reference;
}

}  // namespace lapseam
