#include "simulate/light_map.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "core/parallel.h"
#include "mesh/longest_edge.h"

namespace lapseam::simulation {
namespace {

using Eigen::Vector3f;

constexpr float kCellSize_m = 0.07f;  // of the grids on large triangles
constexpr int kMostSteps = 128;
constexpr int kLampPoints = 4;  // squared: shadow rays per lamp
constexpr int kAmbientRays = 20;
constexpr float kOcclusionReach_m = 1.2f;
constexpr float kMeanLight = 0.48f;

/// Points of a grid of n steps before row i; row i has n + 1 − i points.
std::uint64_t row_start(std::uint64_t n, std::uint64_t i) { return i * (n + 1) - i * (i - 1) / 2; }

float radical_inverse_2(std::uint32_t i) {
  float result = 0, weight = 0.5f;
  for (; i != 0; i >>= 1, weight *= 0.5f) result += float(i & 1) * weight;
  return result;
}

/// Directions about +z with density cos θ / π (Hammersley points on Malley's disc).
std::vector<Vector3f> cosine_directions(int count) {
  std::vector<Vector3f> out;
  for (int i = 0; i < count; ++i) {
    const float radius = std::sqrt((float(i) + 0.5f) / float(count));
    const float angle = 2 * std::numbers::pi_v<float> * radical_inverse_2(std::uint32_t(i));
    out.emplace_back(radius * std::cos(angle), radius * std::sin(angle), std::sqrt(1 - radius * radius));
  }
  return out;
}

struct Shader {
  const SimulatedScene& scene;
  const RayScene& rays;
  Vector3f origin;  // of the mesh, in the world
  float offset_m;   // shadow rays start this far off the surface
  std::vector<Vector3f> directions = cosine_directions(kAmbientRays);

  Vector3f from_lamp(const AreaLight& lamp, const Vector3f& start, const Vector3f& normal) const {
    const Vector3f facing = lamp.edge_u.cross(lamp.edge_v);
    float sum = 0;
    for (int i = 0; i < kLampPoints * kLampPoints; ++i) {
      const float s = (2.0f * float(i % kLampPoints) + 1) / kLampPoints - 1;
      const float t = (2.0f * float(i / kLampPoints) + 1) / kLampPoints - 1;
      const Vector3f to_lamp = lamp.center + s * lamp.edge_u + t * lamp.edge_v - origin - start;
      const float squared = to_lamp.squaredNorm();
      const float cosines = normal.dot(to_lamp) * -4.0f * facing.dot(to_lamp);  // times the lamp's area
      if (normal.dot(to_lamp) <= 0 || cosines <= 0) continue;
      if (!rays.is_occluded(start, to_lamp, 0, 0.999f)) sum += cosines / (squared * squared);
    }
    return lamp.radiance * (sum / (kLampPoints * kLampPoints * std::numbers::pi_v<float>));
  }

