#pragma once

// Meshes cut into overlapping parts that disagree a little.

#include <Eigen/Geometry>
#include <functional>
#include <random>

#include "lapseam/mesh.h"

namespace lapseam::test {

/// The triangles whose three corners satisfy `is_inside`.
inline Mesh cut_out(const Mesh& mesh, const std::function<bool(const Eigen::Vector3f&)>& is_inside) {
  std::vector<std::uint8_t> keep(mesh.triangle_count(), 1);
  for (std::size_t i = 0; i < keep.size(); ++i)
    for (const std::uint32_t v : mesh.triangles[i]) keep[i] = keep[i] && is_inside(mesh.positions_m[v]);
  return compact(mesh, keep);
}

/// Parts of equal width along an axis, which overlap by `overlap_m`.
inline std::vector<Mesh> cut_along(const Mesh& mesh, int axis, int parts, float overlap_m) {
  float low = 3e38f, high = -3e38f;
  for (const Eigen::Vector3f& p : mesh.positions_m) low = std::min(low, p[axis]), high = std::max(high, p[axis]);
  std::vector<Mesh> out;
  for (int i = 0; i < parts; ++i) {
    const float begin = i == 0 ? -3e38f : low + (high - low) * float(i) / float(parts) - overlap_m / 2;
    const float end = i + 1 == parts ? 3e38f : low + (high - low) * float(i + 1) / float(parts) + overlap_m / 2;
    out.push_back(cut_out(mesh, [&](const Eigen::Vector3f& p) { return p[axis] >= begin && p[axis] <= end; }));
  }
  return out;
}

/// The same with every compiler: arguments of a call may be worked out in any order, these are not.
inline Eigen::Vector3f random_direction(std::mt19937& random) {
  std::normal_distribution<float> gauss(0, 1);
  Eigen::Vector3f direction;
  for (float& x : direction) x = gauss(random);
  return direction.normalized();
}

/// Moved as a whole by `distance_m` in a direction of its own, as a registration that is a little wrong.
inline void shift(Mesh& mesh, float distance_m, unsigned seed) {
  std::mt19937 random(seed);
  const Eigen::Vector3f direction = random_direction(random);
  for (Eigen::Vector3f& p : mesh.positions_m) p += distance_m * direction;
}

/// Each vertex moved by `distance_m` in a direction of its own, as noise.
inline void shake(Mesh& mesh, float distance_m, unsigned seed) {
  std::mt19937 random(seed);
  for (Eigen::Vector3f& p : mesh.positions_m) p += distance_m * random_direction(random);
}

}  // namespace lapseam::test
