#pragma once

// What the tests of simulation share.

#include <unistd.h>

#include <cstring>
#include <string>

#include "lapseam/context.h"
#include "lapseam/simulate.h"

namespace lapseam::test {

/// A flat wall in the plane z = 0 of side 2·half_m, seen from +z.
inline SimulatedScene make_wall(float half_m = 50) {
  SimulatedScene scene;
  scene.name = "wall";
  scene.mesh.positions_m = {{-half_m, -half_m, 0}, {half_m, -half_m, 0}, {half_m, half_m, 0}, {-half_m, half_m, 0}};
  scene.mesh.triangles = {{0, 1, 2}, {0, 2, 3}};
  return scene;
}

/// A view at `eye` that looks along -z of the world, y down in the image being -y of the world.
inline ViewSource look_down_from(const SensorRig& rig, const Eigen::Vector3d& eye) {
  ViewSource view;
  view.name = "000";
  view.sensor = rig.sensor;
  view.sensor_id = rig.id;
  view.color = rig.color;
  view.T_world_view.linear() << 1, 0, 0, 0, -1, 0, 0, 0, -1;
  view.T_world_view.translation() = eye;
  return view;
}

/// Keeps apart the files of test programs that run at the same time.
inline std::string process_id() { return std::to_string(::getpid()); }

inline SensorEffects no_effects() { return {}; }

template <typename T>
bool have_same_bytes(const Image<T>& a, const Image<T>& b) {
  return a.width == b.width && a.height == b.height &&
         std::memcmp(a.pixels.data(), b.pixels.data(), a.size() * sizeof(T)) == 0;
}

inline std::size_t count_samples(const RangeImage& range) {
  std::size_t count = 0;
  for (const float r : range.pixels) count += r > 0 ? 1 : 0;
  return count;
}

}  // namespace lapseam::test
