#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "command.h"
#include "lapseam/error.h"
#include "lapseam/io.h"
#include "lapseam/survey.h"
#include "output_check.h"
#include "texture_arguments.h"

namespace lapseam::tool {
namespace {

struct Arguments {
  CommonOptions common;
  TextureArguments texture;
  std::string mesh, scene, output, report;
  int hold_out = 0;
};

void write_report(const std::string& file, const TextureReport& report, const Context& context) {
  nlohmann::ordered_json json;
  for (const StageRecord& stage : context.stages())
    json["stages"].push_back(
        {{"name", stage.name}, {"seconds", stage.seconds}, {"peak_rss_bytes", stage.peak_rss_bytes}});
  json["texture"] = nlohmann::ordered_json::parse(to_json(report));
  write_text(file, json.dump(1) + "\n");
}

/// Provenance counts views as the scene does; views beyond it belong to another scene.
void check_provenance(const Mesh& mesh, const Scene& scene, const std::string& file) {
  for (const std::uint32_t view : mesh.triangle_view)
    if (view != kInvalidIndex && view >= scene.views.size())
      throw InvalidInput(file, {}, "view",
                         fmt::format("a triangle is of view {}, the scene has {}", view, scene.views.size()));
}

void run(const Arguments& arguments) {
  check_mesh_output(arguments.output, MeshOutput::kTextured);
  check_texture_output(arguments.texture, arguments.output);
  const std::unique_ptr<Context> context = make_context(arguments.common);
  Scene scene = read_scene(arguments.scene, {}, *context);
  Mesh mesh = read_mesh(arguments.mesh);
  check_provenance(mesh, scene, arguments.mesh);
  drop_texture(mesh);
  if (arguments.hold_out > 0)
    for (std::size_t i = 0; i < scene.views.size(); i += std::size_t(arguments.hold_out)) scene.views[i].color.reset();
  if (std::none_of(scene.views.begin(), scene.views.end(), [](const ViewSource& view) { return view.color; }))
    throw InvalidInput(scene.file, {}, "color", "no view has a colour image");
  TextureOptions options = texture_options(arguments.texture);
  options.registration_error_m = survey(scene, {}, *context).registration.median_m;
  const TextureReport report = texture(mesh, scene.views, options, *context);
  if (std::filesystem::path(arguments.output).extension() == ".ply") color_vertices(mesh, *context);
  {
    StageScope stage(*context, "write");
    write_mesh(mesh, arguments.output, arguments.texture.writing);
  }
  if (!arguments.report.empty()) write_report(arguments.report, report, *context);
  fmt::print("{}: {} triangles, {} charts on {} pages, {:.1f} % filled; {} triangles unseen\n", arguments.output,
             mesh.triangle_count(), report.charts, report.pages, 100 * report.fill(), report.unseen_triangles);
}

}  // namespace

void add_texture_command(CLI::App& app) {
  auto arguments = std::make_shared<Arguments>();
  CLI::App* command = app.add_subcommand("texture", "Colour a mesh from the images of a scene");
  command->add_option("mesh", arguments->mesh, "Mesh in the scene's frame, best a .ply that integrate has made")
      ->required();
  command->add_option("scene", arguments->scene, "scene.json, or a folder that is recognised, with colour images")
      ->required();
  command->add_option("-o,--output", arguments->output, "Result: .ply (vertex colours), .glb or .obj (texture)")
      ->required();
  command->add_option("--report", arguments->report, "Write a report of stages and the texture, as JSON");
  command->add_option("--hold-out", arguments->hold_out, "Leave out every Nth view, from the first, for measuring")
      ->check(CLI::Range(2, 1'000'000));
  add_texture_options(*command, arguments->texture);
  add_common_options(*command, arguments->common);
  command->callback([arguments] { run(*arguments); });
}

}  // namespace lapseam::tool
