#pragma once

// Large planes that several views show parts of: floors, ceilings, walls.

#include <Eigen/Geometry>
#include <span>
#include <vector>

#include "register/associate.h"

namespace lapseam {

/// normal · p = offset_m, in world coordinates; the normal is towards the sensors that see it.
struct Plane {
  Eigen::Vector3d normal = Eigen::Vector3d::UnitZ();
  double offset_m = 0;
  double distance_to(const Eigen::Vector3d& p) const { return normal.dot(p) - offset_m; }
};

/// The planes on which most surface lies, largest first: each the best of many that go through a surfel along its
/// normal, fitted to what lies within reach_m of it, and taken away. Deterministic.
std::vector<Plane> find_planes(std::span<const Posed> views, double reach_m);

}  // namespace lapseam
