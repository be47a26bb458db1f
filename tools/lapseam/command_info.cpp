#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "command.h"
#include "io/noise_json.h"
#include "lapseam/error.h"
#include "lapseam/io.h"
#include "lapseam/survey.h"
#include "noise_plot.h"

namespace lapseam::tool {
namespace {

struct InfoArguments {
  CommonOptions common;
  std::string scene, plot;
  bool json = false, pairs = false;
};

// Two views that share less than this of their samples hardly help each other.
constexpr double kNotableOverlap = 0.05;

nlohmann::ordered_json view_to_json(const ViewSurvey& view) {
  nlohmann::ordered_json out = {{"name", view.name}, {"sensor_id", view.sensor_id}, {"usable", view.is_usable()}};
  if (!view.is_usable()) {
    out["problem"] = view.problem;
    return out;
  }
  out["sensor"] = view.sensor_kind;
  out["width"] = view.width;
  out["height"] = view.height;
  out["samples"] = view.samples;
  out["valid_percent"] = 100 * view.valid_share;
  const MissingSamples& m = view.missing;
  out["missing"] = {{"zero", m.zero},       {"negative", m.negative}, {"not_finite", m.not_finite}, {"named", m.named},
                    {"flagged", m.flagged}, {"absent", m.absent},     {"surplus", m.surplus}};
  out["range_min_m"] = view.range_min_m;
  out["range_median_m"] = view.range_median_m;
  out["range_max_m"] = view.range_max_m;
  out["spacing_m"] = view.spacing_m;
  return out;
}

nlohmann::ordered_json to_json(const Scene& scene, const Survey& found, const Context& context) {
  nlohmann::ordered_json out = {{"scene", scene.name}, {"file", scene.file.string()}};
  out["views"] = nlohmann::ordered_json::array();
  for (const ViewSurvey& view : found.views) out["views"].push_back(view_to_json(view));
  out["sensors"] = nlohmann::ordered_json::array();
  for (const SensorSurvey& sensor : found.sensors) {
    nlohmann::ordered_json entry = {
        {"id", sensor.sensor_id}, {"views", sensor.views}, {"estimated_noise", noise_to_json(sensor.noise)}};
    if (sensor.given) entry["given_noise"] = noise_to_json(*sensor.given);
    entry["noise_by_range"] = nlohmann::ordered_json::array();
    for (const NoiseBin& bin : sensor.bins)
      entry["noise_by_range"].push_back({{"range_m", bin.range_m}, {"sigma_m", bin.sigma_m}, {"samples", bin.samples}});
    out["sensors"].push_back(std::move(entry));
  }
  out["pairs"] = nlohmann::ordered_json::array();
  for (const PairSurvey& pair : found.pairs)
    out["pairs"].push_back({{"a", found.views[pair.a].name},
                            {"b", found.views[pair.b].name},
                            {"overlap_percent", 100 * pair.overlap},
                            {"compared", pair.compared},
                            {"median_m", pair.median_m},
                            {"median_absolute_m", pair.median_absolute_m},
                            {"p90_absolute_m", pair.p90_absolute_m}});
  out["distance_m"] = found.distance_m;
  out["registration_error"] = {{"median_m", found.registration.median_m},
                               {"p90_m", found.registration.p90_m},
                               {"pairs", found.registration.pairs}};
  out["warnings"] = context.warnings();
  return out;
}

// Rows of cells, columns as wide as they need; the first column to the left, the others to the right.
class Table {
 public:
  explicit Table(std::vector<std::string> header) { rows_.push_back(std::move(header)); }
  void add(std::vector<std::string> row) { rows_.push_back(std::move(row)); }
  std::size_t size() const { return rows_.size() - 1; }

  std::string text() const {
    std::vector<std::size_t> widths(rows_.front().size(), 0);
    for (const auto& row : rows_)
      for (std::size_t k = 0; k < row.size(); ++k) widths[k] = std::max(widths[k], row[k].size());
    std::string out;
    for (const auto& row : rows_) {
      std::string line = fmt::format("{:<{}}", row[0], widths[0]);
      for (std::size_t k = 1; k < row.size(); ++k) line += fmt::format("  {:>{}}", row[k], widths[k]);
      out += line + '\n';
    }
    return out;
  }

