#include <fmt/format.h>

#include <cmath>
#include <filesystem>
#include <map>

#include "command.h"
#include "lapseam/error.h"
#include "lapseam/evaluate.h"
#include "lapseam/evaluate_novel.h"
#include "lapseam/io.h"
#include "lapseam/smooth.h"
#include "lapseam/survey.h"
#include "output_check.h"

namespace lapseam::tool {
namespace {

struct EvaluateArguments {
  CommonOptions common;
  std::string result, truth, views, measured, novel, json;
  std::vector<double> at_mm = {1, 2, 5, 10};
  std::size_t samples = EvaluateOptions{}.samples;
  std::size_t rays = EvaluateOptions{}.rays_per_view;
  std::uint64_t seed = 0;
  int only_every = 0;
  bool no_self_intersections = false;
};

// Refused before the work starts, not after it.
void check_json_file(const std::filesystem::path& file) {
  if (!file.empty() && file != "-") check_folder_of(file);
}

void write_json(const std::string& file, const std::string& json) {
  if (file == "-") {
    fmt::print("{}\n", json);
    return;
  }
  write_text(file, json + "\n");
}

EvaluateOptions options_from(const EvaluateArguments& arguments) {
  EvaluateOptions options;
  options.at_m.clear();
  for (const double at_mm : arguments.at_mm) {
    if (!(std::isfinite(at_mm) && at_mm > 0))
      throw CLI::ValidationError("--at", fmt::format("must be positive distances in mm: {}", at_mm));
    options.at_m.push_back(at_mm * 1e-3);
  }
  options.samples = arguments.samples;
  options.rays_per_view = arguments.rays;
  options.seed = arguments.seed;
  options.self_intersections = !arguments.no_self_intersections;
  return options;
}

// Every Nth view from the first, as integrate leaves them out.
Scene only_every(Scene scene, int n) {
  if (n < 2) return scene;
  Scene some = scene;
  some.views.clear();
  for (std::size_t i = 0; i < scene.views.size(); i += std::size_t(n)) some.views.push_back(std::move(scene.views[i]));
  return some;
}

// Noise and registration error are what the views themselves say, where the scene says nothing.
ViewEvaluation evaluate_measured(const Mesh& result, const EvaluateArguments& arguments, const std::string& path,
                                 Context& context) {
  const Scene scene = only_every(read_scene(path, {}, context), arguments.only_every);
  const Survey found = survey(scene, {}, context);
  for (const ViewSurvey& view : found.views)
    if (!view.is_usable()) throw Error(view.problem);
  std::map<std::string, NoiseModel> noise;
  for (const SensorSurvey& sensor : found.sensors) noise[sensor.sensor_id] = sensor.given.value_or(sensor.noise);
  const auto noise_of = [&](std::size_t i) {
    return scene.views[i].noise.value_or(noise.at(found.views[i].sensor_id));
  };
  const MeasuredViews views{scene.views.size(), [&](std::size_t i) { return load_view(scene.views[i]); }, noise_of};
  double remaining = 1;  // of the noise, in the view that was loaded last
  const MeasuredViews smoothed{scene.views.size(),
                               [&](std::size_t i) {
                                 View view = load_view(scene.views[i]);
                                 SmoothResult result_of_view = smooth(view, noise_of(i), {}, context);
                                 view.range = std::move(result_of_view.range);
                                 remaining = result_of_view.remaining_sigma_factor;
                                 return view;
                               },
                               [&](std::size_t i) { return noise_of(i).scaled(remaining); }};
  return evaluate_views(result, views, smoothed,
                        {.rays_per_view = arguments.rays,
                         .boundary = {.registration_error_m = found.registration.median_m},
                         .seed = arguments.seed},
                        context);
}

Evaluation evaluate_health(const Mesh& result, const EvaluateOptions& options, Context& context) {
  Evaluation evaluation;
  evaluation.options = options;
  evaluation.has_truth = false;
  const StageScope stage(context, "evaluate health");
  evaluation.health = check_health(result, {.weld = true, .self_intersections = options.self_intersections}, context);
  return evaluation;
}

Evaluation evaluate_truth(const Mesh& result, const EvaluateArguments& arguments, const EvaluateOptions& options,
                          Context& context) {
  Scene scene;
  TruthViews views;
  if (!arguments.views.empty()) {
    scene = read_scene(arguments.views, {}, context);
    views = {scene.views.size(), [&scene](std::size_t i) { return load_view(scene.views[i]); }};
  }
  return evaluate(result, read_mesh(arguments.truth), views, options, context);
}

// Looks alone: nothing is said about the shape.
void run_novel(const EvaluateArguments& arguments) {
  const std::unique_ptr<Context> context = make_context(arguments.common);
  const Scene scene = only_every(read_scene(arguments.novel, {}, *context), arguments.only_every);
  const NovelEvaluation evaluation = evaluate_novel(read_mesh(arguments.result), scene.views, *context);
  if (arguments.json != "-") fmt::print("{}", to_text(evaluation));
  if (!arguments.json.empty()) write_json(arguments.json, to_json(evaluation));
}

void run(const EvaluateArguments& arguments) {
  const EvaluateOptions options = options_from(arguments);
  const bool has_truth = !arguments.truth.empty();
  if (!arguments.novel.empty()) {
    if (has_truth || !arguments.views.empty() || !arguments.measured.empty())
      throw CLI::ValidationError("--novel", "measures looks alone: leave out TRUTH, --views and --measured");
    check_json_file(arguments.json);
    return run_novel(arguments);
  }
  if (!has_truth && arguments.views.empty() && arguments.measured.empty())
    throw CLI::RequiredError("TRUTH, --views, --measured or --novel");
  if (!has_truth && !arguments.views.empty() && !arguments.measured.empty())
    throw CLI::ValidationError("--measured", "without TRUTH, --views are the measured ones");
  const std::string& measured = has_truth || arguments.views.empty() ? arguments.measured : arguments.views;
  if (measured.empty() && arguments.only_every > 0) throw CLI::ValidationError("--only-every", "needs measured views");
  check_json_file(arguments.json);
  const std::unique_ptr<Context> context = make_context(arguments.common);
  const Mesh result = read_mesh(arguments.result);
  Evaluation evaluation =
      has_truth ? evaluate_truth(result, arguments, options, *context) : evaluate_health(result, options, *context);
  if (!measured.empty()) evaluation.against_views = evaluate_measured(result, arguments, measured, *context);
  if (arguments.json != "-") fmt::print("{}", to_text(evaluation));
  if (!arguments.json.empty()) write_json(arguments.json, to_json(evaluation));
}

}  // namespace

void add_evaluate_command(CLI::App& app) {
  auto arguments = std::make_shared<EvaluateArguments>();
  CLI::App* command =
      app.add_subcommand("evaluate", "Measure a mesh against the true surface, the measured views, or both");
  command->add_option("result", arguments->result, "Mesh to measure: PLY, OBJ or GLB")->required();
  command->add_option("truth", arguments->truth, "True mesh: PLY, OBJ or GLB");
  command->add_option("--views", arguments->views,
                      "Scene with true poses and noiseless range images (truth/scene.json of `simulate`): completeness "
                      "of what was seen, and rays. Without TRUTH: the measured views");
  command->add_option("--measured", arguments->measured,
                      "Scene as it was measured: range against the mesh, double layers, cracks, beside the truth");
  command->add_option("--novel", arguments->novel,
                      "Scene whose colour images are compared with pictures of the result from the same places, and "
                      "colour steps across the cuts of its texture; instead of TRUTH and --views");
  command
      ->add_option("--only-every", arguments->only_every,
                   "Of the measured or novel views, every Nth from the first: those that `integrate --hold-out N` left "
                   "out")
      ->check(CLI::Range(2, 1'000'000));
  command->add_option("--at", arguments->at_mm, "Distances for precision, completeness and F-score, mm")
      ->delimiter(',')
      ->capture_default_str();
  command->add_option("--samples", arguments->samples, "Points spread on each of the two surfaces")
      ->check(CLI::Range(std::size_t(1), std::size_t(100'000'000)))
      ->capture_default_str();
  command->add_option("--rays", arguments->rays, "Rays through each view, at most")
      ->check(CLI::Range(std::size_t(0), std::size_t(1'000'000'000)))
      ->capture_default_str();
  command->add_option("--json", arguments->json,
                      "Write the figures as JSON to this file; - is standard output, "
                      "instead of the table");
  command->add_flag("--no-self-intersections", arguments->no_self_intersections, "Do not look for self-intersections");
  command->add_option("--seed", arguments->seed, "Of the samples and rays")->capture_default_str();
  add_common_options(*command, arguments->common);
  command->callback([arguments] { run(*arguments); });
}

}  // namespace lapseam::tool
