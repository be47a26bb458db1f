#pragma once

// Parts of trajectories.

#include <string>
#include <vector>

#include "lapseam/simulate.h"

namespace lapseam::simulation {

using Poses = std::vector<Eigen::Isometry3d>;

/// Pose of a sensor at `eye` that looks at `target`: z forward and y down for cameras, x forward and z up for lasers.
Eigen::Isometry3d look_at(const Sensor& sensor, const Eigen::Vector3d& eye, const Eigen::Vector3d& target);
Poses plan_walk(const SimulatedScene& scene, const SensorRig& rig, const TrajectoryOptions& options, Context& context);
Poses plan_stations(const SimulatedScene& scene, const SensorRig& rig, const TrajectoryOptions& options,
                    Context& context);
/// Views of a rig at these poses, named 000, 001, …
std::vector<ViewSource> views_at(const Poses& poses, const SensorRig& rig);

}  // namespace lapseam::simulation
