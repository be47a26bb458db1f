#include <fmt/format.h>

#include <nlohmann/json.hpp>

#include "evaluate/finite_or_null.h"
#include "evaluate/table.h"
#include "lapseam/evaluate.h"

namespace lapseam {
namespace {

using Json = nlohmann::ordered_json;

Json accuracy_json(const Evaluation& e) {
  if (!e.accuracy) return nullptr;
  const AccuracyFigures& a = *e.accuracy;
  return {{"median_mm", kMmPerM * a.median_m},
          {"rms_mm", kMmPerM * a.rms_m},
          {"p90_mm", kMmPerM * a.p90_m},
          {"p99_mm", kMmPerM * a.p99_m},
          {"rms_within_gross_mm", kMmPerM * a.rms_within_gross_m},
          {"beyond_gross_percent", 100 * a.beyond_gross_share},
          {"bias_median_mm", kMmPerM * a.bias_median_m},
          {"normal_deviation_median_deg", kDegPerRad * a.normal_deviation_median_rad},
          {"normal_deviation_p90_deg", kDegPerRad * a.normal_deviation_p90_rad},
          {"orientation_flipped", e.is_orientation_flipped}};
}

Json completeness_json(const Evaluation& e) {
  const CompletenessFigures& c = e.completeness;
  return {{"samples", c.samples},
          {"two_view_samples", e.has_views ? Json(c.two_view_samples) : Json(nullptr)},
          {"seen_percent", e.has_views ? Json(100 * c.seen_share) : Json(nullptr)},
          {"seen_pieces", e.has_views ? Json(c.seen_pieces) : Json(nullptr)},
          {"median_mm", c.samples ? finite_or_null(kMmPerM * c.median_m) : Json(nullptr)},
          {"p90_mm", c.samples ? finite_or_null(kMmPerM * c.p90_m) : Json(nullptr)}};
}

Json distances_json(const Evaluation& e) {
  Json list = Json::array();
  for (const DistanceFigures& d : e.distances)
    list.push_back(
        {{"at_mm", kMmPerM * d.at_m},
         {"precision_percent", 100 * d.precision},
         {"completeness_percent", 100 * d.completeness},
         {"completeness_two_views_percent",
          e.has_views && e.completeness.two_view_samples ? Json(100 * d.completeness_two_views) : Json(nullptr)},
         {"f_score_percent", 100 * d.f_score}});
  return list;
}

Json rays_json(const RayFigures& r) {
  Json json;
  if (!r.view.empty()) json["view"] = r.view;
  json["rays"] = r.rays;
  json["close_percent"] = percent(r.close, r.rays);
  json["miss_percent"] = percent(r.misses(), r.rays);
  json["floating_percent"] = percent(r.floating, r.rays);
  json["behind_percent"] = percent(r.behind, r.rays);
  json["front_facing_percent"] = percent(r.front_facing, r.hits);
  json["double_layer_percent"] = percent(r.double_layers, r.front_facing);
  json["truth_double_layer_percent"] = percent(r.truth_double_layers, r.truth_front_facing);
  return json;
}

Json options_json(const EvaluateOptions& o) {
  return {{"samples", o.samples},
          {"rays_per_view", o.rays_per_view},
          {"gross_mm", kMmPerM * o.gross_m},
          {"ray_close_mm", kMmPerM * o.ray_close_m},
          {"double_layer_mm", kMmPerM * o.double_layer_m},
          {"grazing_cosine", o.grazing_cosine},
          {"seed", o.seed}};
}

void add_accuracy(Table& table, const Evaluation& e) {
  table.head("accuracy (result to truth)");
  if (!e.accuracy) {
    table.text("  the result has no area\n");
    return;
  }
  table.mm("median", e.accuracy->median_m);
  table.mm("rms", e.accuracy->rms_m);
  table.mm("90 %", e.accuracy->p90_m);
  table.mm("99 %", e.accuracy->p99_m);
  table.share(fmt::format("beyond {:g} mm", kMmPerM * e.options.gross_m), e.accuracy->beyond_gross_share);
  table.mm("rms of the rest", e.accuracy->rms_within_gross_m);
  table.mm("bias, median", e.accuracy->bias_median_m);
  table.degrees("normal deviation, median", e.accuracy->normal_deviation_median_rad);
  table.degrees("normal deviation, 90 %", e.accuracy->normal_deviation_p90_rad);
  if (e.is_orientation_flipped) table.text("  the result is inside out: measured with its normals turned\n");
}

void add_completeness(Table& table, const Evaluation& e) {
  table.head(e.has_views ? "completeness (truth that a view saw, to result)"
                         : "completeness (all of the truth to result; no views given, so seen or not)");
  if (e.has_views) table.share("truth seen", e.completeness.seen_share);
  if (e.has_views) table.count("pieces that hold 99 % of it", e.completeness.seen_pieces);
  if (e.completeness.samples > 0) {
    table.mm("median", e.completeness.median_m);
    table.mm("90 %", e.completeness.p90_m);
  }
  table.text(fmt::format("  {:<10}{:>12}{:>14}{:>12}{}\n", "within", "precision", "completeness", "F-score",
                         e.has_views ? "   compl. 2+ views" : ""));
  for (const DistanceFigures& d : e.distances) {
    table.text(fmt::format("  {:<10}{:>10.3f} %{:>12.3f} %{:>10.3f} %", fmt::format("{:g} mm", kMmPerM * d.at_m),
                           100 * d.precision, 100 * d.completeness, 100 * d.f_score));
    if (e.has_views) table.text(fmt::format("{:>16.3f} %", 100 * d.completeness_two_views));
    table.text("\n");
  }
}

void add_rays(Table& table, const Evaluation& e) {
  if (!e.has_views) {
    table.head("rays: left out, no views given");
    return;
  }
  table.head("rays (through pixels that truly see something)");
  const RayFigures& r = e.rays;
  const double gross_mm = kMmPerM * e.options.gross_m;
  table.count("rays", r.rays);
  table.share(fmt::format("within {:g} mm", kMmPerM * e.options.ray_close_m), r.close, r.rays);
  table.share("miss", r.misses(), r.rays);
  table.share(fmt::format("float over {:g} mm in front", gross_mm), r.floating, r.rays);
  table.share(fmt::format("over {:g} mm behind", gross_mm), r.behind, r.rays);
  table.share("front-facing, of hits", r.front_facing, r.hits);
  table.share("double layer, of these", r.double_layers, r.front_facing);
  table.share("  the same on the truth", r.truth_double_layers, r.truth_front_facing);
}

void add_health(Table& table, const MeshHealth& h) {
  table.head("mesh (vertices at equal positions welded)");
  table.count("vertices", h.vertices);
  table.count("triangles", h.triangles);
  table.count("components", h.components);
  table.count("  of 100 triangles or more", h.components_100_triangles);
  table.share("  largest, of triangles", h.largest_component_share);
  table.count("  that hold 99 % of the area", h.components_99_percent_area);
  table.count("  smallest, triangles", h.smallest_component_triangles);
  table.count("boundary edges", h.boundary_edges);
  table.metres("boundary length", h.boundary_length_m);
  table.count("boundary loops", h.boundary_loops);
  table.count("non-manifold edges", h.nonmanifold_edges);
  table.count("misoriented edges", h.misoriented_edges);
  table.count("pinched vertices", h.pinched_vertices);
  table.count("duplicate triangles", h.duplicate_triangles);
  table.count("degenerate triangles", h.degenerate_triangles);
  table.line("self-intersecting triangles",
             h.self_intersections_checked ? fmt::format("{}", h.self_intersecting_triangles) : "not checked");
  const auto& angle = h.min_angle_percentiles_deg;
  table.line("smallest angle 1/5/25/50 %",
             fmt::format("{:.1f}/{:.1f}/{:.1f}/{:.1f} °", angle[0], angle[1], angle[2], angle[3]));
  table.share("smallest angle under 10°", h.min_angle_below_10_deg_share);
  table.mm("side of a triangle, median", h.edge_length_median_m);
}

void add_seams(Table& table, const SeamHealth& s) {
  table.head("seams (where measured patches meet)");
  table.count("patches", s.patches);
  table.count("  islands of under 40 triangles", s.islands);
  table.metres("seam length", s.seam_length_m);
  table.line("seam length per area", fmt::format("{:.3f} /m", s.seam_length_per_area_per_m));
  table.count("seam triangles", s.seam_triangles);
  table.share("  their area", s.seam_area_share);
  const auto& angle = s.seam_min_angle_percentiles_deg;
  table.line("  smallest angle 1/5/25 %", fmt::format("{:.1f}/{:.1f}/{:.1f} °", angle[0], angle[1], angle[2]));
  table.line("  self-intersecting",
             s.self_intersections_checked ? fmt::format("{}", s.self_intersecting_seam_triangles) : "not checked");
}

}  // namespace

std::string to_text(const Evaluation& evaluation) {
  Table table;
  if (evaluation.has_truth) {
    add_accuracy(table, evaluation);
    add_completeness(table, evaluation);
    add_rays(table, evaluation);
  }
  if (evaluation.against_views) table.text(to_text(*evaluation.against_views));
  if (evaluation.has_views) add_boundary(table, "boundary, by the truth", evaluation.boundary);
  add_health(table, evaluation.health);
  if (evaluation.health.seams) add_seams(table, *evaluation.health.seams);
  return table.take();
}

std::string to_json(const Evaluation& evaluation) {
  Json json = {{"format", "lapseam-evaluation"}, {"version", 1}};
  json["options"] = options_json(evaluation.options);
  json["accuracy"] = accuracy_json(evaluation);
  json["completeness"] = evaluation.has_truth ? completeness_json(evaluation) : Json(nullptr);
  json["distances"] = distances_json(evaluation);
  json["rays"] = evaluation.has_views ? rays_json(evaluation.rays) : Json(nullptr);
  json["rays_by_view"] = Json::array();
  for (const RayFigures& view : evaluation.rays_by_view) json["rays_by_view"].push_back(rays_json(view));
  json["boundary"] = evaluation.has_views ? Json::parse(to_json(evaluation.boundary)) : Json(nullptr);
  json["against_views"] = evaluation.against_views ? Json::parse(to_json(*evaluation.against_views)) : Json(nullptr);
  json["mesh"] = Json::parse(to_json(evaluation.health));
  return json.dump(1);
}

}  // namespace lapseam
