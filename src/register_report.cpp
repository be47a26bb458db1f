// What registration did, for programs and for the eye.

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>

#include "lapseam/context.h"
#include "lapseam/register_scene.h"
#include "report_head.h"

namespace lapseam {
namespace {

using Json = nlohmann::ordered_json;

Json of_vector(const Eigen::Vector3d& v) { return {v.x(), v.y(), v.z()}; }

Json of_residual(const PairResidual& residual) {
  return {{"median_m", residual.median_m}, {"p90_m", residual.p90_m}, {"matches", residual.matches}};
}

Json of_view(const std::string& name, const PlacedView& view) {
  const Eigen::Matrix<double, 6, 1> sigma = view.covariance.diagonal().cwiseMax(0).cwiseSqrt();
  Json out = {{"name", name},
              {"placement", name_of(view.placement)},
              {"moved_m", view.moved_m},
              {"turned_rad", view.turned_rad},
              {"strain", view.strain},
              {"sigma_translation_m", of_vector(sigma.head<3>())},
              {"sigma_rotation_rad", of_vector(sigma.tail<3>())}};
  if (!view.problem.empty()) out["problem"] = view.problem;
  return out;
}

Json of_pair(const std::vector<std::string>& names, const RegisteredPair& pair) {
  Json out = {{"a", names[pair.a]},
              {"b", names[pair.b]},
              {"overlap_percent", 100 * pair.overlap},
              {"before", of_residual(pair.before)},
              {"after", of_residual(pair.after)},
              {"unexplained_m", pair.unexplained_m},
              {"tension", pair.tension}};
  if (!pair.problem.empty()) out["problem"] = pair.problem;
  return out;
}

Json of_sliding(const std::vector<std::string>& names, const Sliding& sliding) {
  Json views = Json::array();
  for (const std::uint32_t view : sliding.views) views.push_back(names[view]);
  return {{"views", views},
          {"translation", of_vector(sliding.translation)},
          {"rotation_times_radius", of_vector(sliding.rotation)},
          {"certainty", sliding.certainty}};
}

// ---- the plot: one cell per ordered pair

constexpr double kLargestPlot_px = 560, kMargin_px = 60, kGap_px = 40, kLegend_px = 60;

// From green over yellow to red.
std::string color_of(double share) {
  const double t = std::clamp(share, 0.0, 1.0);
  const int red = int(std::lround(255 * std::min(1.0, 2 * t))),
            green = int(std::lround(255 * std::min(1.0, 2 - 2 * t)));
  return fmt::format("#{:02x}{:02x}40", red, int(0.8 * green));
}

struct Scale {
  double low_m = 0, high_m = 1;  // logarithmic
  double share(double m) const { return m <= low_m ? 0 : std::log(m / low_m) / std::log(high_m / low_m); }
};

Scale make_scale(const RegisterSceneReport& report) {
  std::vector<double> values;
  for (const Disagreement* table : {&report.disagreement_before, &report.disagreement_after})
    for (const PairSurvey& pair : table->pairs)
      if (pair.compared > 0 && pair.median_absolute_m > 0) values.push_back(pair.median_absolute_m);
  if (values.empty()) return {};
  std::sort(values.begin(), values.end());
  const auto at = [&](double s) { return values[std::size_t(s * double(values.size() - 1))]; };
  return {at(0.02), std::max(at(0.98), 1.01 * at(0.02))};
}

std::string matrix(const Disagreement& table, std::size_t views, const Scale& scale, double left, const char* title) {
  const double cell = kLargestPlot_px / double(std::max<std::size_t>(views, 1));
  std::string out = fmt::format("<text x=\"{:.1f}\" y=\"{:.1f}\">{}</text>\n", left, kMargin_px - 12, title);
  out += fmt::format("<rect x=\"{:.1f}\" y=\"{:.1f}\" width=\"{:.1f}\" height=\"{:.1f}\" fill=\"#f2f2f2\"/>\n", left,
                     kMargin_px, kLargestPlot_px, kLargestPlot_px);
  for (const PairSurvey& pair : table.pairs)
    if (pair.compared > 0)
      out += fmt::format("<rect x=\"{:.2f}\" y=\"{:.2f}\" width=\"{:.2f}\" height=\"{:.2f}\" fill=\"{}\"/>\n",
                         left + cell * pair.b, kMargin_px + cell * pair.a, cell, cell,
                         color_of(scale.share(pair.median_absolute_m)));
  return out;
}

std::string legend(const Scale& scale) {
  std::string out;
  const double y = kMargin_px + kLargestPlot_px + 20;
  constexpr int kSteps = 9;
  for (int k = 0; k < kSteps; ++k) {
    const double share = double(k) / (kSteps - 1), m = scale.low_m * std::pow(scale.high_m / scale.low_m, share);
    const double x = kMargin_px + 90.0 * k;
    out +=
        fmt::format("<rect x=\"{:.1f}\" y=\"{:.1f}\" width=\"18\" height=\"14\" fill=\"{}\"/>", x, y, color_of(share));
    out += fmt::format("<text x=\"{:.1f}\" y=\"{:.1f}\">{:.3g} mm</text>\n", x + 22, y + 12, 1000 * m);
  }
  return out;
}

}  // namespace

std::string to_json(const RegisterSceneReport& report, const Context& context) {
  Json json = report_head("lapseam-registration", context);
  json.update(Json::parse(to_json(report.registration, report.views, report.names)));
  for (const auto& [id, correction] : report.corrections)
    json["corrections"].push_back({{"sensor", id},
                                   {"columns", correction.columns},
                                   {"rows", correction.rows},
                                   {"inverse_range_offset_per_m", correction.offset_per_m}});
  if (!report.unrounded.empty()) json["unrounded_sensors"] = report.unrounded;
  for (std::size_t i = 0; i < report.views.size(); ++i)
    if (!report.views[i].line_offset_rad.empty())
      json["line_corrections"].push_back(
          {{"view", report.names[i]}, {"azimuth_offset_rad", report.views[i].line_offset_rad}});
  json["views_left_out"] = report.views_left_out;
  json["disagreement_before"] = Json::parse(to_json(report.disagreement_before, report.names));
  json["disagreement_after"] = Json::parse(to_json(report.disagreement_after, report.names));
  json["warnings"] = context.warnings();
  return json.dump(1, ' ', false, Json::error_handler_t::replace);
}

std::string to_json(const RegisterReport& report, const std::vector<PlacedView>& views,
                    const std::vector<std::string>& names) {
  Json json;
  json["capture_m"] = report.capture_m;
  json["capture_rad"] = report.capture_rad;
  json["iterations"] = report.iterations;
  json["variance_factor"] = report.variance_factor;
  json["parts"] = report.parts;
  for (std::size_t i = 0; i < views.size(); ++i) json["views"].push_back(of_view(names[i], views[i]));
  json["sliding"] = Json::array();
  for (const Sliding& sliding : report.sliding) json["sliding"].push_back(of_sliding(names, sliding));
  json["pairs"] = Json::array();
  for (const RegisteredPair& pair : report.pairs) json["pairs"].push_back(of_pair(names, pair));
  return json.dump(1, ' ', false, Json::error_handler_t::replace);
}

std::string to_json(const Disagreement& disagreement, const std::vector<std::string>& names) {
  Json json;
  json["distance_m"] = disagreement.distance_m;
  json["registration_error"] = {{"median_m", disagreement.error.median_m},
                                {"p90_m", disagreement.error.p90_m},
                                {"pairs", disagreement.error.pairs}};
  json["pairs"] = Json::array();
  for (const PairSurvey& pair : disagreement.pairs)
    json["pairs"].push_back({{"a", names[pair.a]},
                             {"b", names[pair.b]},
                             {"overlap_percent", 100 * pair.overlap},
                             {"compared", pair.compared},
                             {"median_m", pair.median_m},
                             {"median_absolute_m", pair.median_absolute_m},
                             {"p90_absolute_m", pair.p90_absolute_m}});
  return json.dump(1, ' ', false, Json::error_handler_t::replace);
}

std::string to_svg(const RegisterSceneReport& report) {
  const Scale scale = make_scale(report);
  const double width = 2 * kLargestPlot_px + kGap_px + 2 * kMargin_px,
               height = kLargestPlot_px + kMargin_px + kLegend_px;
  std::string out = fmt::format(
      "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{:.0f}\" height=\"{:.0f}\" font-family=\"sans-serif\" "
      "font-size=\"13\">\n<rect width=\"100%\" height=\"100%\" fill=\"white\"/>\n",
      width, height);
  out += matrix(report.disagreement_before, report.names.size(), scale, kMargin_px,
                "before: median distance of a view (row) from another (column)");
  out += matrix(report.disagreement_after, report.names.size(), scale, kMargin_px + kLargestPlot_px + kGap_px, "after");
  return out + legend(scale) + "</svg>\n";
}

}  // namespace lapseam
