#include "simulate/ray_caster.h"

#include <algorithm>
#include <cmath>

#include "simulate/color.h"
#include "simulate/pattern.h"

namespace lapseam::simulation {

using Eigen::Vector3d;
using Eigen::Vector3f;

Hit RayCaster::cast(const Ray& ray) const {
  const RayHit hit = rays_.cast(ray.origin.cast<float>(), ray.direction.cast<float>());
  if (!hit) return {};
  // Embree works in float; the plane of the triangle it found gives the range in double.
  return {hit.triangle, float(plane_range(hit.triangle, ray, double(hit.t))), hit.b1, hit.b2};
}

double RayCaster::plane_range(std::uint32_t triangle, const Ray& ray, double otherwise) const {
  const auto& [a, b, c] = scene_.mesh.triangles[triangle];
  const auto& p = scene_.mesh.positions_m;
  const Vector3d corner = p[a].cast<double>();
  const Vector3d n = (p[b].cast<double>() - corner).cross(p[c].cast<double>() - corner);
  const double slope = n.dot(ray.direction);
  // Nearly along the plane the quotient loses what double gains.
  if (slope * slope <= 1e-8 * n.squaredNorm() * ray.direction.squaredNorm()) return otherwise;
  return n.dot(corner - ray.origin) / slope;
}

Vector3d RayCaster::normal(std::uint32_t triangle) const {
  const auto& [a, b, c] = scene_.mesh.triangles[triangle];
  const auto& p = scene_.mesh.positions_m;
  return (p[b] - p[a]).cast<double>().cross((p[c] - p[a]).cast<double>()).normalized();
}

double RayCaster::incidence_cosine(std::uint32_t triangle, const Ray& ray) const {
  return -normal(triangle).dot(ray.direction) / ray.direction.norm();
}

std::uint32_t RayCaster::material(std::uint32_t triangle) const {
  return scene_.triangle_material.empty() ? kInvalidIndex : scene_.triangle_material[triangle];
}

Vector3f RayCaster::albedo_at(const Hit& hit, const Vector3d& point) const {
  const std::uint32_t m = material(hit.triangle);
  if (m == kInvalidIndex) return mesh_albedo(hit);
  return albedo(scene_.materials[m], (point + scene_.mesh.origin_m).cast<float>(), normal(hit.triangle).cast<float>());
}

Vector3f RayCaster::mesh_albedo(const Hit& hit) const {
  const Mesh& mesh = scene_.mesh;
  const float b0 = 1 - hit.b1 - hit.b2;
  const bool is_textured =
      !mesh.texcoords.empty() && !mesh.triangle_page.empty() && mesh.triangle_page[hit.triangle] < mesh.pages.size();
  if (is_textured) {
    const ColorImage& page = mesh.pages[mesh.triangle_page[hit.triangle]];
    const auto& t = mesh.texcoords[hit.triangle];
    const Eigen::Vector2f q = t[0] * b0 + t[1] * hit.b1 + t[2] * hit.b2;
    // Texture coordinates run over pixel edges; pixel centres are at integers.
    const float x = std::clamp(q.x() * float(page.width) - 0.5f, 0.0f, float(page.width - 1));
    const float y = std::clamp(q.y() * float(page.height) - 0.5f, 0.0f, float(page.height - 1));
    const int u = std::min(int(x), std::max(page.width - 2, 0)), v = std::min(int(y), std::max(page.height - 2, 0));
    const int u1 = std::min(u + 1, page.width - 1), v1 = std::min(v + 1, page.height - 1);
    const float fu = x - float(u), fv = y - float(v);
    return (to_linear(page.at(u, v)) * (1 - fu) + to_linear(page.at(u1, v)) * fu) * (1 - fv) +
           (to_linear(page.at(u, v1)) * (1 - fu) + to_linear(page.at(u1, v1)) * fu) * fv;
  }
  if (mesh.colors.empty()) return Vector3f::Constant(0.55f);
  const auto& [a, b, c] = mesh.triangles[hit.triangle];
  return to_linear(mesh.colors[a]) * b0 + to_linear(mesh.colors[b]) * hit.b1 + to_linear(mesh.colors[c]) * hit.b2;
}

Vector3f RayCaster::light_at(const Hit& hit) const {
  const std::uint32_t m = material(hit.triangle);
  const float glow = m == kInvalidIndex ? 0.0f : scene_.materials[m].glow;
  return light_->at(hit.triangle, hit.b1, hit.b2) + Vector3f::Constant(glow);
}

}  // namespace lapseam::simulation
