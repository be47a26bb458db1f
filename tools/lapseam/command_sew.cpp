#include <fmt/format.h>

#include <cmath>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "command.h"
#include "lapseam/error.h"
#include "lapseam/fill_holes.h"
#include "lapseam/health.h"
#include "lapseam/io.h"
#include "lapseam/sew_meshes.h"
#include "lapseam/version.h"
#include "output_check.h"

namespace lapseam::tool {
namespace {

struct SewArguments {
  CommonOptions common;
  std::vector<std::string> inputs;
  std::string output, report;
  double overlap_distance_m = 0, fill_holes_m = 0;
};

/// An error about "mesh 2" means more with the name of its file.
std::vector<Mesh> read_inputs(const std::vector<std::string>& files, Context& context) {
  StageScope stage(context, "read", files.size());
  std::vector<Mesh> meshes;
  for (const std::string& file : files) {
    meshes.push_back(read_mesh(file));
    if (meshes.back().triangles.empty()) throw InvalidInput(file, {}, "triangles", "there are none");
    stage.advance();
  }
  return meshes;
}

void write_report(const SewArguments& arguments, const SewMeshesReport& sewn, const FillHolesReport& filled,
                  const MeshHealth& health, const Context& context) {
  nlohmann::ordered_json json = {{"format", "lapseam-sew-report"}, {"version", 1}, {"lapseam", kVersion}};
  json["threads"] = context.threads();
  for (const StageRecord& stage : context.stages())
    json["stages"].push_back(
        {{"name", stage.name}, {"seconds", stage.seconds}, {"peak_rss_bytes", stage.peak_rss_bytes}});
  json["inputs"] = arguments.inputs;
  json["sew"] = nlohmann::ordered_json::parse(to_json(sewn));
  if (arguments.fill_holes_m > 0) json["fill_holes"] = nlohmann::ordered_json::parse(to_json(filled));
  json["health"] = nlohmann::ordered_json::parse(to_json(health));
  json["warnings"] = context.warnings();
  write_text(arguments.report, json.dump(2) + "\n");
}

void run(const SewArguments& arguments) {
  check_mesh_output(arguments.output);
  const std::unique_ptr<Context> context = make_context(arguments.common);
  SewMeshesReport sewn;
  FillHolesReport filled;
  Mesh mesh;
  {
    const std::vector<Mesh> inputs = read_inputs(arguments.inputs, *context);
    mesh = sew_meshes(inputs, {.overlap_distance_m = arguments.overlap_distance_m}, sewn, *context);
  }
  if (arguments.fill_holes_m > 0) filled = fill_holes(mesh, {.largest_m = arguments.fill_holes_m}, *context);
  {
    StageScope stage(*context, "write");
    write_mesh(mesh, arguments.output);
  }
  const MeshHealth health = check_health(mesh, {.self_intersections = !arguments.report.empty()}, *context);
  if (!arguments.report.empty()) write_report(arguments, sewn, filled, health, *context);
  fmt::print("{}: {} vertices, {} triangles from {} meshes, {} of them seam; {} components, {} boundary edges",
             arguments.output, mesh.vertex_count(), mesh.triangle_count(), arguments.inputs.size(), sewn.seam_triangles,
             health.components, health.boundary_edges);
  if (arguments.fill_holes_m > 0) fmt::print("; {} of {} holes filled", filled.holes_filled, filled.holes_in_size);
  fmt::print("\n");
}

}  // namespace

void add_sew_command(CLI::App& app) {
  auto arguments = std::make_shared<SewArguments>();
  CLI::App* command = app.add_subcommand("sew", "Join overlapping registered meshes into one, without range images");
  command
      ->add_option("meshes", arguments->inputs,
                   "Two or more meshes in one coordinate system, metres: PLY, OBJ or GLB; where they are equally good, "
                   "earlier ones stay")
      ->required();
  command->add_option("-o,--output", arguments->output, "Result: .ply (with provenance), .glb or .obj")->required();
  command
      ->add_option("--overlap-distance", arguments->overlap_distance_m,
                   "Surfaces that face alike and lie no farther apart are one, metres; 0: derived from the meshes")
      ->check(CLI::Range(0.0, 1e6))
      ->capture_default_str();
  command
      ->add_option("--fill-holes", arguments->fill_holes_m,
                   "Close holes that are at most this wide, metres; their triangles are tagged as filled")
      ->check(CLI::Range(0.0, 1e6));
  command->add_option("--report", arguments->report,
                      "Write a report of stages, thresholds, counts and mesh health, as JSON");
  add_common_options(*command, arguments->common);
  command->callback([arguments] { run(*arguments); });
}

}  // namespace lapseam::tool
