#include "sew_meshes/surface_probe.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>

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

std::array<float, 3> weights_in(const LiveMesh& live, const Triangle& t, const Eigen::Vector3f& point) {
  const Eigen::Vector3d a = live.position(t[0]).cast<double>(), b = live.position(t[1]).cast<double>(),
                        c = live.position(t[2]).cast<double>(), p = point.cast<double>();
  const Eigen::Vector3d normal = (b - a).cross(c - a);
  const double squared = normal.squaredNorm();
  if (!(squared > 0)) return {1, 0, 0};
  const double u = normal.dot((c - b).cross(p - b)) / squared, v = normal.dot((a - c).cross(p - c)) / squared;
  return {float(u), float(v), float(1 - u - v)};
}

}  // namespace

SurfaceProbe::SurfaceProbe(const MergedMeshes& merged, const LiveMesh& live, std::uint32_t mesh, Context& context)
    : merged_(merged),
      live_(live),
      triangles_(living_triangles(merged, live, mesh)),
      scene_(make_scene(merged, triangles_, mesh, context)) {}

std::optional<SurfacePoint> SurfaceProbe::closest(const Eigen::Vector3f& point, float radius,
                                                  const std::vector<float>* confidence) const {
  const ClosestPoint found = scene_.closest(point, radius);
  if (found.triangle == kInvalidIndex) return std::nullopt;
  const Triangle& t = live_.triangle(triangles_[found.triangle]);
  const std::array<float, 3> weights = weights_in(live_, t, found.point);
  SurfacePoint out{.position = found.point, .distance = found.distance};
  std::size_t on_edges = 0;
  for (std::size_t k = 0; k < 3; ++k) {
    const float weight = std::clamp(weights[k], 0.0f, 1.0f);
    out.normal += weight * merged_.normals[t[k]];
    out.spacing_m += weight * merged_.spacing_m[t[k]];
    if (confidence) out.confidence += weight * (*confidence)[t[k]];
    if (weights[k] > kOnEdge) continue;
    ++on_edges;
    const std::uint32_t a = t[(k + 1) % 3], b = t[(k + 2) % 3];
    out.is_border = out.is_border || live_.is_open(a, b);
  }
  // At a corner, an open edge may belong to another triangle of its fan.
  if (on_edges > 1)
    for (std::size_t k = 0; k < 3; ++k)
      if (weights[k] > 0.5f) out.is_border = out.is_border || live_.is_on_border(t[k]);
  out.normal = out.normal.stableNormalized();
  return out;
}

}  // namespace lapseam
