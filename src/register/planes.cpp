// After M. Fischler, R. Bolles, Random sample consensus, 1981, with seeds in even steps in place of random ones.

#include "register/planes.h"

#include <Eigen/Eigenvalues>
#include <cmath>

namespace lapseam {
namespace {

// Surfels of each view that take part, and planes that are tried each time.
constexpr std::size_t kProbes = 3000, kSeeds = 200;
constexpr std::size_t kMostPlanes = 16;
// Of all surface: less than this is furniture.
constexpr double kLeastShare = 0.01;
// Surfels of a plane look the same way, as far as their normals are known: 37°.
constexpr double kAlike = 0.8;
constexpr int kFits = 3;

struct Probe {
  Eigen::Vector3d point, normal;
  double area_m2;
};

std::vector<Probe> probes_of(std::span<const Posed> views) {
  std::vector<Probe> out;
  for (const Posed& view : views) {
    const std::size_t stride = thinning(*view.image, kProbes);
    for (std::size_t k = 0; k < view.image->usable.size(); k += stride) {
      const Surfel& surfel = view.image->surfels[view.image->usable[k]];
      // What a surfel covers grows with the square of its distance, and with how obliquely it is seen.
      const double r = double(surfel.point.norm());
      const double cosine = std::abs(double(surfel.normal.dot(surfel.point))) / std::max(r, 1e-9);
      out.push_back({view.T_world_view * surfel.point.cast<double>(),
                     view.T_world_view.linear() * surfel.normal.cast<double>(),
                     double(stride) * r * r / std::max(cosine, 0.1)});
    }
  }
  return out;
}

bool is_on(const Probe& probe, const Plane& plane, double reach_m) {
  return std::abs(plane.distance_to(probe.point)) < reach_m && plane.normal.dot(probe.normal) > kAlike;
}

double area_on(const std::vector<Probe>& probes, const Plane& plane, double reach_m) {
  double area = 0;
  for (const Probe& probe : probes)
    if (is_on(probe, plane, reach_m)) area += probe.area_m2;
  return area;
}

Plane fit(const std::vector<Probe>& probes, const Plane& near, double reach_m) {
  double sum = 0;
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  Eigen::Matrix3d square = Eigen::Matrix3d::Zero();
  for (const Probe& probe : probes) {
    if (!is_on(probe, near, reach_m)) continue;
    sum += probe.area_m2;
    mean += probe.area_m2 * probe.point;
    square += probe.area_m2 * probe.point * probe.point.transpose();
  }
  if (!(sum > 0)) return near;
  mean /= sum;
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> eigen(square / sum - mean * mean.transpose());
  Plane out;
  out.normal = eigen.eigenvectors().col(0);
  if (out.normal.dot(near.normal) < 0) out.normal = -out.normal;
  out.offset_m = out.normal.dot(mean);
  return out;
}

}  // namespace

std::vector<Plane> find_planes(std::span<const Posed> views, double reach_m) {
  std::vector<Probe> left = probes_of(views);
  double total = 0;
  for (const Probe& probe : left) total += probe.area_m2;
  std::vector<Plane> out;
  while (out.size() < kMostPlanes && !left.empty()) {
    const std::size_t stride = std::max<std::size_t>(1, left.size() / kSeeds) | 1;
    Plane best;
    double most = 0;
    for (std::size_t k = 0; k < left.size(); k += stride) {
      const Plane plane{left[k].normal, left[k].normal.dot(left[k].point)};
      const double area = area_on(left, plane, reach_m);
      if (area > most) {
        most = area;
        best = plane;
      }
    }
    for (int k = 0; k < kFits; ++k) best = fit(left, best, reach_m);
    if (!(area_on(left, best, reach_m) >= kLeastShare * total)) break;
    out.push_back(best);
    std::erase_if(left, [&](const Probe& probe) { return is_on(probe, best, reach_m); });
  }
  return out;
}

}  // namespace lapseam
