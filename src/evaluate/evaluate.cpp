#include "lapseam/evaluate.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "core/parallel.h"
#include "evaluate/seen_surfaces.h"
#include "evaluate/surface_samples.h"
#include "evaluate/truth_boundary.h"
#include "evaluate/view_figures.h"
#include "health/percentile.h"
#include "lapseam/context.h"
#include "lapseam/error.h"
#include "spatial/ray_scene.h"

namespace lapseam {
namespace {

constexpr std::size_t kGrain = 1024;

// Streams of random numbers; views have those from kFirstViewStream on.
constexpr std::uint64_t kResultStream = 1;
constexpr std::uint64_t kTruthStream = 2;
constexpr std::uint64_t kFirstViewStream = 16;

void check_options(const EvaluateOptions& options) {
  const auto check = [](bool is_right, const char* field, const char* problem) {
    if (!is_right) throw InvalidInput({}, {}, field, problem);
  };
  const auto is_length = [](double x) { return std::isfinite(x) && x > 0; };
  check(std::all_of(options.at_m.begin(), options.at_m.end(), is_length), "at", "must be positive distances");
  check(options.samples > 0, "samples", "must be at least 1");
  check(is_length(options.gross_m), "gross_m", "must be a positive distance");
  check(is_length(options.ray_close_m), "ray_close_m", "must be a positive distance");
  check(options.grazing_cosine >= 0 && options.grazing_cosine < 1, "grazing_cosine", "must be in [0, 1)");
  check(is_length(options.double_layer_m), "double_layer_m", "must be a positive distance");
}

/// A surface that can be asked for rays and closest points, and points spread over it.
struct Side {
  Surface surface;
  RayScene scene;
  SurfaceSamples samples;

