#pragma once

// From pixels of a picture to rays in the mesh's local frame, and back.

#include <Eigen/Geometry>
#include <optional>

#include "lapseam/render.h"

namespace lapseam {

struct Ray {
  Eigen::Vector3d origin, direction;  ///< direction of unit length
};

/// Where a point is in the picture, and how far from where its ray begins.
struct PicturePoint {
  double x = 0, y = 0;  ///< pixels of the picture, centres at integers
  double distance_m = 0;
};

class RayMaker {
 public:
  RayMaker(const RenderCamera& camera, const Eigen::Vector3d& mesh_origin_m);

  int width() const { return width_; }
  int height() const { return height_; }

  Ray ray(double x, double y) const;
  /// Nothing when the point is outside of the picture.
  std::optional<PicturePoint> project(const Eigen::Vector3d& local_point) const;
  /// Width of a pixel of the picture at a distance along the ray through (x, y).
  double pixel_width_m(double x, double y, double distance_m) const;

 private:
  double to_u(double x) const { return (x + 0.5) * u_per_x_ - 0.5; }
  double to_v(double y) const { return (y + 0.5) * v_per_y_ - 0.5; }

  const Sensor& sensor_;
  Eigen::Isometry3d T_local_camera_;
  int width_, height_;
  double u_per_x_, v_per_y_;
};

}  // namespace lapseam
