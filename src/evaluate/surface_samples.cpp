#include "evaluate/surface_samples.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "core/parallel.h"
#include "health/incidence.h"
#include "health/predicates.h"

namespace lapseam {
namespace {

constexpr std::size_t kGrain = 4096;

/// (b − a) × (c − a): twice the area long.
Eigen::Vector3d area_vector(const Surface& surface, std::size_t triangle) {
  const Triangle& t = surface.triangles[triangle];
  const Eigen::Vector3d a = surface.positions_m[t[0]].cast<double>();
  const Eigen::Vector3d ab = surface.positions_m[t[1]].cast<double>() - a;
  const Eigen::Vector3d ac = surface.positions_m[t[2]].cast<double>() - a;
  return ab.cross(ac);
}

}  // namespace

Surface make_surface(const Mesh& mesh, const Eigen::Vector3d& origin_m, Context& context) {
  WeldedSurface welded = weld_surface(mesh, context);
  Surface surface{std::move(welded.positions_m), std::move(welded.triangles), {}};
  std::erase_if(surface.triangles, [&](const Triangle& t) {
    return has_repeated_vertex(t) ||
           dominant_plane(surface.positions_m[t[0]], surface.positions_m[t[1]], surface.positions_m[t[2]]) < 0;
  });
  const Eigen::Vector3d shift = mesh.origin_m - origin_m;
  if (!shift.isZero(0))
    for (Eigen::Vector3f& p : surface.positions_m) p = (p.cast<double>() + shift).cast<float>();
  compute_normals(surface, context);
  return surface;
}

void compute_normals(Surface& surface, Context& context) {
  surface.normals.resize(surface.triangles.size());
  parallel_for(context, surface.triangles.size(), kGrain, [&](std::size_t i) {
    const Eigen::Vector3d normal = area_vector(surface, i);
    const double length = normal.norm();
    surface.normals[i].setZero();
    if (length > 0) surface.normals[i] = (normal / length).cast<float>();
  });
}

SurfaceSamples sample_surface(const Surface& surface, std::size_t count, std::uint64_t seed, std::uint64_t stream,
                              Context& context) {
  std::vector<double> area_up_to(surface.triangles.size());
  parallel_for(context, area_up_to.size(), kGrain,
               [&](std::size_t i) { area_up_to[i] = area_vector(surface, i).norm(); });
  double total = 0;
  for (double& area : area_up_to) area = total += area;
  SurfaceSamples samples;
  if (!(total > 0)) return samples;

  samples.positions_m.resize(count);
  samples.triangle.resize(count);
  parallel_for(context, count, kGrain, [&](std::size_t i) {
    const double place = (double(i) + random_unit(seed, stream, 3 * i)) / double(count) * total;
    // The first triangle whose area reaches beyond the place has an area of its own.
    auto found = std::upper_bound(area_up_to.begin(), area_up_to.end(), place);
    if (found == area_up_to.end()) found = std::lower_bound(area_up_to.begin(), area_up_to.end(), total);
    const auto triangle = std::size_t(found - area_up_to.begin());
    double b1 = random_unit(seed, stream, 3 * i + 1), b2 = random_unit(seed, stream, 3 * i + 2);
    if (b1 + b2 > 1) b1 = 1 - b1, b2 = 1 - b2;
    const Triangle& t = surface.triangles[triangle];
    const Eigen::Vector3d p = (1 - b1 - b2) * surface.positions_m[t[0]].cast<double>() +
                              b1 * surface.positions_m[t[1]].cast<double>() +
                              b2 * surface.positions_m[t[2]].cast<double>();
    samples.positions_m[i] = p.cast<float>();
    samples.triangle[i] = std::uint32_t(triangle);
  });
  return samples;
}

}  // namespace lapseam
