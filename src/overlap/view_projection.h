#pragma once

// What can be worked out once per view or per pair of views, so that whole tiles of triangles need not be projected.

#include <Eigen/Geometry>
#include <vector>

#include "lapseam/patch.h"

namespace lapseam {

inline constexpr int kTile_px = 32;

/// A block of kTile_px × kTile_px samples of a patch, some of which triangles use, and a sphere around these and those
/// of the row and column that follow.
struct PatchTile {
  int u0 = 0, v0 = 0, u1 = 0, v1 = 0;  ///< samples [u0, u1) × [v0, v1)
  Eigen::Vector3f center_in_view = Eigen::Vector3f::Zero();
  float radius_m = 0;
};
/// The tiles of a patch in which a triangle uses a sample.
std::vector<PatchTile> make_tiles(const Patch& patch);

/// Everything a central sensor can see lies in this cone, between these ranges. Sensors with parallel or measured rays
/// have no cone: nothing is culled for them.
struct ViewCone {
  bool is_bounded = false;
  Eigen::Vector3f axis = Eigen::Vector3f::UnitZ();
  float cos_half_angle = -1, sin_half_angle = 0;
  float farthest_m = 0;  ///< distance from the sensor of its farthest sample

  bool can_see(const Eigen::Vector3f& center, float radius_m) const;
};
ViewCone make_cone(const Patch& patch);

/// The farthest range in blocks of an image: what lies behind it is hidden from the view, and most of what a cone
/// contains does.
class FarthestRanges {
 public:
  FarthestRanges() = default;
  explicit FarthestRanges(const Patch& patch);

  /// Whether a sphere, given in the view's frame, lies wholly behind what the view measured, by more than `slack_m`, or
  /// where it measured nothing. False when that is not clear.
  bool hide(const Eigen::Vector3f& center, float radius_m, float slack_m) const;

 private:
  static constexpr int kBlock_px = 16;
  struct Bounds {
    float u_low, u_high, v_low, v_high, nearest_r;
  };
  bool find_bounds(const Eigen::Vector3f& center, float radius_m, Bounds& out) const;

  const Patch* patch_ = nullptr;
  Image<float> farthest_;
};

}  // namespace lapseam
