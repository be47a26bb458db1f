#pragma once

// Where a sensor's rays meet a scene, and what colour they see there.

#include <Eigen/Geometry>
#include <optional>

#include "lapseam/simulate.h"
#include "simulate/light_map.h"
#include "spatial/ray_scene.h"

namespace lapseam::simulation {

/// A ray p(r) = origin + r·direction in the mesh's frame, with r the sensor's own range.
struct Ray {
  Eigen::Vector3d origin, direction;
};

struct Hit {
  std::uint32_t triangle = kInvalidIndex;
  float range = kInvalidRange;
  float b1 = 0, b2 = 0;
  explicit operator bool() const { return triangle != kInvalidIndex; }
};

class RayCaster {
 public:
  RayCaster(const SimulatedScene& scene, Context& context, bool has_light)
      : scene_(scene), rays_(scene.mesh.positions_m, scene.mesh.triangles, context) {
    if (has_light) light_.emplace(scene, rays_, context);
  }

  const SimulatedScene& scene() const { return scene_; }
  bool has_light() const { return light_.has_value(); }

  Hit cast(const Ray& ray) const;
  /// Of the triangle's plane along the ray, in double; `otherwise` when the ray runs along the plane.
  double plane_range(std::uint32_t triangle, const Ray& ray, double otherwise) const;
  /// Unit, outward.
  Eigen::Vector3d normal(std::uint32_t triangle) const;
  /// Of the angle between the outward normal and the way back to the sensor; negative on the back.
  double incidence_cosine(std::uint32_t triangle, const Ray& ray) const;
  std::uint32_t material(std::uint32_t triangle) const;
  /// Linear reflectance at a point of the triangle; the weights are used for the mesh's own colours only.
  Eigen::Vector3f albedo_at(const Hit& hit, const Eigen::Vector3d& point) const;
  /// Only where has_light().
  Eigen::Vector3f light_at(const Hit& hit) const;

 private:
  Eigen::Vector3f mesh_albedo(const Hit& hit) const;

  const SimulatedScene& scene_;
  RayScene rays_;
  std::optional<LightMap> light_;
};

/// Rays of one sensor at one pose.
class RayGenerator {
 public:
  RayGenerator(const Sensor& sensor, const Eigen::Isometry3d& T_mesh_sensor)
      : sensor_(sensor), T_mesh_sensor_(T_mesh_sensor) {}
  Ray operator()(double u, double v) const {
    // All three models are linear in r, so two points give the ray.
    const Eigen::Vector3d p0 = unproject(sensor_, u, v, 0.0), p1 = unproject(sensor_, u, v, 1.0);
    return {T_mesh_sensor_ * p0, T_mesh_sensor_.linear() * (p1 - p0)};
  }

 private:
  const Sensor& sensor_;
  Eigen::Isometry3d T_mesh_sensor_;
};

}  // namespace lapseam::simulation
