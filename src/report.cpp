#include <nlohmann/json.hpp>

#include "io/noise_json.h"
#include "lapseam/context.h"
#include "lapseam/integrate.h"
#include "lapseam/register_scene.h"
#include "report_head.h"

namespace lapseam {
namespace {

using Json = nlohmann::ordered_json;

Json of_claims(const ClaimCounts& counts) {
  return {{"best", counts.best}, {"yields", counts.yields}, {"phantom", counts.phantom}, {"islands", counts.islands}};
}

Json of_sensor(const SensorReport& sensor) {
  Json thresholds = Json::array();
  for (std::size_t k = 0; k < 3; ++k)
    thresholds.push_back({{"range_m", sensor.range_m[k]},
                          {"sigma_m", sensor.sigma_m[k]},
                          {"sample_spacing_m", sensor.spacing_m[k]},
                          {"step_m", sensor.step_m[k]}});
  Json bins = Json::array();
  for (const NoiseBin& bin : sensor.measured.bins)
    bins.push_back({{"range_m", bin.range_m}, {"sigma_m", bin.sigma_m}, {"samples", bin.samples}});
  return {{"noise", noise_to_json(sensor.noise)},
          {"noise_from", sensor.is_noise_given ? "manifest" : "data"},
          {"noise_by_range", bins},
          {"thresholds", thresholds}};
}

Json of_view(const ViewReport& view) {
  return {{"name", view.name},
          {"samples", view.samples},
          {"triangles", view.triangles},
          {"triangles_in_model", view.triangles_in_model},
          {"smoothing_sigma_factor", view.smoothing_sigma_factor},
          {"samples_claimed", of_claims(view.claims)}};
}

}  // namespace

std::string to_json(const TextureReport& t) {
  const Json json = {{"charts", t.charts},
                     {"pages", t.pages},
                     {"page_pixels", t.page_pixels},
                     {"chart_pixels", t.chart_pixels},
                     {"used_pixels", t.used_pixels},
                     {"fill_percent", 100 * t.fill()},
                     {"fringe_pixels", t.fringe_pixels},
                     {"vertex_colored_triangles", t.vertex_colored_triangles},
                     {"unseen_triangles", t.unseen_triangles},
                     {"retaken_triangles", t.retaken_triangles},
                     {"scale", t.scale},
                     {"observations", t.observations},
                     {"lowest_gain", t.lowest_gain},
                     {"highest_gain", t.highest_gain},
                     {"color_residual_before_percent", 100 * t.color_residual_before},
                     {"color_residual_after_percent", 100 * t.color_residual_after},
                     {"displacement_before_px", t.displacement_before_px},
                     {"displacement_after_px", t.displacement_after_px},
                     {"bent_images", t.bent_images},
                     {"step_before", t.step_before},
                     {"step_before_p95", t.step_before_p95},
                     {"step_after", t.step_after},
                     {"step_after_p95", t.step_after_p95},
                     {"inner_step_before", t.inner_step_before},
                     {"inner_step_before_p95", t.inner_step_before_p95},
                     {"inner_step_after", t.inner_step_after},
                     {"inner_step_after_p95", t.inner_step_after_p95}};
  return json.dump();
}

std::string to_json(const IntegrateReport& report, const Context& context) {
  Json json = report_head("lapseam-report", context);
  for (const auto& [id, sensor] : report.sensors) json["sensors"][id] = of_sensor(sensor);
  json["registration_error_m"] = report.registration_error_m;
  std::vector<std::string> names;
  for (const ViewReport& view : report.views) names.push_back(view.name);
  json["disagreement"] = Json::parse(to_json(report.disagreement, names));
  if (!report.placed_views.empty())
    json["registration"] = Json::parse(to_json(report.registration, report.placed_views, names));
  json["views_left_out"] = report.views_left_out;
  for (const ViewReport& view : report.views) json["views"].push_back(of_view(view));
  json["sew"] = {{"measured_triangles", report.zipper.measured_triangles},
                 {"seam_triangles", report.zipper.seam_triangles},
                 {"open_edges", report.zipper.open_edges},
                 {"outline_vertices_moved", report.outline_vertices_moved},
                 {"self_intersecting_triangles_removed", report.self_intersecting_triangles_removed},
                 {"pinched_vertices_split", report.pinched_vertices_split},
                 {"nonmanifold_triangles_removed", report.nonmanifold_triangles_removed},
                 {"triangles_in_small_components", report.triangles_in_small_components}};
  json["cracks"] = Json::parse(to_json(report.cracks));
  json["fill_holes"] = Json::parse(to_json(report.fill_holes));
  json["triangles_before_reduction"] = report.triangles_before_reduction;
  json["texture"] = Json::parse(to_json(report.texture));
  json["health"] = Json::parse(to_json(report.health));
  if (report.memory.budget_bytes > 0)
    json["memory"] = {{"budget_bytes", report.memory.budget_bytes},
                      {"largest_stored_bytes", report.memory.largest_stored_bytes},
                      {"evictions", report.memory.evictions}};
  json["warnings"] = context.warnings();
  return json.dump(1);
}

}  // namespace lapseam