 private:
  std::vector<std::vector<std::string>> rows_;
};

std::string metres(double m) { return fmt::format("{:.3f}", m); }
std::string millimetres(double m) { return fmt::format("{:.3g}", 1000 * m); }
std::string percent(double share) { return fmt::format("{:.1f}", 100 * share); }

std::string views_text(const Survey& found) {
  std::vector<std::size_t> partners(found.views.size(), 0);
  std::vector<const PairSurvey*> best(found.views.size(), nullptr);
  for (const PairSurvey& pair : found.pairs) {
    if (pair.overlap >= kNotableOverlap) ++partners[pair.a];
    if (!best[pair.a] || pair.overlap > best[pair.a]->overlap) best[pair.a] = &pair;
  }
  Table table({"view", "sensor", "size", "samples", "valid %", "range m: min", "median", "max", "spacing mm",
               "overlaps", "most %", "with"});
  for (std::size_t i = 0; i < found.views.size(); ++i) {
    const ViewSurvey& view = found.views[i];
    if (!view.is_usable()) continue;
    table.add({view.name, view.sensor_kind, fmt::format("{}x{}", view.width, view.height),
               fmt::format("{}", view.samples), percent(view.valid_share), metres(view.range_min_m),
               metres(view.range_median_m), metres(view.range_max_m), millimetres(view.spacing_m),
               fmt::format("{}", partners[i]), best[i] ? percent(best[i]->overlap) : "-",
               best[i] ? found.views[best[i]->b].name : "-"});
  }
  return table.size() > 0 ? table.text() : "";
}

/// What stands for "no sample" in the files, and how often; only the kinds that there are.
std::string missing_text(const Survey& found) {
  MissingSamples sum;
  for (const ViewSurvey& view : found.views) {
    sum.zero += view.missing.zero;
    sum.negative += view.missing.negative;
    sum.not_finite += view.missing.not_finite;
    sum.named += view.missing.named;
    sum.flagged += view.missing.flagged;
    sum.absent += view.missing.absent;
    sum.surplus += view.missing.surplus;
  }
  std::string out;
  const auto add = [&](std::uint64_t count, const char* what) {
    if (count > 0) out += fmt::format("{}{} {}", out.empty() ? "" : ", ", count, what);
  };
  add(sum.zero, "zero");
  add(sum.negative, "negative");
  add(sum.not_finite, "not finite");
  add(sum.named, "named invalid");
  add(sum.flagged, "flagged invalid by the file");
  add(sum.absent, "without a record");
  if (sum.surplus > 0)
    out += fmt::format("{}{} points beyond the first of their pixel", out.empty() ? "" : "; ", sum.surplus);
  return out.empty() ? out : "pixels without a sample: " + out + "\n";
}

std::string problems_text(const Survey& found) {
  std::string out;
  for (const ViewSurvey& view : found.views)
    if (!view.is_usable()) out += fmt::format("  {}: {}\n", view.name, view.problem);
  return out.empty() ? out : "unusable\n" + out;
}

// What else the noise depends on, where it does.
std::string conditions_text(const Survey& found) {
  std::string out;
  for (const SensorSurvey& sensor : found.sensors) {
    const NoiseModel& noise = sensor.given ? *sensor.given : sensor.noise;
    if (noise.pointing_rad > 0)
      out += fmt::format("{}: rays are {:.3g} mrad off, which adds range x tan(incidence) of it to the noise\n",
                         sensor.sensor_id, 1000 * noise.pointing_rad);
    if (noise.intensity_power > 0)
      out += fmt::format("{}: noise falls with intensity to the power of {:.2f}, and is as above at {:.0f} of 255\n",
                         sensor.sensor_id, noise.intensity_power, noise.intensity_reference);
  }
  return out;
}

std::string sensors_text(const Survey& found) {
  Table table({"sensor id", "views", "noise mm at nearest", "median", "farthest range", "floor", "noise is"});
  for (const SensorSurvey& sensor : found.sensors) {
    std::vector<double> medians;
    double nearest = 1e300, farthest = 0;
    for (const ViewSurvey& view : found.views) {
      if (!view.is_usable() || view.sensor_id != sensor.sensor_id) continue;
      medians.push_back(view.range_median_m);
      nearest = std::min(nearest, view.range_min_m);
      farthest = std::max(farthest, view.range_max_m);
    }
    std::sort(medians.begin(), medians.end());
    const auto add = [&](const NoiseModel& noise, const char* origin) {
      table.add({sensor.sensor_id, fmt::format("{}", sensor.views), millimetres(noise.sigma(nearest)),
                 millimetres(noise.sigma(medians[medians.size() / 2])), millimetres(noise.sigma(farthest)),
                 millimetres(noise.floor_m), origin});
    };
    add(sensor.noise, "estimated");
    if (sensor.given) add(*sensor.given, "given");
  }
  return table.size() > 0 ? table.text() + conditions_text(found) : "";
}

std::string pairs_text(const Survey& found) {
  Table table({"view", "in view", "overlap %", "compared", "off mm: median", "median |.|", "90 % |.|"});
  for (const PairSurvey& pair : found.pairs)
    table.add({found.views[pair.a].name, found.views[pair.b].name, percent(pair.overlap),
               fmt::format("{}", pair.compared), millimetres(pair.median_m), millimetres(pair.median_absolute_m),
               millimetres(pair.p90_absolute_m)});
  return table.size() > 0 ? table.text() : "no view overlaps another\n";
}

std::string registration_text(const Survey& found) {
  if (found.registration.pairs == 0) return "registration: no two views overlap enough to tell\n";
  return fmt::format("registration: beyond their noise, {} pairs of views disagree by {} mm (median), {} mm (90 %)\n",
                     found.registration.pairs, millimetres(found.registration.median_m),
                     millimetres(found.registration.p90_m));
}

void run(const InfoArguments& arguments) {
  const std::unique_ptr<Context> context = make_context(arguments.common);
  const Scene scene = read_scene(arguments.scene, {.skip_bad_views = true}, *context);
  const Survey found = survey(scene, {}, *context);
  if (!arguments.plot.empty()) write_text(arguments.plot, plot_noise(found.sensors));
  if (arguments.json) {
    fmt::print("{}\n", to_json(scene, found, *context).dump(2, ' ', false, nlohmann::json::error_handler_t::replace));
  } else {
    fmt::print("{}: {} views, {} usable\n", scene.file.string(), found.views.size(), found.usable_views());
    for (const std::string& part : {problems_text(found), views_text(found), missing_text(found), sensors_text(found),
                                    arguments.pairs ? pairs_text(found) : ""})
      if (!part.empty()) fmt::print("\n{}", part);
    fmt::print("\n{}", registration_text(found));
  }
  if (found.usable_views() == 0) throw InvalidInput(scene.file, {}, "views", "no view can be used");
}

}  // namespace

void add_info_command(CLI::App& app) {
  auto arguments = std::make_shared<InfoArguments>();
  CLI::App* command = app.add_subcommand(
      "info", "Say what a scene holds: views, sensors, ranges, noise, overlap, and why a view is unusable");
  command->add_option("PATH", arguments->scene, "A manifest, a .conf, or a folder that is recognised")->required();
  command->add_flag("--json", arguments->json, "Everything as one JSON object, pairs of views included");
  command->add_flag("--pairs", arguments->pairs, "A line for each pair of views that overlap");
  command->add_option("--plot", arguments->plot, "Write the noise over range, measured and fitted, as an SVG picture");
  add_common_options(*command, arguments->common);
  command->callback([arguments] { run(*arguments); });
}

}  // namespace lapseam::tool
