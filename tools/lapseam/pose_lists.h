#pragma once

// The poses of two scenes, side by side.

#include <string>
#include <vector>

#include "lapseam/poses.h"
#include "lapseam/view.h"

namespace lapseam::tool {

struct PosePairs {
  std::vector<std::string> names;
  std::vector<Eigen::Isometry3d> poses, truth;
};

/// The views that both scenes have, by name, in the order of the first. Throws InvalidInput when there is none.
PosePairs match_poses(const Scene& scene, const Scene& truth);

}  // namespace lapseam::tool
