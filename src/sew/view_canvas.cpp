#include "sew/view_canvas.h"

#include <algorithm>
#include <cmath>

#include "patch/same_surface.h"

namespace lapseam {

ViewCanvas::ViewCanvas(const Patch& patch, const Eigen::Vector3d& origin_m, const OverlapOptions& options, int shift)
    : patch_(patch), options_(options), shift_(shift), width_(patch.grid.width), height_(patch.grid.height) {
  const Eigen::Isometry3d T_model_view = Eigen::Translation3d(-origin_m) * patch.view.T_world_view;
  T_view_model_d_ = T_model_view.inverse();
  T_view_model_ = T_view_model_d_.cast<float>();
  T_model_view_ = T_model_view.cast<float>();
  sensor_position_m_ = T_model_view_.translation();
  axis_ = T_model_view_.linear() * patch.rays->directions[patch.rays->directions.size() / 2];
  pinhole_ = std::get_if<PinholeSensor>(&patch.view.sensor);
  if (pinhole_ && !pinhole_->distortion.is_zero()) pinhole_ = nullptr;
}

CanvasPoint ViewCanvas::project(const Eigen::Vector3f& position_m) const {
  CanvasPoint out;
  if (pinhole_) {
    const Eigen::Vector3f p = T_view_model_ * position_m;
    if (!(p.z() > 0)) return out;
    out.u = float(pinhole_->fx) * p.x() / p.z() + float(pinhole_->cx);
    out.v = float(pinhole_->fy) * p.y() / p.z() + float(pinhole_->cy);
    out.r = p.z();
  } else {
    const auto at = lapseam::project(patch_.view.sensor, T_view_model_d_ * position_m.cast<double>());
    if (!at) return out;
    double u = at->u - shift_;
    if (patch_.grid.wraps) {
      if (u < -0.5) u += width_;
      if (u >= width_ - 0.5) u -= width_;
    }
    out = {float(u), float(at->v), float(at->r), false};
  }
  out.is_in = out.u > -0.5f && out.v > -0.5f && out.u < float(width_) - 0.5f && out.v < float(height_) - 0.5f;
  return out;
}

Eigen::Vector3f ViewCanvas::ray_to(const Eigen::Vector3f& position_m) const {
  return is_central() ? Eigen::Vector3f(position_m - sensor_position_m_) : axis_;
}

Eigen::Vector3f ViewCanvas::direction(float u, float v) const {
  const int u0 = std::clamp(int(std::floor(u)), 0, width_ - 2), v0 = std::clamp(int(std::floor(v)), 0, height_ - 2);
  const float s = u - float(u0), t = v - float(v0);
  const auto at = [&](int x, int y) -> const Eigen::Vector3f& { return patch_.rays->directions[pixel(x, y)]; };
  return (1 - t) * ((1 - s) * at(u0, v0) + s * at(u0 + 1, v0)) +
         t * ((1 - s) * at(u0, v0 + 1) + s * at(u0 + 1, v0 + 1));
}

float ViewCanvas::tolerance(std::size_t pixel, float error_m) const {
  const float cosine = float(patch_.incidence.pixels[pixel]) / 255;
  const float own = patch_.sigma_across(pixel, cosine);
  const float along_normal = float(options_.noise_factor) * std::sqrt(own * own + error_m * error_m) +
                             kRegistrationFactor * float(options_.registration_error_m);
  return along_normal / std::max(cosine, kGrazingCosine);
}

float ViewCanvas::largest_tolerance(float range_m, float error_m) const {
  const float sigma = range_m > 0 ? float(patch_.noise.largest_across(double(range_m))) : 0.0f;
  return (float(options_.noise_factor) * (sigma + error_m) +
          kRegistrationFactor * float(options_.registration_error_m)) /
         kGrazingCosine;
}

float ViewCanvas::slope_slack(int u, int v) const {
  const float r = patch_.view.range.pixels[pixel(u, v)];
  float step = 0;
  const auto visit = [&](int x, int y) {
    if (x < 0 || y < 0 || x >= width_ || y >= height_) return;
    const std::size_t i = pixel(x, y);
    if (!(patch_.confidence.pixels[i] > 0)) return;
    const float difference = std::abs(patch_.view.range.pixels[i] - r);
    // Beyond a step there is no slope.
    if (difference < 0.05f * r) step = std::max(step, difference);
  };
  visit(u - 1, v), visit(u + 1, v), visit(u, v - 1), visit(u, v + 1);
  return step;
}

Agreement ViewCanvas::compare(const CanvasPoint& point, float error_m) const {
  if (!point.is_in) return Agreement::kNothingThere;
  const int u0 = std::clamp(int(std::floor(point.u)), 0, width_ - 1),
            v0 = std::clamp(int(std::floor(point.v)), 0, height_ - 1);
  Agreement best = Agreement::kNothingThere;
  for (int v = v0; v <= std::min(v0 + 1, height_ - 1); ++v)
    for (int u = u0; u <= std::min(u0 + 1, width_ - 1); ++u) {
      const std::size_t i = pixel(u, v);
      if (!(patch_.confidence.pixels[i] > 0)) continue;
      best = Agreement::kDiffers;
      const float difference = std::abs(patch_.view.range.pixels[i] - point.r);
      const float slack = tolerance(i, error_m);
      if (difference <= slack || difference <= slack + slope_slack(u, v)) return Agreement::kAgrees;
    }
  return best;
}

}  // namespace lapseam
