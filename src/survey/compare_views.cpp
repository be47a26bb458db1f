#include "survey/compare_views.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace lapseam {
namespace {

// Surfaces nearer than this many sample spacings and standard deviations of the noise may be one, wrongly placed. Views
// of a depth camera whose poses drift are off by several spacings; what lies behind an edge is mostly farther.
constexpr double kSpacings = 8, kSigmas = 4;
// Between samples of one surface: tan 76°.
constexpr double kSteepest = 4;
// Normals of one surface in two views; and no grazing looks, which magnify sideways errors.
constexpr double kAlike = 0.8, kFacing = 0.4;
// Share of a range by which a sample is moved to see which way.
constexpr double kStep = 0.001;

// What b measured at (u, v), from the four samples around it.
struct Surface {
  double range_m;
  double variance_factor;  // of the interpolated range, relative to one sample's
};

bool interpolate(const View& b, double limit_m, double u, double v, Surface& out) {
  const RangeImage& range = b.range;
  const int u0 = int(std::floor(u)), v0 = int(std::floor(v));
  if (u0 < 0 || v0 < 0 || u0 + 1 >= range.width || v0 + 1 >= range.height) return false;
  const double s = u - u0, t = v - v0;
  const std::array<double, 4> weights = {(1 - s) * (1 - t), s * (1 - t), (1 - s) * t, s * t};
  const std::array<float, 4> r = {range.at(u0, v0), range.at(u0 + 1, v0), range.at(u0, v0 + 1),
                                  range.at(u0 + 1, v0 + 1)};
  const auto [low, high] = std::minmax_element(r.begin(), r.end());
  if (!(*low > 0) || double(*high - *low) > limit_m) return false;
  // Inverse range is what a plane makes affine in the image of a central sensor.
  const bool is_inverse = is_central(b.sensor);
  double sum = 0, squares = 0;
  for (std::size_t k = 0; k < 4; ++k) {
    sum += weights[k] * (is_inverse ? 1 / double(r[k]) : double(r[k]));
    squares += weights[k] * weights[k];
  }
  out = {is_inverse ? 1 / sum : sum, squares};
  return true;
}

}  // namespace

double quantile(std::vector<double>& values, double share) {
  if (values.empty()) return 0;
  const auto at = values.begin() + std::ptrdiff_t(share * double(values.size() - 1) + 0.5);
  std::nth_element(values.begin(), at, values.end());
  return *at;
}

ViewComparison compare_views(const ViewProbe& a, const View& b, const NoiseModel& noise_b, const ViewProbe& probe_b) {
  ViewComparison out;
  const Eigen::Isometry3d T_b_world = b.T_world_view.inverse(Eigen::Isometry);
  const SpacingLine spacing = spacing_line(b.sensor);
  const auto visit_samples = [&](const auto& sensor, const Eigen::AlignedBox3d& box) {
    for (const ProbeSample& sample : a.samples) {
      if (!box.contains(sample.point_in_world)) continue;
      PixelRange at;
      if (!sensor.project(T_b_world * sample.point_in_world, at)) continue;
      const int u = int(std::lround(at.u)), v = int(std::lround(at.v));
      if (u < 0 || v < 0 || u >= b.range.width || v >= b.range.height) continue;
      ++out.in_frame;
      const auto nearest = double(b.range.at(u, v));
      if (!(nearest > 0)) continue;
      const double sigma_b = noise_b.sigma(nearest), apart = std::max(sample.spacing_m, spacing.at(nearest));
      const double gate = kSpacings * apart + kSigmas * std::hypot(sample.sigma_m, sigma_b);
      if (!(std::abs(at.r - nearest) <= gate)) continue;
      ++out.on_surface;
      if (sample.normal_in_world.isZero() || sample.cosine < kFacing) continue;
      Surface surface;
      if (!interpolate(b, kSteepest * spacing.at(nearest) + kSigmas * sigma_b, at.u, at.v, surface)) continue;
      const Eigen::Vector3d normal_b = normal_at(b, noise_b, spacing, u, v);
      if (normal_b.isZero() || (b.T_world_view.linear() * normal_b).dot(sample.normal_in_world) < kAlike) continue;
      const double cosine = -normal_b.dot(ray_direction(b.sensor, at.u, at.v));
      if (cosine < kFacing) continue;
      // a's noise runs along a's ray; what of it is across the surface shows along b's ray.
      const double sigma_a = sample.sigma_m * sample.cosine / cosine;
      const double sigma = std::sqrt(sigma_a * sigma_a + sigma_b * sigma_b * surface.variance_factor);
      // Cameras' ranges are depths, and not along the ray.
      const double off = at.r - surface.range_m, step = kStep * surface.range_m;
      const Eigen::Vector3d by_step =
          unproject(b.sensor, at.u, at.v, surface.range_m + step) - unproject(b.sensor, at.u, at.v, surface.range_m);
      out.disagreements.push_back({off, cosine, sigma, -normal_b.dot(by_step) * off / step});
    }
  };
  // Nothing farther from b's samples than the widest gate can lie on them.
  double widest = 0;
  for (const ProbeSample& s : probe_b.samples) widest = std::max(widest, kSpacings * s.spacing_m + kSigmas * s.sigma_m);
  for (const ProbeSample& s : a.samples) widest = std::max(widest, kSpacings * s.spacing_m + kSigmas * s.sigma_m);
  Eigen::AlignedBox3d box = probe_b.box_in_world;
  if (box.isEmpty()) return out;
  box.min().array() -= 2 * widest;
  box.max().array() += 2 * widest;
  if (!box.intersects(a.box_in_world)) return out;
  std::visit([&](const auto& sensor) { visit_samples(sensor, box); }, b.sensor);
  return out;
}

}  // namespace lapseam
