#pragma once

// The camera of a view's colour image, in the frame of the mesh.

#include <Eigen/Geometry>
#include <memory>
#include <span>
#include <vector>

#include "lapseam/view.h"
#include "texture/image_warp.h"

namespace lapseam {

class ColorCamera {
 public:
  /// source: has a colour image, and lives as long.
  ColorCamera(const ViewSource& source, const Eigen::Vector3d& mesh_origin_m);

  /// Position in the image, in pixels. False when the camera cannot see it.
  bool project(const Eigen::Vector3f& position_m, Eigen::Vector2f& pixel) const;
  /// The same, as if the image went on by margins to all sides.
  bool project_beyond(const Eigen::Vector3f& position_m, Eigen::Vector2f& pixel) const;
  /// Where the ray of a pixel begins, and its unit direction.
  Eigen::Vector3f ray_origin(const Eigen::Vector2f& pixel) const;
  Eigen::Vector3f ray_direction(const Eigen::Vector2f& pixel) const;
  /// False only when the camera sees nothing of the ball.
  bool may_see(const Eigen::Vector3f& center_m, float radius_m) const;

  /// From now on the mesh is taken to lie moved by that before the camera.
  void move(const Eigen::Isometry3d& motion);

  /// From now on the image is taken to show things that much beside of where they should be. Not for one that wraps.
  void bend(ImageWarp warp);
  bool is_bent() const { return !warp_.nodes.empty(); }

  int width() const { return width_; }
  int height() const { return height_; }
  bool wraps() const { return wraps_; }
  /// Pixels; 0 for what is no pinhole camera.
  int margin_x() const { return std::holds_alternative<PinholeSensor>(camera_) ? width_ / 2 : 0; }
  int margin_y() const { return std::holds_alternative<PinholeSensor>(camera_) ? height_ / 2 : 0; }
  /// Distance from the middle of the image over half of its diagonal, squared: what vignetting depends on. 0 for all
  /// of a camera that is no pinhole.
  float squared_radius(const Eigen::Vector2f& pixel) const;

 private:
  void find_cone();
  Eigen::Vector2f unbent(const Eigen::Vector2f& pixel) const { return is_bent() ? warp_.undo(pixel) : pixel; }
  bool project_within(const Eigen::Vector3f& position_m, int margin_x, int margin_y, Eigen::Vector2f& pixel) const;

  const Sensor& camera_;
  Eigen::Isometry3d T_color_mesh_, T_mesh_color_;
  int width_, height_;
  bool wraps_, is_central_;
  Eigen::Vector3f center_, axis_;
  float cone_rad_ = 4;  ///< half of the opening; over π: not known, or all directions
  ImageWarp warp_;      ///< without nodes: none
};

/// One for each source with a colour image, null for the others.
using ColorCameras = std::vector<std::unique_ptr<ColorCamera>>;
ColorCameras make_color_cameras(std::span<const ViewSource> sources, const Eigen::Vector3d& mesh_origin_m);

/// Brings the corners of a triangle across the seam of a panorama to one side.
void unwrap(std::array<Eigen::Vector2f, 3>& pixels, int width);

}  // namespace lapseam
