#pragma once

// Poses by themselves: how far two sets of them differ, and sets that differ by a given amount, to try things on.

#include <Eigen/Geometry>
#include <cstdint>
#include <span>
#include <vector>

namespace lapseam {

struct PerturbOptions {
  double translation_m = 0;  ///< length of the shift, in a direction that the seed gives
  double rotation_rad = 0;   ///< angle of the turn about the view's own origin, about an axis that the seed gives
  std::uint64_t seed = 1;
};

/// Poses off by exactly the given amounts, each in directions of its own; the first stays, so that the frame does.
/// What happens to a pose depends on the seed and its place alone.
std::vector<Eigen::Isometry3d> perturb_poses(std::span<const Eigen::Isometry3d> T_world_view,
                                             const PerturbOptions& options);

/// The rigid motion T that brings T · poses nearest to the truth: least sum of the distances of each view's origin and
/// of three points around it as far away as the origins are spread, and 1 m at least. Needs as many of both.
Eigen::Isometry3d align_poses(std::span<const Eigen::Isometry3d> poses, std::span<const Eigen::Isometry3d> truth);

/// How far poses are from the truth, as they stand. Median and 90th percentile over the views.
struct PoseErrors {
  std::vector<double> translation_m, rotation_rad;  ///< one per view
  double median_translation_m = 0, p90_translation_m = 0, max_translation_m = 0;
  double median_rotation_rad = 0, p90_rotation_rad = 0, max_rotation_rad = 0;
};
PoseErrors compare_poses(std::span<const Eigen::Isometry3d> poses, std::span<const Eigen::Isometry3d> truth);

}  // namespace lapseam
