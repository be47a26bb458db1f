#pragma once

// What a colour camera sees of the model: the distance to it, and where that jumps.

#include "lapseam/image.h"
#include "spatial/ray_scene.h"
#include "texture/color_camera.h"

namespace lapseam {

/// Fringes are no wider, whatever is displaced.
inline constexpr float kMostDisplacement_px = 16;

/// One value for every stride × stride pixels of the colour image.
struct DepthImage {
  int stride = 1;
  Image<float> distance_m;  ///< along the ray; infinite where it meets nothing
  float angle_rad = 0;      ///< between the rays of neighbouring pixels, in the middle
  float pixel_m = 0;        ///< length of a pixel where the model is at its middle distance
  int fringe_px = 0;        ///< how far from a jump, at most, pixels are near it
  /// Within the fringe of a jump, where the colour may be that of the other side, or kForeign.
  Image<std::uint8_t> is_near_step;
  static constexpr std::uint8_t kForeign = 2;  ///< the colour is that of what is behind, see mark_foreign_colors

  int cell(float pixel) const { return int((pixel + 0.5f) / float(stride)); }
  bool is_fringe(const Eigen::Vector2f& pixel) const { return step_at(pixel) != 0; }
  bool is_foreign(const Eigen::Vector2f& pixel) const { return step_at(pixel) == kForeign; }
  /// Whether a point, at a pixel and a distance, is the first that the camera sees there. A fiftieth of the distance is
  /// allowed for what the model's surface and the image's coarseness are off.
  bool is_visible(const Eigen::Vector2f& pixel, float distance_m) const;
  /// Whether the image shows something else there: not visible, or beside a jump, where is_visible takes the farther
  /// side for several pixels, on its nearer side.
  bool is_hidden(const Eigen::Vector2f& pixel, float distance_m) const;

 private:
  std::uint8_t step_at(const Eigen::Vector2f& pixel) const;
};

/// Without fringes yet.
DepthImage render_depth(const ColorCamera& camera, const RayScene& scene, int stride);

/// displacement_px: how far the model and the image may be apart, beside a pixel and a half for the camera's own blur.
void mark_fringes(DepthImage& depth, bool wraps, double displacement_px);

/// Strides for cameras of these sizes: 2, or as much as keeps all the depth images within a bound. Their fringes are
/// wider than a stride.
int choose_stride(std::uint64_t pixels, std::uint64_t pixels_of_all_cameras);

}  // namespace lapseam