  Side(const Mesh& mesh, const Eigen::Vector3d& origin_m, const EvaluateOptions& options, std::uint64_t stream,
       Context& context)
      : surface(make_surface(mesh, origin_m, context)),
        scene(surface.positions_m, surface.triangles, context),
        samples(sample_surface(surface, options.samples, options.seed, stream, context)) {}
};

/// What lies between each sample of the result and the closest point of the truth.
struct Deviations {
  std::vector<float> distance_m, signed_m, angle_rad;
};

Deviations measure_deviations(const Side& result, const Side& truth, Context& context) {
  const std::size_t n = result.samples.positions_m.size();
  Deviations deviations{std::vector<float>(n), std::vector<float>(n), std::vector<float>(n)};
  parallel_for(context, n, kGrain, [&](std::size_t i) {
    const Eigen::Vector3f& p = result.samples.positions_m[i];
    const ClosestPoint closest = truth.scene.closest(p);
    const Eigen::Vector3f& normal = truth.surface.normals[closest.triangle];
    deviations.distance_m[i] = closest.distance;
    deviations.signed_m[i] = (p - closest.point).dot(normal);
    const float cosine = result.surface.normals[result.samples.triangle[i]].dot(normal);
    deviations.angle_rad[i] = std::acos(std::clamp(cosine, -1.0f, 1.0f));
  });
  return deviations;
}

std::vector<float> sorted(std::vector<float> values, Context& context) {
  parallel_sort(context, values.begin(), values.end(), std::less<>());
  return values;
}

/// Most normals point the wrong way: the result is inside out. Turns its normals and the angles.
bool mend_orientation(Side& result, Deviations& deviations, Context& context) {
  if (percentile(sorted(deviations.angle_rad, context), 50) <= std::numbers::pi / 2) return false;
  for (Eigen::Vector3f& normal : result.surface.normals) normal = -normal;
  for (float& angle : deviations.angle_rad) angle = std::numbers::pi_v<float> - angle;
  return true;
}

AccuracyFigures summarize(const Deviations& deviations, double gross_m, Context& context) {
  AccuracyFigures figures;
  double sum = 0, near_sum = 0;
  std::vector<float> near_signed;
  for (std::size_t i = 0; i < deviations.distance_m.size(); ++i) {
    const double squared = double(deviations.distance_m[i]) * double(deviations.distance_m[i]);
    sum += squared;
    if (double(deviations.distance_m[i]) >= gross_m) continue;
    near_sum += squared;
    near_signed.push_back(deviations.signed_m[i]);
  }
  const auto n = double(deviations.distance_m.size()), near = double(near_signed.size());
  figures.rms_m = std::sqrt(sum / n);
  figures.beyond_gross_share = 1 - near / n;
  if (!near_signed.empty()) {
    figures.rms_within_gross_m = std::sqrt(near_sum / near);
    figures.bias_median_m = percentile(sorted(std::move(near_signed), context), 50);
  }
  const std::vector<float> distance = sorted(deviations.distance_m, context);
  figures.median_m = percentile(distance, 50);
  figures.p90_m = percentile(distance, 90);
  figures.p99_m = percentile(distance, 99);
  const std::vector<float> angle = sorted(deviations.angle_rad, context);
  figures.normal_deviation_median_rad = percentile(angle, 50);
  figures.normal_deviation_p90_rad = percentile(angle, 90);
  return figures;
}

/// Distances from truth samples to the result, sorted: all that count, and those that two views saw.
struct Gaps {
  std::vector<float> all_m, two_views_m;
};

Gaps measure_gaps(const Side& result, const Side& truth, const std::vector<std::uint16_t>& seen_by, Context& context) {
  const std::size_t n = truth.samples.positions_m.size();
  std::vector<float> distance(n, std::numeric_limits<float>::infinity());
  if (!result.samples.triangle.empty()) {
    parallel_for(context, n, kGrain, [&](std::size_t i) {
      if (seen_by[i] > 0) distance[i] = result.scene.closest(truth.samples.positions_m[i]).distance;
    });
  }
  Gaps gaps;
  for (std::size_t i = 0; i < n; ++i) {
    if (seen_by[i] > 0) gaps.all_m.push_back(distance[i]);
    if (seen_by[i] > 1) gaps.two_views_m.push_back(distance[i]);
  }
  gaps.all_m = sorted(std::move(gaps.all_m), context);
  gaps.two_views_m = sorted(std::move(gaps.two_views_m), context);
  return gaps;
}

/// Share of the sorted values that are at most `limit`; 0 of none.
double share_up_to(const std::vector<float>& values, double limit) {
  if (values.empty()) return 0;
  const auto end =
      std::upper_bound(values.begin(), values.end(), limit, [](double x, float value) { return x < double(value); });
  return double(end - values.begin()) / double(values.size());
}

CompletenessFigures summarize(const Gaps& gaps, std::size_t samples) {
  CompletenessFigures figures;
  figures.samples = gaps.all_m.size();
  figures.two_view_samples = gaps.two_views_m.size();
  figures.seen_share = double(gaps.all_m.size()) / double(samples);
  if (gaps.all_m.empty()) return figures;
  figures.median_m = percentile(gaps.all_m, 50);
  figures.p90_m = percentile(gaps.all_m, 90);
  return figures;
}

/// What views saw of the truth: how many each of its samples, and in how many pieces.
struct Seen {
  std::vector<std::uint16_t> by;
  std::uint64_t pieces = 0;
};

/// Loads one view after the other: which truth samples it saw, where its rays go, and what lies beyond the boundary.
Seen visit_views(const TruthViews& views, const Eigen::Vector3d& origin_m, const Side& result, const Side& truth,
                 Evaluation& evaluation, Context& context) {
  if (views.count == 0) return {std::vector<std::uint16_t>(truth.samples.positions_m.size(), 1)};
  std::vector<std::uint16_t> seen_by(truth.samples.positions_m.size(), 0);
  TruthBoundary boundary(result.surface, truth.surface, truth.scene, evaluation.options, context);
  SeenSurfaces surfaces(evaluation.options.gross_m, origin_m);
  StageScope stage(context, "evaluate views", views.count);
  for (std::size_t i = 0; i < views.count; ++i) {
    const View view = views.load(i);
    count_seen(view, origin_m, truth.surface, truth.samples, evaluation.options.grazing_cosine, seen_by, context);
    evaluation.rays_by_view.push_back(cast_rays(view, origin_m,
                                                {result.surface, result.scene, truth.surface, truth.scene},
                                                evaluation.options, kFirstViewStream + i, context));
    evaluation.rays = add(std::move(evaluation.rays), evaluation.rays_by_view.back());
    boundary.visit(view, origin_m, context);
    surfaces.visit(view);
    stage.advance();
  }
  evaluation.boundary = boundary.figures();
  return {std::move(seen_by), surfaces.pieces_99_percent()};
}

}  // namespace

TruthViews truth_views(std::span<const View> views) {
  return {views.size(), [views](std::size_t i) { return views[i]; }};
}

Evaluation evaluate(const Mesh& result, const Mesh& truth, const TruthViews& views, const EvaluateOptions& options,
                    Context& context) {
  check_options(options);
  check_mesh(truth);
  Evaluation evaluation;
  evaluation.options = options;
  evaluation.has_views = views.count > 0;
  {
    const StageScope stage(context, "evaluate health");
    evaluation.health = check_health(result, {.weld = true, .self_intersections = options.self_intersections}, context);
  }

  const Eigen::Vector3d origin_m = truth.origin_m;
  const Side truth_side(truth, origin_m, options, kTruthStream, context);
  if (truth_side.samples.triangle.empty()) throw InvalidInput({}, {}, "truth", "the true mesh has no area");
  Side result_side(result, origin_m, options, kResultStream, context);

  Deviations deviations;
  {
    const StageScope stage(context, "evaluate accuracy");
    deviations = measure_deviations(result_side, truth_side, context);
    if (!deviations.distance_m.empty()) {
      evaluation.is_orientation_flipped = mend_orientation(result_side, deviations, context);
      evaluation.accuracy = summarize(deviations, options.gross_m, context);
    }
  }

  const Seen seen = visit_views(views, origin_m, result_side, truth_side, evaluation, context);

  const StageScope stage(context, "evaluate completeness");
  const Gaps gaps = measure_gaps(result_side, truth_side, seen.by, context);
  evaluation.completeness = summarize(gaps, seen.by.size());
  evaluation.completeness.seen_pieces = seen.pieces;
  const std::vector<float> distance = sorted(std::move(deviations.distance_m), context);
  for (const double at_m : options.at_m) {
    DistanceFigures figures{at_m, share_up_to(distance, at_m), share_up_to(gaps.all_m, at_m),
                            share_up_to(gaps.two_views_m, at_m), 0};
    if (const double sum = figures.precision + figures.completeness; sum > 0)
      figures.f_score = 2 * figures.precision * figures.completeness / sum;
    evaluation.distances.push_back(figures);
  }
  return evaluation;
}

}  // namespace lapseam