  /// The two kinds of light apart: they are scaled later, when the lamps' mean is known.
  void shade(const Vector3f& point, const Vector3f& normal, Vector3f& lamps, float& ambient) const {
    const Vector3f start = point + offset_m * normal;
    lamps.setZero();
    for (const AreaLight& lamp : scene.lights) lamps += from_lamp(lamp, start, normal);
    const Vector3f axis = std::abs(normal.z()) < 0.9f ? Vector3f(Vector3f::UnitZ()) : Vector3f(Vector3f::UnitX());
    const Vector3f u = normal.cross(axis).normalized(), v = normal.cross(u);
    int open = 0;
    for (const Vector3f& d : directions)
      open += rays.is_occluded(start, d.x() * u + d.y() * v + d.z() * normal, 0, kOcclusionReach_m) ? 0 : 1;
    // Walls reflect: even a closed corner is not black.
    ambient = 0.25f + 0.75f * float(open) / kAmbientRays;
  }
};

/// Next to a lamp, white surfaces would clip in every picture; light levels off towards 1.1 there.
Vector3f soft_clip(const Vector3f& light) {
  constexpr float kLinear = 0.6f, kRoom = 0.5f;
  return light.unaryExpr(
      [](float x) { return x <= kLinear ? x : kLinear + kRoom * (1 - std::exp((kLinear - x) / kRoom)); });
}

std::vector<Vector3f> vertex_normals(const Mesh& mesh) {
  std::vector<Vector3f> normals(mesh.vertex_count(), Vector3f::Zero());
  const auto& p = mesh.positions_m;
  for (const auto& [a, b, c] : mesh.triangles) {
    const Vector3f doubled = (p[b] - p[a]).cross(p[c] - p[a]);
    for (const std::uint32_t v : {a, b, c}) normals[v] += doubled;
  }
  for (Vector3f& n : normals) n.normalize();
  return normals;
}

}  // namespace

LightMap::LightMap(const SimulatedScene& scene, const RayScene& rays, Context& context)
    : triangles_(&scene.mesh.triangles) {
  const Mesh& mesh = scene.mesh;
  const auto& p = mesh.positions_m;
  Vector3f low = p[0], high = p[0];
  for (const Vector3f& q : p) low = low.cwiseMin(q), high = high.cwiseMax(q);
  const float diagonal = (high - low).norm();
  const Shader shader{scene, rays, mesh.origin_m.cast<float>(), std::clamp(1e-3f * diagonal, 1e-5f, 1e-3f)};

  steps_.resize(mesh.triangle_count());
  first_point_.resize(mesh.triangle_count());
  std::uint64_t total = 0;
  for (std::size_t i = 0; i < steps_.size(); ++i) {
    const int n =
        std::clamp(int(std::ceil(longest_edge(mesh.positions_m, mesh.triangles[i]) / kCellSize_m)), 1, kMostSteps);
    steps_[i] = std::uint16_t(n);
    first_point_[i] = total;
    if (n > 1) total += row_start(std::uint64_t(n), std::uint64_t(n) + 1);
  }

  StageScope stage(context, "light", mesh.vertex_count() + mesh.triangle_count());
  std::vector<float> vertex_ambient(mesh.vertex_count()), grid_ambient(total);
  vertex_light_.resize(mesh.vertex_count());
  grid_light_.resize(total);
  const std::vector<Vector3f> normals = vertex_normals(mesh);
  parallel_blocks(context, mesh.vertex_count(), 1024, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) shader.shade(p[i], normals[i], vertex_light_[i], vertex_ambient[i]);
    stage.advance(end - begin);
  });
  parallel_blocks(context, mesh.triangle_count(), 64, [&](std::size_t begin, std::size_t end) {
    for (std::size_t t = begin; t < end; ++t) {
      const std::uint32_t n = steps_[t];
      if (n < 2) continue;
      const auto& [a, b, c] = mesh.triangles[t];
      const Vector3f ab = p[b] - p[a], ac = p[c] - p[a], normal = ab.cross(ac).normalized();
      for (std::uint32_t i = 0; i <= n; ++i) {
        for (std::uint32_t j = 0; j <= n - i; ++j) {
          // Pulled in a little: at the very edge, the neighbouring wall would already cover the point.
          const float s = 1.0f / 3 + 0.995f * (float(i) / float(n) - 1.0f / 3);
          const float r = 1.0f / 3 + 0.995f * (float(j) / float(n) - 1.0f / 3);
          const std::size_t k = first_point_[t] + row_start(n, i) + j;
          shader.shade(p[a] + s * ab + r * ac, normal, grid_light_[k], grid_ambient[k]);
        }
      }
    }
    stage.advance(end - begin);
  });

  // Exposure: the mean light over the surface's vertices and grids becomes kMeanLight, of which `ambient` is ambient's
  // share.
  double lamps = 0;
  for (const auto& light : vertex_light_) lamps += double(light.mean());
  for (const auto& light : grid_light_) lamps += double(light.mean());
  const float mean = float(lamps / double(vertex_light_.size() + grid_light_.size()));
  const float lamp_scale = mean > 0 ? kMeanLight * (1 - scene.ambient) / mean : 0.0f;
  const Vector3f ambient_light =
      Vector3f(0.97f, 1.0f, 1.05f) * (kMeanLight * (mean > 0 ? scene.ambient : 1.0f) / 0.75f);
  for (std::size_t i = 0; i < vertex_light_.size(); ++i)
    vertex_light_[i] = soft_clip(vertex_light_[i] * lamp_scale + ambient_light * vertex_ambient[i]);
  for (std::size_t i = 0; i < grid_light_.size(); ++i)
    grid_light_[i] = soft_clip(grid_light_[i] * lamp_scale + ambient_light * grid_ambient[i]);
}

Vector3f LightMap::at(std::uint32_t triangle, float b1, float b2) const {
  const std::uint32_t n = steps_[triangle];
  if (n < 2) {
    const auto& [a, b, c] = (*triangles_)[triangle];
    return vertex_light_[a] * (1 - b1 - b2) + vertex_light_[b] * b1 + vertex_light_[c] * b2;
  }
  const float s = std::max(0.0f, b1) * float(n), t = std::max(0.0f, b2) * float(n);
  std::uint32_t i = std::min(std::uint32_t(s), n - 1);
  std::uint32_t j = std::min(std::uint32_t(t), n - 1 - i);
  const float x = std::min(s - float(i), 1.0f), y = std::min(t - float(j), 1.0f);
  const auto point = [&](std::uint32_t k, std::uint32_t l) -> const Vector3f& {
    return grid_light_[first_point_[triangle] + row_start(n, k) + l];
  };
  if (x + y <= 1 || i + j + 2 > n) return point(i, j) * (1 - x - y) + point(i + 1, j) * x + point(i, j + 1) * y;
  return point(i + 1, j + 1) * (x + y - 1) + point(i + 1, j) * (1 - y) + point(i, j + 1) * (1 - x);
}

}  // namespace lapseam::simulation
