#include "texture/color_camera.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

namespace lapseam {

ColorCamera::ColorCamera(const ViewSource& source, const Eigen::Vector3d& mesh_origin_m)
    : camera_(source.color->camera),
      T_color_mesh_((source.T_world_view * source.color->T_view_color).inverse() * Eigen::Translation3d(mesh_origin_m)),
      T_mesh_color_(T_color_mesh_.inverse()),
      width_(lapseam::width(camera_)),
      height_(lapseam::height(camera_)),
      wraps_(lapseam::wraps(camera_)),
      is_central_(lapseam::is_central(camera_)),
      center_(T_mesh_color_.translation().cast<float>()),
      axis_(Eigen::Vector3f::UnitZ()) {
  if (is_central_) find_cone();
}

void ColorCamera::move(const Eigen::Isometry3d& motion) {
  T_color_mesh_ = T_color_mesh_ * motion;
  T_mesh_color_ = T_color_mesh_.inverse();
  center_ = T_mesh_color_.translation().cast<float>();
  if (is_central_) find_cone();
}

void ColorCamera::bend(ImageWarp warp) {
  warp_ = std::move(warp);
  if (is_central_) find_cone();
}

bool ColorCamera::project(const Eigen::Vector3f& position_m, Eigen::Vector2f& pixel) const {
  return project_within(position_m, 0, 0, pixel);
}

bool ColorCamera::project_beyond(const Eigen::Vector3f& position_m, Eigen::Vector2f& pixel) const {
  return project_within(position_m, margin_x(), margin_y(), pixel);
}

bool ColorCamera::project_within(const Eigen::Vector3f& position_m, int margin_x, int margin_y,
                                 Eigen::Vector2f& pixel) const {
  const auto out = lapseam::project(camera_, T_color_mesh_ * position_m.cast<double>());
  if (!out || !(out->r > 0)) return false;
  pixel = {float(out->u), float(out->v)};
  if (is_bent()) pixel += warp_.at(pixel);
  return pixel.x() >= -0.5f - float(margin_x) && pixel.x() <= float(width_ + margin_x) - 0.5f &&
         pixel.y() >= -0.5f - float(margin_y) && pixel.y() <= float(height_ + margin_y) - 0.5f;
}

Eigen::Vector3f ColorCamera::ray_origin(const Eigen::Vector2f& pixel) const {
  // At range 0 every sensor has the point where its ray begins.
  if (is_central_) return center_;
  const Eigen::Vector2f at = unbent(pixel);
  return (T_mesh_color_ * unproject(camera_, double(at.x()), double(at.y()), 0.0)).cast<float>();
}

Eigen::Vector3f ColorCamera::ray_direction(const Eigen::Vector2f& pixel) const {
  const Eigen::Vector2f at = unbent(pixel);
  return (T_mesh_color_.linear() * lapseam::ray_direction(camera_, double(at.x()), double(at.y()))).cast<float>();
}

void ColorCamera::find_cone() {
  constexpr int kSteps = 16;
  std::vector<Eigen::Vector3f> directions;
  Eigen::Vector3f sum = Eigen::Vector3f::Zero();
  for (int j = 0; j <= kSteps; ++j)
    for (int i = 0; i <= kSteps; ++i) {
      const Eigen::Vector2f pixel(float(width_) * float(i) / kSteps - 0.5f, float(height_) * float(j) / kSteps - 0.5f);
      directions.push_back(ray_direction(pixel));
      sum += directions.back();
    }
  if (!(sum.norm() > 0.5f * float(directions.size()))) return;  // all around
  axis_ = sum.normalized();
  float lowest = 1;
  for (const Eigen::Vector3f& direction : directions) lowest = std::min(lowest, axis_.dot(direction));
  // Between the directions that were tried the outline may bulge; at the axis of a panorama it is not convex at all.
  const float cone = std::acos(std::clamp(lowest, -1.0f, 1.0f)) * 1.1f;
  if (cone < 0.45f * std::numbers::pi_v<float>) cone_rad_ = cone;
}

bool ColorCamera::may_see(const Eigen::Vector3f& center_m, float radius_m) const {
  if (!is_central_ || cone_rad_ > std::numbers::pi_v<float>) return true;
  const Eigen::Vector3f to = center_m - center_;
  const float distance = to.norm();
  if (distance <= radius_m) return true;
  const float off_axis = std::acos(std::clamp(axis_.dot(to) / distance, -1.0f, 1.0f));
  return off_axis <= cone_rad_ + std::asin(std::min(1.0f, radius_m / distance));
}

float ColorCamera::squared_radius(const Eigen::Vector2f& pixel) const {
  if (!std::holds_alternative<PinholeSensor>(camera_)) return 0;  // no one lens has seen all of it
  const Eigen::Vector2f half(0.5f * float(width_), 0.5f * float(height_));
  return (pixel + Eigen::Vector2f(0.5f, 0.5f) - half).squaredNorm() / half.squaredNorm();
}

ColorCameras make_color_cameras(std::span<const ViewSource> sources, const Eigen::Vector3d& mesh_origin_m) {
  ColorCameras cameras(sources.size());
  for (std::size_t i = 0; i < sources.size(); ++i)
    if (sources[i].color) cameras[i] = std::make_unique<ColorCamera>(sources[i], mesh_origin_m);
  return cameras;
}

void unwrap(std::array<Eigen::Vector2f, 3>& pixels, int width) {
  const float half = 0.5f * float(width);
  const float right = std::max({pixels[0].x(), pixels[1].x(), pixels[2].x()});
  for (Eigen::Vector2f& q : pixels)
    if (right - q.x() > half) q.x() += float(width);
}

}  // namespace lapseam
