#pragma once

// What a view with a true range image says about surfaces: which samples it saw, and where its rays go.

#include <Eigen/Geometry>
#include <cstdint>
#include <span>
#include <vector>

#include "evaluate/follow_ray.h"
#include "evaluate/surface_samples.h"
#include "lapseam/evaluate.h"
#include "spatial/ray_scene.h"

namespace lapseam {

/// Whether the view saw a point of a true surface; point and unit normal in the view's frame. As count_seen says.
bool is_seen(const View& view, const Eigen::Vector3d& point, const Eigen::Vector3d& normal, double grazing_cosine);

/// Adds one to seen_by[i] for each sample of the true surface that the view saw: it faces the sensor, at an
/// angle whose cosine is over grazing_cosine, and the range image has, at its pixel, a point of the same surface.
/// Surface and samples are relative to origin_m.
void count_seen(const View& view, const Eigen::Vector3d& origin_m, const Surface& truth, const SurfaceSamples& samples,
                double grazing_cosine, std::vector<std::uint16_t>& seen_by, Context& context);

/// Sums the counts; keeps the name of the first.
RayFigures add(RayFigures a, const RayFigures& b);

struct RayTargets {
  const Surface& result;
  const RayScene& result_scene;
  const Surface& truth;
  const RayScene& truth_scene;
};

/// Casts rays through at most options.rays_per_view of the view's valid pixels. stream: one per view.
RayFigures cast_rays(const View& view, const Eigen::Vector3d& origin_m, const RayTargets& targets,
                     const EvaluateOptions& options, std::uint64_t stream, Context& context);

}  // namespace lapseam
