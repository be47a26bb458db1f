#include "simulate/coverage.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "core/parallel.h"
#include "lapseam/error.h"
#include "simulate/counter_rng.h"

namespace lapseam::simulation {

using Eigen::Vector3f;

SurfaceSamples sample_surface(const Mesh& mesh, std::size_t count, std::uint64_t seed) {
  const auto& p = mesh.positions_m;
  std::vector<double> area_before{0.0};
  for (const auto& [a, b, c] : mesh.triangles)
    area_before.push_back(area_before.back() + 0.5 * double((p[b] - p[a]).cross(p[c] - p[a]).norm()));
  const CounterRng rng(seed, Stream::kSurface);
  SurfaceSamples out;
  for (std::size_t i = 0; i < count; ++i) {
    // Stratified: the i-th of equal pieces of the whole area.
    const double area = area_before.back() * (double(i) + rng.uniform(3 * i)) / double(count);
    const auto above = std::upper_bound(area_before.begin() + 1, area_before.end() - 1, area);
    const auto& [a, b, c] = mesh.triangles[std::size_t(above - area_before.begin()) - 1];
    const float s = std::sqrt(float(rng.uniform(3 * i + 1))), t = float(rng.uniform(3 * i + 2));
    out.points.push_back(p[a] * (1 - s) + p[b] * (s * (1 - t)) + p[c] * (s * t));
    out.normals.push_back((p[b] - p[a]).cross(p[c] - p[a]).normalized());
  }
  return out;
}

std::vector<std::uint32_t> find_visible(const SurfaceSamples& samples, const RayScene& rays, const Vector3f& eye,
                                        const SightLimits& limits) {
  std::vector<std::uint32_t> out;
  for (std::size_t i = 0; i < samples.points.size(); ++i) {
    const Vector3f to_eye = eye - samples.points[i];
    const float range = to_eye.norm();
    if (range < limits.min_range_m || range > limits.max_range_m) continue;
    if (samples.normals[i].dot(to_eye) < limits.min_cosine * range) continue;
    const Vector3f start = samples.points[i] + 1e-3f * samples.normals[i];
    if (!rays.is_occluded(start, eye - start, 0, 1)) out.push_back(std::uint32_t(i));
  }
  return out;
}

std::vector<std::vector<std::uint32_t>> find_visible_from(const std::vector<Vector3f>& places,
                                                          const SurfaceSamples& samples, const RayScene& rays,
                                                          const SightLimits& limits, const std::string& scene_name,
                                                          Context& context) {
  std::vector<std::vector<std::uint32_t>> seen(places.size());
  parallel_for(context, places.size(), 2,
               [&](std::size_t i) { seen[i] = find_visible(samples, rays, places[i], limits); });
  if (std::all_of(seen.begin(), seen.end(), [](const auto& s) { return s.empty(); }))
    throw InvalidInput({}, scene_name, "trajectory", "where there is room to stand, no front of a surface is in sight");
  return seen;
}

std::vector<std::size_t> choose_places(const std::vector<Vector3f>& places,
                                       const std::vector<std::vector<std::uint32_t>>& seen, std::size_t samples,
                                       std::size_t count) {
  std::vector<std::size_t> chosen;
  std::vector<std::uint8_t> is_covered(samples, 0), is_chosen(places.size(), 0);
  std::vector<float> nearest(places.size(), std::numeric_limits<float>::infinity());
  while (chosen.size() < std::min(count, places.size())) {
    std::size_t best = places.size(), best_gain = 0;
    for (std::size_t i = 0; i < places.size(); ++i) {
      if (is_chosen[i]) continue;
      std::size_t gain = 0;
      for (const std::uint32_t s : seen[i]) gain += is_covered[s] ? 0 : 1;
      const bool is_better =
          best == places.size() || gain > best_gain || (gain == best_gain && nearest[i] > nearest[best]);
      if (is_better) best = i, best_gain = gain;
    }
    chosen.push_back(best);
    is_chosen[best] = 1;
    for (const std::uint32_t s : seen[best]) is_covered[s] = 1;
    for (std::size_t i = 0; i < places.size(); ++i)
      nearest[i] = std::min(nearest[i], (places[i] - places[best]).squaredNorm());
  }
  return chosen;
}

}  // namespace lapseam::simulation
