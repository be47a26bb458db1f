#pragma once

// How good is a result? Measures a mesh against the true surface, and against what the views truly saw.

#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "lapseam/evaluate_views.h"
#include "lapseam/health.h"
#include "lapseam/mesh.h"
#include "lapseam/view.h"

namespace lapseam {

class Context;

struct EvaluateOptions {
  std::vector<double> at_m = {0.001, 0.002, 0.005, 0.010};  ///< distances for precision, completeness and F-score
  std::size_t samples = 400'000;                            ///< on each of the two surfaces
  std::size_t rays_per_view = 20'000;                       ///< of the valid pixels; all of them if there are fewer
  double gross_m = 0.020;         ///< beyond this a sample is an outlier, and a ray floats or falls behind
  double ray_close_m = 0.010;     ///< a ray within this of the truth is a good one
  double double_layer_m = 0.030;  ///< a second front face within this behind the first is a double layer
  /// Cosine between normal and ray up to which a surface counts as not seen: no sensor measures it so flatly.
  double grazing_cosine = 0.08;
  bool self_intersections = true;
  std::uint64_t seed = 0;
};

/// Views with true poses and noiseless range images, loaded one at a time.
struct TruthViews {
  std::size_t count = 0;
  std::function<View(std::size_t)> load;
};
/// Views that the caller keeps.
TruthViews truth_views(std::span<const View> views);

/// Result to truth: over samples spread evenly on the area of the result. Absent when the result has no area.
struct AccuracyFigures {
  double median_m = 0, rms_m = 0, p90_m = 0, p99_m = 0;
  double rms_within_gross_m = 0;  ///< of the samples that are no outliers
  double beyond_gross_share = 0;
  double bias_median_m = 0;  ///< signed: positive on the side the truth's normals point to; outliers left out
  double normal_deviation_median_rad = 0, normal_deviation_p90_rad = 0;
};

/// Truth to result: over samples of the true surface that a view saw (all samples when there are no views).
struct CompletenessFigures {
  std::uint64_t samples = 0;
  std::uint64_t two_view_samples = 0;  ///< of these, seen by two views or more; 0 without views
  double seen_share = 1;               ///< of the true area
  /// So many connected surfaces, farther apart than gross_m, hold 99 % of what the views saw; 0 without views.
  std::uint64_t seen_pieces = 0;
  double median_m = 0, p90_m = 0;  ///< infinite when the result is empty
};

struct DistanceFigures {
  double at_m = 0;
  double precision = 0;     ///< share of the result's samples this close to the truth; 0 when the result is empty
  double completeness = 0;  ///< share of the seen truth samples this close to the result
  double completeness_two_views = 0;
  double f_score = 0;  ///< harmonic mean of precision and completeness
};

/// Rays through pixels at which a view truly saw something. Counts; shares are of `rays`.
struct RayFigures {
  std::string view;  ///< empty for the sum over views
  std::uint64_t rays = 0;
  std::uint64_t hits = 0;
  std::uint64_t close = 0;          ///< first hit within ray_close_m of the truth
  std::uint64_t floating = 0;       ///< first hit over gross_m in front of it
  std::uint64_t behind = 0;         ///< first hit over gross_m behind it
  std::uint64_t front_facing = 0;   ///< first hit on the front of a triangle
  std::uint64_t double_layers = 0;  ///< of these, the next hit is a front too and within double_layer_m
  std::uint64_t truth_front_facing = 0, truth_double_layers = 0;  ///< the same on the true mesh

  std::uint64_t misses() const { return rays - hits; }
};

struct Evaluation {
  EvaluateOptions options;
  bool has_truth = true;                ///< false: only health and against_views say something
  bool has_views = false;               ///< true ones
  bool is_orientation_flipped = false;  ///< most normals point the wrong way; figures are those of the flipped result
  std::optional<AccuracyFigures> accuracy;
  CompletenessFigures completeness;
  std::vector<DistanceFigures> distances;  ///< one for each of options.at_m
  RayFigures rays;                         ///< all views together; zero without views
  std::vector<RayFigures> rays_by_view;
  /// By the truth: a boundary edge is a crack where the true surface goes on beyond it and a view saw it there, an end
  /// where it does not go on. Zero without views.
  BoundaryFigures boundary;
  MeshHealth health;  ///< of the welded result
  /// What the measured views say; evaluate() leaves it to evaluate_views().
  std::optional<ViewEvaluation> against_views{};
};

/// Vertices of the result at equal positions count as one. The same figures for any number of threads.
/// Throws InvalidInput when the truth has no area or options are out of range. Memory: both meshes and their BVHs, the
/// samples, one view.
Evaluation evaluate(const Mesh& result, const Mesh& truth, const TruthViews& views, const EvaluateOptions& options,
                    Context& context);

/// A table for people, one figure a line.
std::string to_text(const Evaluation& evaluation);
/// Keys as in docs/evaluation.md: millimetres, degrees, percent; null where there is nothing to say.
std::string to_json(const Evaluation& evaluation);

}  // namespace lapseam
