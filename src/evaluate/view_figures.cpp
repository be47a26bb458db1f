#include "evaluate/view_figures.h"

#include <algorithm>
#include <cmath>
#include <optional>

#include "core/parallel.h"
#include "lapseam/sensor.h"

namespace lapseam {
namespace {

constexpr std::size_t kGrain = 1024;

// The point of the range image and the sample may be apart by this much across the surface: a tenth of the distance
// between pixels, which lets curved surfaces pass and keeps out what a flat look under an edge would take for the same
// surface, and what storing ranges in 16 bits costs. Chosen against ray-cast visibility: docs/evaluation.md.
constexpr double kSeenSpacings = 0.1;
constexpr double kSeenRangeShare = 1e-4;

/// The pixel that (u, v) falls into; nothing outside the image.
std::optional<std::size_t> pixel_at(const View& view, double u, double v) {
  const int width = view.range.width, height = view.range.height;
  if (!(u > -1 && u < width + 1 && v > -1 && v < height + 1)) return std::nullopt;
  int column = int(std::floor(u + 0.5));
  const int row = int(std::floor(v + 0.5));
  if (wraps(view.sensor)) column = (column + width) % width;
  if (column < 0 || column >= width || row < 0 || row >= height) return std::nullopt;
  return view.range.index(column, row);
}

void add_ray(RayFigures& figures, const Ray& ray, const RayTargets& targets, const EvaluateOptions& options) {
  const Encounter found = follow(ray, targets.result, targets.result_scene, options.double_layer_m);
  const Encounter truth = follow(ray, targets.truth, targets.truth_scene, options.double_layer_m);
  ++figures.rays;
  figures.hits += found.is_hit;
  figures.front_facing += found.is_front;
  figures.double_layers += found.is_double;
  figures.truth_front_facing += truth.is_front;
  figures.truth_double_layers += truth.is_double;
  if (!found.is_hit) return;
  const double behind_m = found.length_m - ray.sample_length_m;
  figures.close += std::abs(behind_m) <= options.ray_close_m;
  figures.floating += behind_m < -options.gross_m;
  figures.behind += behind_m > options.gross_m;
}

}  // namespace

bool is_seen(const View& view, const Eigen::Vector3d& point, const Eigen::Vector3d& normal, double grazing_cosine) {
  const auto at = project(view.sensor, point);
  if (!at || -normal.dot(ray_direction(view.sensor, at->u, at->v)) <= grazing_cosine) return false;
  const auto pixel = pixel_at(view, at->u, at->v);
  if (!pixel || !(view.range.pixels[*pixel] > kInvalidRange)) return false;
  const auto column = double(*pixel % std::size_t(view.range.width));
  const auto row = double(*pixel / std::size_t(view.range.width));
  const double range = double(view.range.pixels[*pixel]);
  const Eigen::Vector3d measured = unproject(view.sensor, column, row, range);
  const double tolerance =
      kSeenSpacings * sample_spacing(view.sensor, column, row, range) + kSeenRangeShare * std::abs(range);
  // Across the surface, not along the ray: a slanted surface changes its range within a pixel, but stays a plane.
  return std::abs(normal.dot(measured - point)) <= tolerance;
}

RayFigures add(RayFigures a, const RayFigures& b) {
  a.rays += b.rays;
  a.hits += b.hits;
  a.close += b.close;
  a.floating += b.floating;
  a.behind += b.behind;
  a.front_facing += b.front_facing;
  a.double_layers += b.double_layers;
  a.truth_front_facing += b.truth_front_facing;
  a.truth_double_layers += b.truth_double_layers;
  return a;
}

void count_seen(const View& view, const Eigen::Vector3d& origin_m, const Surface& truth, const SurfaceSamples& samples,
                double grazing_cosine, std::vector<std::uint16_t>& seen_by, Context& context) {
  const Eigen::Isometry3d T_view_world = view.T_world_view.inverse();
  parallel_for(context, samples.positions_m.size(), kGrain, [&](std::size_t i) {
    const Eigen::Vector3d normal = truth.normals[samples.triangle[i]].cast<double>();
    const Eigen::Vector3d point = T_view_world * (samples.positions_m[i].cast<double>() + origin_m);
    const bool is_new = seen_by[i] < 0xFFFF && is_seen(view, point, T_view_world.linear() * normal, grazing_cosine);
    if (is_new) ++seen_by[i];
  });
}

RayFigures cast_rays(const View& view, const Eigen::Vector3d& origin_m, const RayTargets& targets,
                     const EvaluateOptions& options, std::uint64_t stream, Context& context) {
  const std::vector<std::size_t> pixels = choose_pixels(view, options.rays_per_view, options.seed, stream);
  RayFigures figures = parallel_reduce(
      context, pixels.size(), kGrain, RayFigures{},
      [&](std::size_t begin, std::size_t end, RayFigures sum) {
        for (std::size_t i = begin; i < end; ++i)
          add_ray(sum, ray_through(view, origin_m, pixels[i]), targets, options);
        return sum;
      },
      [](RayFigures a, const RayFigures& b) { return add(std::move(a), b); });
  figures.view = view.name;
  return figures;
}

}  // namespace lapseam
