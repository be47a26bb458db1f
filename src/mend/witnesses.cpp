#include "mend/witnesses.h"

#include <algorithm>
#include <cmath>

#include "patch/same_surface.h"

namespace lapseam {
namespace {

// A view that saw a surface is believed against one that looked through if its noise is at most so many times larger.
constexpr float kBelievedFactor = 1.5f;
constexpr float kClearanceFactor = 2;  // to be empty, space must be clearer than to be the same surface
// Where views vote, each is for what it is nearer to: a tolerance is twice what two views usually part by.
constexpr float kVoteFactor = 0.5f;
// What is larger than so many tolerances shows in the ranges, however slanted; the cosine of the slant that counts as
// much steeper than what was measured, of that one's.
constexpr float kResolvedTolerances = 2, kSteepest = 0.3f;

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
                       const Eigen::Vector3f& normal, float error_m, float size_m) const {
  Hearing hearing;
  for (const std::uint32_t i : views) {
    const ViewCanvas& canvas = canvases_[i];
    const std::optional<Look> seen = look(canvas, point, normal, error_m);
    if (!seen || seen->behind_m() < -seen->tolerance_m) continue;  // nothing, or hidden
    const auto sigma = float(canvas.patch().noise.sigma(double(seen->measured_m)));
    if (is_too_steep(canvas, *seen, size_m)) continue;
    if (seen->cosine > 0 && canvas.compare(seen->at, error_m) == Agreement::kAgrees)
      hearing.surface_sigma_m = std::min(hearing.surface_sigma_m, sigma);
    else if (is_looked_through(canvas, *seen, error_m, kClearanceFactor))
      hearing.empty_sigma_m = std::min(hearing.empty_sigma_m, sigma);
  }
  return hearing;
}

ViewCount Witnesses::count(std::span<const std::uint32_t> views, const Eigen::Vector3f& point,
                           const Eigen::Vector3f& normal, float error_m) const {
  ViewCount count;
  for (const std::uint32_t i : views) {
    const std::optional<Look> seen = look(canvases_[i], point, normal, error_m);
    if (!seen) continue;
    const float limit = kVoteFactor * seen->tolerance_m;
    if (std::abs(seen->behind_m()) <= limit)
      count.surface += seen->cosine > 0;
    else if (seen->behind_m() > limit)
      count.empty += is_looked_through(canvases_[i], *seen, error_m, kVoteFactor);
  }
  return count;
}

std::optional<Witnesses::Look> Witnesses::look(const ViewCanvas& canvas, const Eigen::Vector3f& point,
                                               const Eigen::Vector3f& normal, float error_m) const {
  Look look;
  look.at = canvas.project(point);
  if (!look.at.is_in) return {};
  look.u = std::clamp(int(std::lround(look.at.u)), 0, canvas.width() - 1);
  look.v = std::clamp(int(std::lround(look.at.v)), 0, canvas.height() - 1);
  look.pixel = canvas.pixel(look.u, look.v);
  if (!(canvas.patch().confidence.pixels[look.pixel] > 0)) return {};
  look.measured_m = canvas.patch().view.range.pixels[look.pixel];
  look.tolerance_m = canvas.tolerance(look.pixel, error_m);
  look.cosine = -normal.dot(canvas.ray_to(point).normalized());
  return look;
}

// A ramp between two depths that the view cannot tell from a surface at either.
bool Witnesses::is_too_steep(const ViewCanvas& canvas, const Look& look, float size_m) {
  const float measured_cosine = float(canvas.patch().incidence.pixels[look.pixel]) / 255;
  return size_m < kResolvedTolerances * look.tolerance_m && look.cosine < kSteepest * measured_cosine;
}

bool Witnesses::is_looked_through(const ViewCanvas& canvas, const Look& look, float error_m, float clearance) {
  if (std::abs(look.cosine) < kGrazingCosine) return false;  // along the surface: a miss by a hair says nothing
  const int u = look.u, v = look.v;
  if (u < 1 || v < 1 || u + 1 >= canvas.width() || v + 1 >= canvas.height()) return false;
  for (int dv = -1; dv <= 1; ++dv)
    for (int du = -1; du <= 1; ++du) {
      const std::size_t beside = canvas.pixel(u + du, v + dv);
      if (!(canvas.patch().confidence.pixels[beside] > 0)) return false;
      if (canvas.patch().view.range.pixels[beside] - look.at.r < clearance * canvas.tolerance(beside, error_m))
        return false;
    }
  return true;
}

bool Witnesses::is_edge_on(std::uint32_t view, const Eigen::Vector3f& point, const Eigen::Vector3f& normal) const {
  return std::abs(normal.dot(canvases_[view].ray_to(point).normalized())) < kGrazingCosine;
}

float Witnesses::sigma_of(std::uint32_t view, std::uint32_t pixel) const {
  return float(patches_[view].noise.sigma(double(patches_[view].view.range.pixels[pixel])));
}

}  // namespace lapseam
