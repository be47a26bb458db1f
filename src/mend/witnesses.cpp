#include "mend/witnesses.h"

#include <algorithm>
#include <cmath>

namespace lapseam {
namespace {

// A view that saw a surface is believed against one that looked through if its noise is at most so many times larger.
constexpr float kBelievedFactor = 1.5f;
constexpr float kClearanceFactor = 2;   // to be empty, space must be clearer than to be the same surface
constexpr float kLowestCosine = 0.15f;  // 81°: beyond, a range says little of a surface

}  // namespace

bool Hearing::is_empty() const {
  return empty_sigma_m < std::numeric_limits<float>::infinity() && surface_sigma_m > kBelievedFactor * empty_sigma_m;
}

Witnesses::Witnesses(std::span<const Patch> patches, const Eigen::Vector3d& origin_m, const OverlapOptions& options)
    : patches_(patches) {
  canvases_.reserve(patches.size());
  cones_.reserve(patches.size());
  for (const Patch& patch : patches) {
    canvases_.emplace_back(patch, origin_m, options, 0);
    cones_.push_back(make_cone(patch));
  }
}

std::vector<std::uint32_t> Witnesses::find_views(const Eigen::Vector3f& center, float radius_m) const {
  std::vector<std::uint32_t> views;
  for (std::uint32_t i = 0; i < canvases_.size(); ++i)
    if (cones_[i].can_see(canvases_[i].T_view_model() * center, radius_m)) views.push_back(i);
  return views;
}

Hearing Witnesses::ask(std::span<const std::uint32_t> views, const Eigen::Vector3f& point,
                       const Eigen::Vector3f& normal, float error_m) const {
  Hearing hearing;
  for (const std::uint32_t i : views) hear(canvases_[i], point, normal, error_m, hearing);
  return hearing;
}

void Witnesses::hear(const ViewCanvas& canvas, const Eigen::Vector3f& point, const Eigen::Vector3f& normal,
                     float error_m, Hearing& hearing) const {
  const CanvasPoint at = canvas.project(point);
  if (!at.is_in) return;
  const Patch& patch = canvas.patch();
  const int u = std::clamp(int(std::lround(at.u)), 0, canvas.width() - 1);
  const int v = std::clamp(int(std::lround(at.v)), 0, canvas.height() - 1);
  const std::size_t pixel = canvas.pixel(u, v);
  if (!(patch.confidence.pixels[pixel] > 0)) return;
  const float measured = patch.view.range.pixels[pixel], behind = measured - at.r;
  const float tolerance = canvas.tolerance(pixel, error_m);
  if (behind < -tolerance) return;  // hidden
  const auto sigma = float(patch.noise.sigma(double(measured)));
  const Eigen::Vector3f ray = canvas.ray_to(point).normalized();
  const float cosine = -normal.dot(ray);
  if (cosine > 0 && canvas.compare(at, error_m) == Agreement::kAgrees) {
    hearing.surface_sigma_m = std::min(hearing.surface_sigma_m, sigma);
    return;
  }
  if (std::abs(cosine) < kLowestCosine) return;  // along the surface: a miss by a hair says nothing
  if (u < 1 || v < 1 || u + 1 >= canvas.width() || v + 1 >= canvas.height()) return;
  for (int dv = -1; dv <= 1; ++dv)
    for (int du = -1; du <= 1; ++du) {
      const std::size_t beside = canvas.pixel(u + du, v + dv);
      if (!(patch.confidence.pixels[beside] > 0)) return;
      if (patch.view.range.pixels[beside] - at.r < kClearanceFactor * canvas.tolerance(beside, error_m)) return;
    }
  hearing.empty_sigma_m = std::min(hearing.empty_sigma_m, sigma);
}

bool Witnesses::is_edge_on(std::uint32_t view, const Eigen::Vector3f& point, const Eigen::Vector3f& normal) const {
  return std::abs(normal.dot(canvases_[view].ray_to(point).normalized())) < kLowestCosine;
}

float Witnesses::sigma_of(std::uint32_t view, std::uint32_t pixel) const {
  return float(patches_[view].noise.sigma(double(patches_[view].view.range.pixels[pixel])));
}

}  // namespace lapseam
