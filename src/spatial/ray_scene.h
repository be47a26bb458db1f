#pragma once

// Rays and closest points on a triangle soup: a thin, safe wrapper of Embree 3 (the only place that includes it).

#include <Eigen/Core>
#include <cstdint>
#include <memory>
#include <span>

#include "lapseam/mesh.h"

namespace lapseam {

class Context;

struct RayHit {
  float t = 0;                             ///< distance along the direction, in units of its length
  std::uint32_t triangle = kInvalidIndex;  ///< kInvalidIndex: nothing was hit
  float b1 = 0, b2 = 0;                    ///< barycentric weights of the triangle's second and third vertex
  explicit operator bool() const { return triangle != kInvalidIndex; }
};

struct ClosestPoint {
  Eigen::Vector3f point = Eigen::Vector3f::Zero();
  float distance = 0;
  std::uint32_t triangle = kInvalidIndex;  ///< kInvalidIndex: nothing within the radius
};

/// A BVH over triangles. Copies positions and triangles. Queries are const and thread-safe.
class RayScene {
 public:
  RayScene(std::span<const Eigen::Vector3f> positions_m, std::span<const Triangle> triangles, Context& context);
  ~RayScene();
  RayScene(RayScene&&) noexcept;
  RayScene& operator=(RayScene&&) noexcept;

  /// First hit with t in [t_near, t_far].
  RayHit cast(const Eigen::Vector3f& origin, const Eigen::Vector3f& direction, float t_near = 0.0f,
              float t_far = 3.0e38f) const;
  bool is_occluded(const Eigen::Vector3f& origin, const Eigen::Vector3f& direction, float t_near, float t_far) const;
  /// Nearest point of the surface within max_distance; equal distances give the smaller triangle index.
  ClosestPoint closest(const Eigen::Vector3f& point, float max_distance = 3.0e38f) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace lapseam
