#pragma once

// How good is a result where nobody knows the truth? Measures a mesh against the views themselves, best against such as
// it was not made from.

#include <cstdint>
#include <string>
#include <vector>

#include "lapseam/boundary.h"
#include "lapseam/mesh.h"

namespace lapseam {

class Context;

struct ViewEvaluationOptions {
  std::size_t rays_per_view = 20'000;  ///< of the valid samples; all of them if there are fewer
  double within_m = 0.020;
  /// The same scaled to the data: so many sample spacings of the view at the sample's range.
  double within_spacings = 2;
  double double_layer_m = 0.030;  ///< a second front face within this behind the first is a double layer
  BoundaryOptions boundary{};
  std::uint64_t seed = 0;
};

/// Rays through valid samples. Counts; lengths in metres, in the sensor's own range (z for a pinhole): the mesh's less
/// the measured. Zero where no ray hits.
struct RangeFigures {
  std::string view;  ///< empty for all views together
  std::uint64_t rays = 0;
  std::uint64_t hits = 0;
  std::uint64_t within = 0;         ///< first hit within within_m
  std::uint64_t within_scaled = 0;  ///< within within_spacings sample spacings
  std::uint64_t floating = 0;       ///< over within_m in front of the sample
  std::uint64_t behind = 0;         ///< over within_m behind it
  std::uint64_t front_facing = 0;   ///< first hit on the front of a triangle
  std::uint64_t double_layers = 0;  ///< of these, the next hit is a front too and within double_layer_m
  double median_absolute_m = 0, p90_absolute_m = 0;
  double median_m = 0;  ///< signed: positive where the mesh lies behind

  std::uint64_t misses() const { return rays - hits; }
};

struct ViewEvaluation {
  ViewEvaluationOptions options;
  RangeFigures ranges;  ///< all views together
  std::vector<RangeFigures> ranges_by_view;
  BoundaryFigures boundary;
};

/// Vertices of the result at equal positions count as one. boundary_views: those that the boundary is classified with,
/// best the same ones smoothed, whose noise hides fewer steps. The same figures for any number of threads. Loads every
/// view of either once. Memory: the mesh and its BVH, one view. Throws InvalidInput when options are out of range, and
/// what `load` throws.
ViewEvaluation evaluate_views(const Mesh& result, const MeasuredViews& views, const MeasuredViews& boundary_views,
                              const ViewEvaluationOptions& options, Context& context);

/// A table for people, and one JSON object with keys as in docs/evaluation.md.
std::string to_text(const ViewEvaluation& evaluation);
std::string to_json(const ViewEvaluation& evaluation);

}  // namespace lapseam
