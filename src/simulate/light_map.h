#pragma once

// Light that falls on a scene, computed once: area lamps with soft shadows, and ambient light with occlusion. It
// belongs to the surface and not to a view, so that colours agree between views.

#include <Eigen/Geometry>
#include <cstdint>
#include <vector>

#include "lapseam/simulate.h"
#include "spatial/ray_scene.h"

namespace lapseam::simulation {

class LightMap {
 public:
  LightMap(const SimulatedScene& scene, const RayScene& rays, Context& context);
  /// Light at a point of a triangle, 1 for well-lit. b1, b2: weights of its second and third vertex.
  Eigen::Vector3f at(std::uint32_t triangle, float b1, float b2) const;

 private:
  const std::vector<Triangle>* triangles_;
  std::vector<Eigen::Vector3f> vertex_light_;
  // Large triangles have a grid of n × n cells, (n + 1)(n + 2) / 2 points; small ones (n = 1) interpolate their
  // vertices.
  std::vector<std::uint16_t> steps_;
  std::vector<std::uint64_t> first_point_;
  std::vector<Eigen::Vector3f> grid_light_;
};

}  // namespace lapseam::simulation
