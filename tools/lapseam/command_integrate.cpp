#include <fmt/format.h>

#include <filesystem>
#include <optional>

#include "command.h"
#include "lapseam/error.h"
#include "lapseam/integrate.h"
#include "lapseam/io.h"
#include "noise_plot.h"
#include "output_check.h"
#include "texture_arguments.h"

namespace lapseam::tool {
namespace {

struct IntegrateArguments {
  CommonOptions common;
  TextureArguments texture;
  std::string scene, output, report;
  bool no_texture = false, skip_bad_views = false, registers = false;
  int hold_out = 0;
  double fill_holes_m = 0, max_error_mm = 0, reduce_sigma = IntegrateOptions{}.reduce_sigma;
  std::uint64_t triangles = 0;
  std::optional<std::uint64_t> memory_bytes;
  std::string temporary;
};

// The picture of the noise lies beside the report: report.json, report-noise.svg.
void write_report(const std::filesystem::path& file, const IntegrateReport& report, const Context& context) {
  write_text(file, to_json(report, context) + "\n");
  std::vector<SensorSurvey> sensors;
  for (const auto& [id, sensor] : report.sensors) {
    SensorSurvey shown{id, sensor.views, sensor.measured.model, sensor.measured.bins, {}};
    if (sensor.is_noise_given) shown.given = sensor.noise;
    sensors.push_back(std::move(shown));
  }
  std::filesystem::path picture = file;
  picture.replace_filename(file.stem().string() + "-noise.svg");
  write_text(picture, plot_noise(sensors));
}

// False where there is no place for a file of all images.
bool set_usual_budget(const std::string& temporary, const MemoryEstimate& needed, Context& context) {
  std::error_code problem;
  const std::filesystem::path folder =
      temporary.empty() ? std::filesystem::temp_directory_path(problem) : std::filesystem::path(temporary);
  if (problem) return false;
  const std::filesystem::space_info space = std::filesystem::space(folder, problem);
  if (problem || space.available < needed.all_bytes) return false;
  try {
    context.set_memory_budget({needed.usual_bytes, folder});
    return true;
  } catch (const IoError&) {
    return false;
  }
}

// What is asked for, or what such scenes usually get.
void set_memory_budget(const IntegrateArguments& arguments, const MemoryEstimate& needed, Context& context) {
  std::uint64_t budget = arguments.memory_bytes.value_or(needed.usual_bytes);
  if (arguments.memory_bytes) {
    if (budget > 0) context.set_memory_budget({budget, arguments.temporary});
  } else if (budget > 0 && !set_usual_budget(arguments.temporary, needed, context)) {
    context.warn("all images stay in memory: there is no room for them in the folder for temporary files (--tmp)");
    budget = 0;
  }
  if (arguments.common.progress == "none" || arguments.common.progress == "json") return;
  const auto mb = [](std::uint64_t bytes) { return bytes / 1'000'000; };
  fmt::print(stderr, "memory: about {} MB with all images in memory, {} MB at least; ", mb(needed.all_bytes),
             mb(needed.least_bytes));
  if (budget > 0)
    fmt::print(stderr, "kept under {} MB\n", mb(budget));
  else
    fmt::print(stderr, "no limit\n");
}

void run(const IntegrateArguments& arguments) {
  check_mesh_output(arguments.output);
  check_texture_output(arguments.texture, arguments.output);
  const std::unique_ptr<Context> context = make_context(arguments.common);
  const Scene scene = read_scene(arguments.scene, {.skip_bad_views = arguments.skip_bad_views}, *context);

  IntegrateOptions options;
  options.hold_out = arguments.hold_out;
  if (arguments.registers) options.registration.emplace();
  options.skip_bad_views = arguments.skip_bad_views;
  options.fill_holes.largest_m = arguments.fill_holes_m;
  options.reduce.max_error_m = arguments.max_error_mm / 1000;
  options.reduce.max_triangles = arguments.triangles;
  options.reduce_sigma = arguments.reduce_sigma;
  options.texture = texture_options(arguments.texture);
  options.check_self_intersections = !arguments.report.empty();
  const bool is_ply = std::filesystem::path(arguments.output).extension() == ".ply";
  const bool is_bare = arguments.no_texture || std::filesystem::path(arguments.output).extension() == ".stl";
  options.color = is_bare ? ColorOutput::kNone : is_ply ? ColorOutput::kVertices : ColorOutput::kAtlas;

  set_memory_budget(arguments, estimate_memory(scene, options, context->threads()), *context);

  const IntegrateResult result = integrate(scene, options, *context);
  {
    StageScope stage(*context, "write");
    write_mesh(result.mesh, arguments.output, arguments.texture.writing);
  }
  if (!arguments.report.empty()) write_report(arguments.report, result.report, *context);
  const MeshHealth& health = result.report.health;
  fmt::print("{}: {} vertices, {} triangles from {} views; {} components, {} boundary edges, {} non-manifold edges\n",
             arguments.output, result.mesh.vertex_count(), result.mesh.triangle_count(), result.report.views.size(),
             health.components, health.boundary_edges, health.nonmanifold_edges);
}

}  // namespace

void add_integrate_command(CLI::App& app) {
  auto arguments = std::make_shared<IntegrateArguments>();
  CLI::App* command = app.add_subcommand("integrate", "Integrate the views of a scene into one textured mesh");
  command->add_option("scene", arguments->scene, "scene.json, a Stanford .conf, or a folder that is recognised")
      ->required();
  command
      ->add_option("-o,--output", arguments->output,
                   "Result: .ply (vertex colours), .glb or .obj (texture), .stl (triangles alone)")
      ->required();
  command->add_option(
      "--report", arguments->report,
      "Write a report of stages, thresholds and mesh health, as JSON, and the noise as a picture beside it: "
      "NAME.json, NAME-noise.svg");
  command->add_flag("--register", arguments->registers, "Refine the poses first, all at once");
  command->add_flag("--no-texture", arguments->no_texture, "Geometry only");
  command->add_option("--hold-out", arguments->hold_out, "Leave out every Nth view, from the first, for measuring")
      ->check(CLI::Range(2, 1'000'000));
  command
      ->add_option("--fill-holes", arguments->fill_holes_m,
                   "Close holes up to this many metres across; their triangles are tagged as filled")
      ->check(CLI::PositiveNumber);
  command
      ->add_option("--max-error", arguments->max_error_mm, "Reduce the result: largest error of a vertex, millimetres")
      ->check(CLI::PositiveNumber);
  command
      ->add_option("--reduce-sigma", arguments->reduce_sigma,
                   "Leave out vertices that are off the surface by less than so many standard deviations of a "
                   "measurement; 0 keeps all")
      ->check(CLI::NonNegativeNumber)
      ->capture_default_str();
  command->add_option("--triangles", arguments->triangles, "Reduce the result to at most this many triangles")
      ->check(CLI::PositiveNumber);
  command
      ->add_option(
          "--memory", arguments->memory_bytes,
          "Most that the process may take, as 600M or 2G: images then live in a temporary file. 0: no limit. "
          "Default, for scenes that would take over 200M: a fifth less than that, at most 400M or one and a half "
          "times the least that will do")
      ->transform(CLI::AsSizeValue(true));
  command->add_option("--tmp", arguments->temporary, "Folder of that file (default: the system's)")
      ->check(CLI::ExistingDirectory);
  add_texture_options(*command, arguments->texture);
  command->add_flag("--skip-bad-views", arguments->skip_bad_views, "Leave out unusable views with a warning");
  add_common_options(*command, arguments->common);
  command->callback([arguments] { run(*arguments); });
}

}  // namespace lapseam::tool
