#pragma once

// Rays through the pixels of a view, and what they meet on a surface.

#include <Eigen/Geometry>
#include <cstdint>
#include <vector>

#include "evaluate/surface_samples.h"
#include "lapseam/view.h"
#include "spatial/ray_scene.h"

namespace lapseam {

/// Relative to the surfaces' origin.
struct Ray {
  Eigen::Vector3f origin, direction;  ///< direction is unit
  double sample_length_m;             ///< from the origin to the view's sample
};
/// Through a sample, a hair beside its pixel's centre.
Ray ray_through(const View& view, const Eigen::Vector3d& origin_m, std::size_t pixel);

/// What a ray meets first, and whether another front follows within double_layer_m, with no back in between.
struct Encounter {
  bool is_hit = false, is_front = false, is_double = false;
  double length_m = 0;
};
Encounter follow(const Ray& ray, const Surface& surface, const RayScene& scene, double double_layer_m);

/// Valid pixels in increasing order, at most count, chosen at random but always the same. stream: one per view.
std::vector<std::size_t> choose_pixels(const View& view, std::size_t count, std::uint64_t seed, std::uint64_t stream);

}  // namespace lapseam
