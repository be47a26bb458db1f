#include "sew_meshes/surface_probe.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>

#include "core/parallel.h"

namespace lapseam {
namespace {

// A weight below this is none: the point lies on the opposite edge.
constexpr float kOnEdge = 1e-3f;

std::vector<std::uint32_t> living_triangles(const MergedMeshes& merged, const LiveMesh& live, std::uint32_t mesh) {
  std::vector<std::uint32_t> triangles;
  for (std::uint32_t t = 0; t < merged.triangle_mesh.size(); ++t)
    if (merged.triangle_mesh[t] == mesh && live.is_alive(t)) triangles.push_back(t);
  return triangles;
}

RayScene make_scene(const MergedMeshes& merged, const std::vector<std::uint32_t>& ids, std::uint32_t mesh,
                    Context& context) {
  const std::uint32_t first = merged.first_vertex[mesh], end = merged.first_vertex[mesh + 1];
  std::vector<Triangle> triangles;
  triangles.reserve(ids.size());
  for (const std::uint32_t id : ids) {
    const Triangle& t = merged.mesh.triangles[id];
    triangles.push_back({t[0] - first, t[1] - first, t[2] - first});
  }
  return RayScene(std::span(merged.mesh.positions_m).subspan(first, end - first), triangles, context);
}

std::vector<std::uint8_t> find_borders(const LiveMesh& live, const std::vector<std::uint32_t>& ids, Context& context) {
  std::vector<std::uint8_t> borders(ids.size(), 0);
  parallel_for(context, ids.size(), 1024, [&](std::size_t i) {
    const Triangle& t = live.triangle(ids[i]);
    for (std::size_t k = 0; k < 3; ++k) {
      if (live.find(t[(k + 1) % 3], t[k]) == kInvalidIndex) borders[i] |= std::uint8_t(1u << k);
      if (live.is_on_border(t[k])) borders[i] |= std::uint8_t(8u << k);
    }
  });
  return borders;
}

std::array<float, 3> weights_in(const std::vector<Eigen::Vector3f>& positions, const Triangle& t,
                                const Eigen::Vector3f& point) {
  const Eigen::Vector3d a = positions[t[0]].cast<double>(), b = positions[t[1]].cast<double>(),
                        c = positions[t[2]].cast<double>(), p = point.cast<double>();
  const Eigen::Vector3d normal = (b - a).cross(c - a);
  const double squared = normal.squaredNorm();
  if (!(squared > 0)) return {1, 0, 0};
  const double u = normal.dot((c - b).cross(p - b)) / squared, v = normal.dot((a - c).cross(p - c)) / squared;
  return {float(u), float(v), float(1 - u - v)};
}

}  // namespace

SurfaceProbe::SurfaceProbe(const MergedMeshes& merged, const LiveMesh& live, std::uint32_t mesh, Context& context)
    : merged_(merged),
      triangles_(living_triangles(merged, live, mesh)),
      borders_(find_borders(live, triangles_, context)),
      scene_(make_scene(merged, triangles_, mesh, context)) {}

std::optional<SurfacePoint> SurfaceProbe::closest(const Eigen::Vector3f& point, float radius,
                                                  const std::vector<float>* confidence) const {
  const ClosestPoint found = scene_.closest(point, radius);
  if (found.triangle == kInvalidIndex) return std::nullopt;
  const Triangle& t = merged_.mesh.triangles[triangles_[found.triangle]];
  const std::array<float, 3> weights = weights_in(merged_.mesh.positions_m, t, found.point);
  SurfacePoint out{.position = found.point, .distance = found.distance};
  std::size_t on_edges = 0;
  for (std::size_t k = 0; k < 3; ++k) {
    const float weight = std::clamp(weights[k], 0.0f, 1.0f);
    out.normal += weight * merged_.normals[t[k]];
    out.spacing_m += weight * merged_.spacing_m[t[k]];
    if (confidence) out.confidence += weight * (*confidence)[t[k]];
    if (weights[k] > kOnEdge) continue;
    ++on_edges;
    out.is_border = out.is_border || (borders_[found.triangle] >> (k + 1) % 3 & 1);
  }
  // At a corner, an open edge may belong to another triangle of its fan.
  for (std::size_t k = 0; k < 3 && on_edges > 1; ++k)
    if (weights[k] > 0.5f) out.is_border = out.is_border || (borders_[found.triangle] >> (3 + k) & 1);
  out.normal = out.normal.stableNormalized();
  return out;
}

SurfaceProbes make_probes(const MergedMeshes& merged, const LiveMesh& live, Context& context) {
  SurfaceProbes probes;
  for (std::uint32_t m = 0; m + 1 < merged.first_vertex.size(); ++m)
    probes.push_back(std::make_unique<SurfaceProbe>(merged, live, m, context));
  return probes;
}

bool is_surface_at(const SurfaceProbes& probes, const Eigen::Vector3f& point, const Eigen::Vector3f& normal,
                   float height_m, float beside_m) {
  for (const auto& probe : probes) {
    const auto near = probe->closest(point, std::hypot(height_m, beside_m));
    if (!near || near->normal.dot(normal) <= 0) continue;
    const Eigen::Vector3f apart = point - near->position;
    const float height = apart.dot(near->normal);
    const float beside = near->is_border ? (apart - height * near->normal).norm() : 0.0f;
    if ((near->is_border ? std::abs(height) : near->distance) <= height_m && beside <= beside_m) return true;
  }
  return false;
}

}  // namespace lapseam
