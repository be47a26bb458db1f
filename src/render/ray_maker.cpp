#include "render/ray_maker.h"

#include <algorithm>

namespace lapseam {

RayMaker::RayMaker(const RenderCamera& camera, const Eigen::Vector3d& mesh_origin_m)
    : sensor_(camera.sensor), T_local_camera_(camera.T_world_camera) {
  T_local_camera_.translation() -= mesh_origin_m;
  const int columns = lapseam::width(sensor_), rows = lapseam::height(sensor_);
  width_ = camera.width > 0 ? camera.width : columns;
  height_ = camera.height > 0 ? camera.height : rows;
  u_per_x_ = double(columns) / width_;
  v_per_y_ = double(rows) / height_;
}

Ray RayMaker::ray(double x, double y) const {
  // At range 0 every sensor has the point where its ray begins.
  const double u = to_u(x), v = to_v(y);
  return {T_local_camera_ * unproject(sensor_, u, v, 0.0), T_local_camera_.linear() * ray_direction(sensor_, u, v)};
}

std::optional<PicturePoint> RayMaker::project(const Eigen::Vector3d& local_point) const {
  const Eigen::Vector3d p = T_local_camera_.inverse() * local_point;
  const std::optional<PixelRange> pixel = lapseam::project(sensor_, p);
  if (!pixel) return std::nullopt;
  const PicturePoint point{(pixel->u + 0.5) / u_per_x_ - 0.5, (pixel->v + 0.5) / v_per_y_ - 0.5,
                           (p - unproject(sensor_, pixel->u, pixel->v, 0.0)).norm()};
  if (!(point.x >= -0.5 && point.x <= width_ - 0.5 && point.y >= -0.5 && point.y <= height_ - 0.5)) return std::nullopt;
  return point;
}

double RayMaker::pixel_width_m(double x, double y, double distance_m) const {
  const Ray here = ray(x, y);
  const Ray right = ray(x + 1, y), below = ray(x, y + 1);
  const Eigen::Vector3d p = here.origin + distance_m * here.direction;
  const auto step = [&](const Ray& other) { return (other.origin + distance_m * other.direction - p).norm(); };
  return std::max(step(right), step(below));
}

}  // namespace lapseam
