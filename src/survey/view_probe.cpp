#include "survey/view_probe.h"

#include <algorithm>
#include <cmath>
#include <cstddef>

namespace lapseam {
namespace {

// Normals are taken between samples this far apart, so that noise does not turn them over.
constexpr int kNormalReach_px = 2;
// The steepest surface whose neighbours count as such: tan 76°.
constexpr double kSteepest = 4;
constexpr double kNoiseFactor = 4;
// A box of the samples needs no more of them.
constexpr std::size_t kBoxStride = 7;

}  // namespace

Eigen::Vector3d normal_at(const View& view, const NoiseModel& noise, const SpacingLine& spacing, int u, int v) {
  const RangeImage& range = view.range;
  const Eigen::Vector3d none = Eigen::Vector3d::Zero();
  if (u < kNormalReach_px || v < kNormalReach_px || u >= range.width - kNormalReach_px ||
      v >= range.height - kNormalReach_px)
    return none;
  const double r = double(range.at(u, v));
  const double limit = kSteepest * kNormalReach_px * spacing.at(r) + kNoiseFactor * noise.sigma(r);
  std::array<Eigen::Vector3d, 4> around;
  constexpr int kAround[4][2] = {{-1, 0}, {1, 0}, {0, -1}, {0, 1}};
  for (std::size_t k = 0; k < 4; ++k) {
    const int x = u + kNormalReach_px * kAround[k][0], y = v + kNormalReach_px * kAround[k][1];
    const auto other = double(range.at(x, y));
    if (!(other > 0) || std::abs(other - r) > limit) return none;
    around[k] = unproject(view.sensor, x, y, other);
  }
  const Eigen::Vector3d normal = (around[1] - around[0]).cross(around[3] - around[2]);
  const double length = normal.norm();
  if (!(length > 0)) return none;
  return normal.dot(ray_direction(view.sensor, u, v)) > 0 ? Eigen::Vector3d(-normal / length)
                                                          : Eigen::Vector3d(normal / length);
}

ViewProbe make_probe(const View& view, const NoiseModel& noise, int count) {
  ViewProbe probe;
  const SpacingLine spacing = spacing_line(view.sensor);
  const int w = view.range.width;
  std::vector<std::size_t> valid;
  for (std::size_t i = 0; i < view.range.size(); ++i)
    if (view.range.pixels[i] > 0) valid.push_back(i);
  const auto uv = [&](std::size_t i) { return std::pair(int(i % std::size_t(w)), int(i / std::size_t(w))); };
  for (std::size_t k = 0; k < valid.size(); k += kBoxStride) {
    const auto [u, v] = uv(valid[k]);
    probe.box_in_world.extend(view.T_world_view * unproject(view.sensor, u, v, double(view.range.at(u, v))));
  }
  const std::size_t n = std::min(valid.size(), std::size_t(std::max(count, 1)));
  std::vector<double> spacings;
  for (std::size_t k = 0; k < n; ++k) {
    // In the k-th of n equal runs, at the golden section's places: even steps would fall into few columns.
    const double golden = double(k) * 0.6180339887498949;
    const double place = (double(k) + golden - std::floor(golden)) / double(n);
    const auto [u, v] = uv(valid[std::min(std::size_t(place * double(valid.size())), valid.size() - 1)]);
    const auto r = double(view.range.at(u, v));
    const Eigen::Vector3d normal = normal_at(view, noise, spacing, u, v);
    ProbeSample sample;
    sample.point_in_world = view.T_world_view * unproject(view.sensor, u, v, r);
    sample.normal_in_world = view.T_world_view.linear() * normal;
    sample.sigma_m = noise.sigma(r);
    sample.cosine = std::abs(normal.dot(ray_direction(view.sensor, u, v)));
    sample.spacing_m = spacing.at(r);
    spacings.push_back(sample.spacing_m);
    probe.samples.push_back(sample);
  }
  if (!spacings.empty()) {
    const auto middle = spacings.begin() + std::ptrdiff_t(spacings.size() / 2);
    std::nth_element(spacings.begin(), middle, spacings.end());
    probe.spacing_m = *middle;
  }
  return probe;
}

}  // namespace lapseam
