#pragma once

// Which parts of a scene's surface can be seen from where: what trajectories are planned by.

#include <Eigen/Geometry>
#include <cstdint>
#include <string>
#include <vector>

#include "lapseam/mesh.h"
#include "spatial/ray_scene.h"

namespace lapseam::simulation {

/// Points spread evenly over a surface: each stands for the same area.
struct SurfaceSamples {
  std::vector<Eigen::Vector3f> points, normals;
};
SurfaceSamples sample_surface(const Mesh& mesh, std::size_t count, std::uint64_t seed);

struct SightLimits {
  float min_range_m = 0, max_range_m = 1e6f;
  float min_cosine = 0.17f;
};
/// Indices of the samples that face `eye`, lie in range and are not hidden, ascending. The mesh's own frame.
std::vector<std::uint32_t> find_visible(const SurfaceSamples& samples, const RayScene& rays, const Eigen::Vector3f& eye,
                                        const SightLimits& limits);

/// find_visible for every place. Throws InvalidInput, naming the scene, when no place sees anything: a closed surface
/// seen from its inside.
std::vector<std::vector<std::uint32_t>> find_visible_from(const std::vector<Eigen::Vector3f>& places,
                                                          const SurfaceSamples& samples, const RayScene& rays,
                                                          const SightLimits& limits, const std::string& scene_name,
                                                          Context& context);

/// Chooses up to `count` of the places, each the one that sees most of what those before it did not; once nothing new
/// is seen, the one farthest from all before it. seen: from find_visible_from.
std::vector<std::size_t> choose_places(const std::vector<Eigen::Vector3f>& places,
                                       const std::vector<std::vector<std::uint32_t>>& seen, std::size_t samples,
                                       std::size_t count);

}  // namespace lapseam::simulation
