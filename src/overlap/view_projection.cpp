#include "overlap/view_projection.h"

#include <algorithm>
#include <cmath>

#include "lapseam/sensor.h"

namespace lapseam {
namespace {

// Every so many samples of the image border are looked at for the cone; between them a border is nearly straight.
constexpr int kConeSampling_px = 8;

// The row and column that follow are those with which a lattice over the tile ends.
bool fill_sphere(const Patch& patch, PatchTile& tile) {
  Eigen::AlignedBox3f box;
  bool has_own = false;
  for (int v = tile.v0; v < std::min(tile.v1 + 1, patch.grid.height); ++v)
    for (int u = tile.u0; u < std::min(tile.u1 + 1, patch.grid.width); ++u) {
      const std::size_t pixel = patch.confidence.index(u, v);
      if (patch.confidence.pixels[pixel] == 0) continue;
      has_own = has_own || (u < tile.u1 && v < tile.v1);
      box.extend(patch.point_in_view(pixel));
    }
  if (!has_own) return false;
  tile.center_in_view = box.center();
  tile.radius_m = 0.5f * box.diagonal().norm();
  return true;
}

}  // namespace

std::vector<PatchTile> make_tiles(const Patch& patch) {
  std::vector<PatchTile> tiles;
  for (int v = 0; v < patch.grid.height; v += kTile_px)
    for (int u = 0; u < patch.grid.width; u += kTile_px) {
      PatchTile tile{u,
                     v,
                     std::min(u + kTile_px, patch.grid.width),
                     std::min(v + kTile_px, patch.grid.height),
                     Eigen::Vector3f::Zero(),
                     0};
      if (fill_sphere(patch, tile)) tiles.push_back(tile);
    }
  return tiles;
}

bool ViewCone::can_see(const Eigen::Vector3f& center, float radius_m) const {
  if (!is_bounded) return true;
  const float distance = center.norm();
  if (distance - radius_m > farthest_m) return false;
  if (distance <= radius_m || cos_half_angle <= 0) return true;
  // Angle to the axis minus the angle that the sphere subtends, against the half angle, without inverse functions.
  const float cos_to_axis = center.dot(axis) / distance;
  const float sin_sphere = radius_m / distance, cos_sphere = std::sqrt(std::max(0.0f, 1 - sin_sphere * sin_sphere));
  const float cos_limit = cos_half_angle * cos_sphere - sin_half_angle * sin_sphere;  // cos(half angle + sphere's)
  return cos_to_axis >= cos_limit;
}

ViewCone make_cone(const Patch& patch) {
  ViewCone cone;
  if (!patch.rays->origins.empty()) return cone;
  const int w = patch.grid.width, h = patch.grid.height;
  const auto direction = [&](int u, int v) {
    return Eigen::Vector3f(patch.rays->directions[patch.confidence.index(u, v)].normalized());
  };
  cone.axis = direction(w / 2, h / 2);
  float lowest = 1;
  const auto visit = [&](int u, int v) { lowest = std::min(lowest, cone.axis.dot(direction(u, v))); };
  for (int u = 0; u < w; u += kConeSampling_px) visit(u, 0), visit(u, h - 1);
  for (int v = 0; v < h; v += kConeSampling_px) visit(0, v), visit(w - 1, v);
  visit(w - 1, h - 1);
  // Half a sample beyond the outermost centres still belongs to the image; 1 % is more than that.
  cone.cos_half_angle = lowest - 0.01f;
  cone.is_bounded = true;
  if (cone.cos_half_angle <= 0) cone.cos_half_angle = -1;
  cone.sin_half_angle = std::sqrt(std::max(0.0f, 1 - cone.cos_half_angle * cone.cos_half_angle));
  for (std::size_t i = 0; i < patch.view.range.size(); ++i)
    if (patch.view.range.pixels[i] > 0) cone.farthest_m = std::max(cone.farthest_m, patch.point_in_view(i).norm());
  return cone;
}

FarthestRanges::FarthestRanges(const Patch& patch)
    : patch_(&patch), farthest_(patch.grid.width / kBlock_px + 1, patch.grid.height / kBlock_px + 1, 0.0f) {
  const RangeImage& range = patch.view.range;
  for (int v = 0; v < range.height; ++v) {
    float* const row = &farthest_.at(0, v / kBlock_px);
    for (int u = 0; u < range.width; ++u) row[u / kBlock_px] = std::max(row[u / kBlock_px], range.at(u, v));
  }
}

bool FarthestRanges::find_bounds(const Eigen::Vector3f& center, float radius_m, Bounds& out) const {
  if (const auto* pinhole = std::get_if<PinholeSensor>(&patch_->view.sensor)) {
    const float near_z = center.z() - radius_m;
    if (!pinhole->distortion.is_zero() || !(near_z > radius_m)) return false;
    const auto fx = float(pinhole->fx), fy = float(pinhole->fy);
    const float u = fx * center.x() / center.z(), v = fy * center.y() / center.z();
    const float reach_u = std::abs(fx) * radius_m / near_z + std::abs(u) * radius_m / near_z + 1;
    const float reach_v = std::abs(fy) * radius_m / near_z + std::abs(v) * radius_m / near_z + 1;
    const float cu = u + float(pinhole->cx), cv = v + float(pinhole->cy);
    out = {cu - reach_u, cu + reach_u, cv - reach_v, cv + reach_v, near_z};
    return true;
  }
  if (!std::holds_alternative<SphericalSensor>(patch_->view.sensor)) return false;
  const float distance = center.norm();
  // A cube around the sphere: its corners bound what they project to as long as it is small and far from the poles.
  if (!(distance > 8 * radius_m) || std::abs(center.z()) > 0.8f * distance) return false;
  out = {1e9f, -1e9f, 1e9f, -1e9f, distance - radius_m};
  for (int k = 0; k < 8; ++k) {
    const Eigen::Vector3f corner =
        center + 1.2f * radius_m * Eigen::Vector3f(k & 1 ? 1.0f : -1.0f, k & 2 ? 1.0f : -1.0f, k & 4 ? 1.0f : -1.0f);
    const auto at = project(patch_->view.sensor, corner.cast<double>());
    if (!at) return false;
    out.u_low = std::min(out.u_low, float(at->u)), out.u_high = std::max(out.u_high, float(at->u));
    out.v_low = std::min(out.v_low, float(at->v)), out.v_high = std::max(out.v_high, float(at->v));
  }
  return out.u_high - out.u_low < 0.25f * float(patch_->grid.width);
}

bool FarthestRanges::hide(const Eigen::Vector3f& center, float radius_m, float slack_m) const {
  Bounds bounds;
  if (!find_bounds(center, radius_m, bounds)) return false;
  const int w = patch_->grid.width, h = patch_->grid.height;
  if (bounds.u_high < 0 || bounds.v_high < 0 || bounds.u_low > float(w) || bounds.v_low > float(h))
    return !patch_->grid.wraps;
  const auto block = [](float x, int size) { return std::clamp(int(x), 0, size - 1) / kBlock_px; };
  for (int y = block(bounds.v_low, h); y <= block(bounds.v_high, h); ++y)
    for (int x = block(bounds.u_low, w); x <= block(bounds.u_high, w); ++x)
      if (bounds.nearest_r <= farthest_.at(x, y) + slack_m) return false;
  return true;
}

}  // namespace lapseam
