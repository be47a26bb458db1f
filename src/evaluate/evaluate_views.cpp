#include "lapseam/evaluate_views.h"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "core/parallel.h"
#include "evaluate/follow_ray.h"
#include "evaluate/table.h"
#include "health/percentile.h"
#include "lapseam/context.h"
#include "lapseam/error.h"
#include "lapseam/sensor.h"

namespace lapseam {
namespace {

constexpr std::size_t kGrain = 1024;

void check_options(const ViewEvaluationOptions& options) {
  const auto check = [](double x, const char* field) {
    if (!(std::isfinite(x) && x > 0)) throw InvalidInput({}, {}, field, "must be positive");
  };
  check(options.within_m, "within_m");
  check(options.within_spacings, "within_spacings");
  check(options.double_layer_m, "double_layer_m");
}

/// The result as rays meet it.
struct Target {
  const Surface& surface;
  const RayScene& scene;
  const Eigen::Vector3d& origin_m;
};

/// One view's counts, and the hits' differences in range.
struct ViewRanges {
  RangeFigures figures;
  std::vector<float> differences_m;
};

/// A ray's encounter, and by how much its range is off the sample's; NaN when nothing is hit.
struct Shot {
  Encounter found;
  float difference_m;
  float spacing_m;
};

ViewRanges measure_ranges(const View& view, const Target& target, const ViewEvaluationOptions& options,
                          std::uint64_t stream, Context& context) {
  const std::vector<std::size_t> pixels = choose_pixels(view, options.rays_per_view, options.seed, stream);
  std::vector<Shot> shots(pixels.size());
  parallel_for(context, pixels.size(), kGrain, [&](std::size_t i) {
    const Ray ray = ray_through(view, target.origin_m, pixels[i]);
    const double range = double(view.range.pixels[pixels[i]]);
    const auto u = double(pixels[i] % std::size_t(view.range.width));
    const auto v = double(pixels[i] / std::size_t(view.range.width));
    Shot& shot = shots[i];
    shot.found = follow(ray, target.surface, target.scene, options.double_layer_m);
    // Range is proportional to the length of a ray from where range is zero.
    shot.difference_m = float((shot.found.length_m / ray.sample_length_m - 1) * range);
    shot.spacing_m = float(sample_spacing(view.sensor, u, v, range));
  });
  ViewRanges ranges;
  RangeFigures& f = ranges.figures;
  f.view = view.name;
  f.rays = shots.size();
  for (const Shot& shot : shots) {
    f.hits += shot.found.is_hit;
    f.front_facing += shot.found.is_front;
    f.double_layers += shot.found.is_double;
    if (!shot.found.is_hit) continue;
    const auto difference = double(shot.difference_m);
    f.within += std::abs(difference) <= options.within_m;
    f.within_scaled += std::abs(difference) <= options.within_spacings * double(shot.spacing_m);
    f.floating += difference < -options.within_m;
    f.behind += difference > options.within_m;
    ranges.differences_m.push_back(shot.difference_m);
  }
  return ranges;
}

void set_percentiles(RangeFigures& figures, std::vector<float> differences_m, Context& context) {
  if (differences_m.empty()) return;
  parallel_sort(context, differences_m.begin(), differences_m.end(), std::less<>());
  figures.median_m = percentile(differences_m, 50);
  for (float& difference : differences_m) difference = std::abs(difference);
  parallel_sort(context, differences_m.begin(), differences_m.end(), std::less<>());
  figures.median_absolute_m = percentile(differences_m, 50);
  figures.p90_absolute_m = percentile(differences_m, 90);
}

void add(RangeFigures& sum, const RangeFigures& view) {
  sum.rays += view.rays;
  sum.hits += view.hits;
  sum.within += view.within;
  sum.within_scaled += view.within_scaled;
  sum.floating += view.floating;
  sum.behind += view.behind;
  sum.front_facing += view.front_facing;
  sum.double_layers += view.double_layers;
}

nlohmann::ordered_json ranges_json(const RangeFigures& f) {
  nlohmann::ordered_json json;
  if (!f.view.empty()) json["view"] = f.view;
  const auto mm = [&](double m) {
    return f.hits > 0 ? nlohmann::ordered_json(kMmPerM * m) : nlohmann::ordered_json(nullptr);
  };
  json["rays"] = f.rays;
  json["median_absolute_mm"] = mm(f.median_absolute_m);
  json["p90_absolute_mm"] = mm(f.p90_absolute_m);
  json["median_mm"] = mm(f.median_m);
  json["within_percent"] = percent(f.within, f.rays);
  json["within_scaled_percent"] = percent(f.within_scaled, f.rays);
  json["miss_percent"] = percent(f.misses(), f.rays);
  json["floating_percent"] = percent(f.floating, f.rays);
  json["behind_percent"] = percent(f.behind, f.rays);
  json["front_facing_percent"] = percent(f.front_facing, f.hits);
  json["double_layer_percent"] = percent(f.double_layers, f.front_facing);
  return json;
}

}  // namespace

ViewEvaluation evaluate_views(const Mesh& result, const MeasuredViews& views, const MeasuredViews& boundary_views,
                              const ViewEvaluationOptions& options, Context& context) {
  check_options(options);
  check_mesh(result);
  ViewEvaluation evaluation;
  evaluation.options = options;
  Mesh welded;  // topology is that of the welded result, as in MeshHealth
  welded.origin_m = result.origin_m;
  {
    Surface surface = make_surface(result, result.origin_m, context);
    const RayScene scene(surface.positions_m, surface.triangles, context);
    StageScope stage(context, "evaluate ranges", views.count);
    std::vector<float> differences;
    for (std::size_t i = 0; i < views.count; ++i) {
      ViewRanges ranges = measure_ranges(views.load(i), {surface, scene, result.origin_m}, options, i, context);
      differences.insert(differences.end(), ranges.differences_m.begin(), ranges.differences_m.end());
      set_percentiles(ranges.figures, std::move(ranges.differences_m), context);
      add(evaluation.ranges, ranges.figures);
      evaluation.ranges_by_view.push_back(std::move(ranges.figures));
      stage.advance();
    }
    set_percentiles(evaluation.ranges, std::move(differences), context);
    welded.positions_m = std::move(surface.positions_m);
    welded.triangles = std::move(surface.triangles);
  }
  evaluation.boundary = classify_boundary(welded, boundary_views, options.boundary, context).figures;
  return evaluation;
}

void add_boundary(Table& table, std::string_view title, const BoundaryFigures& b) {
  table.head(title);
  table.metres("length", b.length_m);
  table.metres("  seen to end", b.seen_end_length_m);
  table.metres("  nobody saw beyond", b.unseen_length_m);
  table.metres("  crack", b.crack_length_m);
  table.share("  crack, of the length", b.crack_share());
  table.count("loops", b.loops);
  table.count("  cracks for the most part", b.crack_loops);
  table.metres("  these, length", b.crack_loop_length_m);
}

std::string to_text(const ViewEvaluation& evaluation) {
  Table table;
  const RangeFigures& f = evaluation.ranges;
  const double within_mm = kMmPerM * evaluation.options.within_m;
  table.head("measured views (rays through valid samples)");
  table.count("rays", f.rays);
  table.mm("range off, median", f.median_absolute_m);
  table.mm("range off, 90 %", f.p90_absolute_m);
  table.mm("range off, signed median", f.median_m);
  table.share(fmt::format("within {:g} mm", within_mm), f.within, f.rays);
  table.share(fmt::format("within {:g} sample spacings", evaluation.options.within_spacings), f.within_scaled, f.rays);
  table.share("miss", f.misses(), f.rays);
  table.share(fmt::format("float over {:g} mm in front", within_mm), f.floating, f.rays);
  table.share(fmt::format("over {:g} mm behind", within_mm), f.behind, f.rays);
  table.share("front-facing, of hits", f.front_facing, f.hits);
  table.share("double layer, of these", f.double_layers, f.front_facing);
  add_boundary(table, "boundary, by the measured views", evaluation.boundary);
  return table.take();
}

std::string to_json(const ViewEvaluation& evaluation) {
  const ViewEvaluationOptions& o = evaluation.options;
  nlohmann::ordered_json json;
  json["options"] = {{"rays_per_view", o.rays_per_view},
                     {"within_mm", kMmPerM * o.within_m},
                     {"within_spacings", o.within_spacings},
                     {"double_layer_mm", kMmPerM * o.double_layer_m},
                     {"registration_error_mm", kMmPerM * o.boundary.registration_error_m},
                     {"seed", o.seed}};
  json["ranges"] = ranges_json(evaluation.ranges);
  json["boundary"] = nlohmann::ordered_json::parse(to_json(evaluation.boundary));
  json["ranges_by_view"] = nlohmann::ordered_json::array();
  for (const RangeFigures& view : evaluation.ranges_by_view) json["ranges_by_view"].push_back(ranges_json(view));
  return json.dump();
}

}  // namespace lapseam
