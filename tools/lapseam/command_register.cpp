// lapseam register: refines the poses of a scene and writes it as a new manifest.

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <numbers>

#include "command.h"
#include "lapseam/error.h"
#include "lapseam/io.h"
#include "lapseam/register_scene.h"
#include "pose_lists.h"

namespace lapseam::tool {
namespace {

constexpr double kDegPerRad = 180.0 / std::numbers::pi;

struct RegisterArguments {
  CommonOptions common;
  std::string scene, output, report, plot, truth;
  std::vector<std::string> fixed;
  bool no_color = false, calibrate = false, skip_bad_views = false;
  double capture_mm = 0;
};

struct Outputs {
  std::filesystem::path manifest, report, plot;  // empty: not asked for
};

// A folder gets everything; a manifest's name gets the manifest, and the rest where it is asked for.
Outputs outputs_of(const RegisterArguments& arguments) {
  Outputs out{arguments.output, arguments.report, arguments.plot};
  if (out.manifest.extension() == ".json") return out;
  const std::filesystem::path folder = out.manifest;
  std::error_code failure;
  std::filesystem::create_directories(folder, failure);
  if (failure) throw IoError(folder, "cannot make this folder: " + failure.message());
  out.manifest = folder / "scene.json";
  if (out.report.empty()) out.report = folder / "registration.json";
  if (out.plot.empty()) out.plot = folder / "registration.svg";
  return out;
}

// For range images that are written anew: not where those that were read are.
std::filesystem::path range_folder(const std::filesystem::path& manifest, const Scene& scene) {
  const std::filesystem::path folder = manifest.parent_path() / "range";
  std::error_code ignored;  // what does not exist is nobody's
  for (const ViewSource& view : scene.views)
    if (std::filesystem::equivalent(view.range.file.parent_path(), folder, ignored))
      throw InvalidInput(folder, view.name, "output", "holds the range images that are read; choose another folder");
  return folder;
}

std::vector<std::uint32_t> places_of(const std::vector<std::string>& names, const Scene& scene) {
  std::vector<std::uint32_t> out;
  for (const std::string& name : names) {
    const auto found =
        std::find_if(scene.views.begin(), scene.views.end(), [&](const ViewSource& view) { return view.name == name; });
    if (found == scene.views.end()) throw CLI::ValidationError("--fixed", "there is no view '" + name + "'");
    out.push_back(std::uint32_t(found - scene.views.begin()));
  }
  return out;
}

void print_errors(const char* when, const Scene& scene, const Scene& truth) {
  PosePairs pairs = match_poses(scene, truth);
  const Eigen::Isometry3d T = align_poses(pairs.poses, pairs.truth);
  for (Eigen::Isometry3d& pose : pairs.poses) pose = T * pose;
  const PoseErrors errors = compare_poses(pairs.poses, pairs.truth);
  fmt::print("pose error {}: median {:.3f} mm, {:.4f} deg; 90 % {:.3f} mm, {:.4f} deg\n", when,
             1000 * errors.median_translation_m, kDegPerRad * errors.median_rotation_rad,
             1000 * errors.p90_translation_m, kDegPerRad * errors.p90_rotation_rad);
}

void print_sliding(const RegisterSceneReport& report) {
  for (const Sliding& sliding : report.registration.sliding) {
    const bool is_turn = sliding.rotation.norm() > sliding.translation.norm();
    const Eigen::Vector3d along = (is_turn ? sliding.rotation : sliding.translation).normalized();
    std::string names;
    for (const std::uint32_t view : sliding.views) names += (names.empty() ? "" : ", ") + report.names[view];
    fmt::print("not determined: views {} could {} ({:.2f}, {:.2f}, {:.2f}); not moved along it\n", names,
               is_turn ? "turn about" : "slide along", along.x(), along.y(), along.z());
  }
}

void print_corrections(const RegisterSceneReport& report) {
  for (const std::string& id : report.unrounded)
    fmt::print("sensor {}: ranges are whole steps; smoothed within those\n", id);
  for (const auto& [id, correction] : report.corrections) {
    const auto [low, high] = std::minmax_element(correction.offset_per_m.begin(), correction.offset_per_m.end());
    // At a metre, an offset of inverse range is one of range, turned over.
    fmt::print(
        "sensor {}: ranges are off by {:+.2g} to {:+.2g} mm at 1 m, and with the square of the range; corrected\n", id,
        -1000 * *high, -1000 * *low);
  }
  for (std::size_t i = 0; i < report.views.size(); ++i) {
    const std::vector<double>& lines = report.views[i].line_offset_rad;
    if (lines.empty()) continue;
    const auto [low, high] = std::minmax_element(lines.begin(), lines.end());
    fmt::print("view {}: lines are off by {:+.2g} to {:+.2g} deg; corrected\n", report.names[i], -kDegPerRad * *high,
               -kDegPerRad * *low);
  }
}

void print_summary(const RegisterSceneReport& report) {
  std::array<std::size_t, 4> count{};
  double most_moved_m = 0, most_turned_rad = 0;
  for (const PlacedView& view : report.views) {
    ++count[std::size_t(view.placement)];
    most_moved_m = std::max(most_moved_m, view.moved_m);
    most_turned_rad = std::max(most_turned_rad, view.turned_rad);
  }
  const auto dropped = std::count_if(report.registration.pairs.begin(), report.registration.pairs.end(),
                                     [](const RegisteredPair& pair) { return !pair.problem.empty(); });
  fmt::print("{} views: {} placed, {} fixed, {} without partner, {} refused; moved by up to {:.3g} mm, {:.3g} deg\n",
             report.views.size(), count[1], count[0], count[2], count[3], 1000 * most_moved_m,
             kDegPerRad * most_turned_rad);
  fmt::print("{} pairs, {} left out; capture range {:.3g} mm, {:.3g} deg\n", report.registration.pairs.size(), dropped,
             1000 * report.registration.capture_m, kDegPerRad * report.registration.capture_rad);
  fmt::print("median distance between two views: {:.3g} mm before, {:.3g} mm after\n",
             1000 * report.disagreement_before.distance_m, 1000 * report.disagreement_after.distance_m);
  fmt::print("beyond the noise: {:.3g} mm before, {:.3g} mm after\n", 1000 * report.disagreement_before.error.median_m,
             1000 * report.disagreement_after.error.median_m);
}

void run(const RegisterArguments& arguments) {
  const std::unique_ptr<Context> context = make_context(arguments.common);
  const Scene scene = read_scene(arguments.scene, {.skip_bad_views = arguments.skip_bad_views}, *context);
  std::optional<Scene> truth;
  if (!arguments.truth.empty()) truth = read_scene(arguments.truth, {}, *context);
  RegisterSceneOptions options;
  options.skip_bad_views = arguments.skip_bad_views;
  options.registration.fixed = places_of(arguments.fixed, scene);
  options.registration.use_color = !arguments.no_color;
  options.registration.capture_m = arguments.capture_mm / 1000;
  options.registration.calibrate = arguments.calibrate;
  const Outputs outputs = outputs_of(arguments);
  if (arguments.calibrate) options.corrected_ranges = range_folder(outputs.manifest, scene);
  const RegisterSceneResult result = register_scene(scene, options, *context);
  write_scene(result.scene, outputs.manifest);
  if (!outputs.report.empty()) write_text(outputs.report, to_json(result.report, *context) + "\n");
  if (!outputs.plot.empty()) write_text(outputs.plot, to_svg(result.report));
  print_summary(result.report);
  print_corrections(result.report);
  print_sliding(result.report);
  if (!truth) return;
  print_errors("before", scene, *truth);
  print_errors("after", result.scene, *truth);
}

}  // namespace

void add_register_command(CLI::App& app) {
  auto arguments = std::make_shared<RegisterArguments>();
  CLI::App* command = app.add_subcommand("register", "Refine the poses of a scene, all at once, and write it anew");
  command->add_option("scene", arguments->scene, "scene.json, a Stanford .conf, or a folder that is recognised")
      ->required();
  command
      ->add_option("-o,--output", arguments->output,
                   "A folder, for scene.json, registration.json (report) and registration.svg (plot); or a .json file "
                   "for the manifest alone")
      ->required();
  command->add_option("--report", arguments->report,
                      "Write residuals, covariances and the disagreement of each pair, before and after, as JSON");
  command->add_option("--plot", arguments->plot, "Write the disagreement of all pairs, before and after, as SVG");
  command->add_option("--fixed", arguments->fixed, "Names of views that stay; the first, when none is given")
      ->delimiter(',');
  command->add_flag("--no-color", arguments->no_color, "Geometry alone, where views have pictures");
  command->add_flag(
      "--calibrate", arguments->calibrate,
      "Also find what each depth camera measures too far or too near, by place in its image, and at which "
      "angles the lines of a scanner really are; write range images without it, and without steps where ranges are "
      "whole disparities");
  command
      ->add_option("--capture", arguments->capture_mm,
                   "How far apart points of one surface may be at first, millimetres; a tenth of what a view sees by "
                   "default")
      ->check(CLI::PositiveNumber);
  command->add_option("--truth", arguments->truth,
                      "A scene with true poses: print how far off the poses are before and after");
  command->add_flag("--skip-bad-views", arguments->skip_bad_views, "Unusable views keep their poses, with a warning");
  add_common_options(*command, arguments->common);
  command->callback([arguments] { run(*arguments); });
}

}  // namespace lapseam::tool
