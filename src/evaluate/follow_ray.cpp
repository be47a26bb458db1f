#include "evaluate/follow_ray.h"

#include <algorithm>

#include "lapseam/sensor.h"

namespace lapseam {
namespace {

// The next surface is looked for this far behind the first hit; less would find the first again.
constexpr float kBehindHit_m = 1e-4f;
// How far beside a pixel's centre its ray goes, along columns and rows. Vertices of a mesh lie on the rays of the
// samples that they were made from, and there rounding lets a ray slip between all the triangles around.
constexpr double kBesideCenter_px = 0.005;

}  // namespace

Ray ray_through(const View& view, const Eigen::Vector3d& origin_m, std::size_t pixel) {
  const double u = double(pixel % std::size_t(view.range.width)) + kBesideCenter_px;
  const double v = double(pixel / std::size_t(view.range.width)) + kBesideCenter_px;
  const Eigen::Vector3d seen = unproject(view.sensor, u, v, double(view.range.pixels[pixel]));
  const Eigen::Vector3d start = unproject(view.sensor, u, v, 0.0);
  const double length = (seen - start).norm();
  const Eigen::Vector3d direction = view.T_world_view.linear() * ((seen - start) / length);
  return {(view.T_world_view * start - origin_m).cast<float>(), direction.cast<float>(), length};
}

Encounter follow(const Ray& ray, const Surface& surface, const RayScene& scene, double double_layer_m) {
  Encounter encounter;
  const RayHit first = scene.cast(ray.origin, ray.direction);
  if (!first) return encounter;
  const auto is_front = [&](const RayHit& hit) { return surface.normals[hit.triangle].dot(ray.direction) < 0; };
  encounter.is_hit = true;
  encounter.length_m = double(first.t);
  encounter.is_front = is_front(first);
  if (!encounter.is_front) return encounter;
  const RayHit next = scene.cast(ray.origin, ray.direction, first.t + kBehindHit_m);
  encounter.is_double = next && double(next.t - first.t) < double_layer_m && is_front(next);
  return encounter;
}

std::vector<std::size_t> choose_pixels(const View& view, std::size_t count, std::uint64_t seed, std::uint64_t stream) {
  std::vector<std::pair<std::uint64_t, std::size_t>> keyed;
  for (std::size_t i = 0; i < view.range.size(); ++i)
    if (view.range.pixels[i] > kInvalidRange) keyed.emplace_back(random_bits(seed, stream, i), i);
  if (keyed.size() > count) {
    std::nth_element(keyed.begin(), keyed.begin() + std::ptrdiff_t(count), keyed.end());
    keyed.resize(count);
  }
  std::vector<std::size_t> pixels(keyed.size());
  std::transform(keyed.begin(), keyed.end(), pixels.begin(), [](const auto& key) { return key.second; });
  std::sort(pixels.begin(), pixels.end());
  return pixels;
}

}  // namespace lapseam
