// lapseam tiles: a mesh as a tree of small GLB files, for viewers that load what is looked at.

#include <fmt/format.h>

#include "command.h"
#include "lapseam/io.h"
#include "lapseam/tileset.h"

namespace lapseam::tool {
namespace {

struct TilesArguments {
  CommonOptions common;
  std::string mesh, output;
  TilesetOptions options;
};

void run(const TilesArguments& arguments) {
  const std::unique_ptr<Context> context = make_context(arguments.common);
  const Mesh mesh = read_mesh(arguments.mesh);
  const TilesetReport report = write_tileset(mesh, arguments.output, arguments.options, *context);
  fmt::print("{}/tileset.json: {} tiles in {} levels, {} triangles; coarsest within {:.3g} m\n", arguments.output,
             report.tiles, report.levels, mesh.triangle_count(), report.root_error_m);
}

}  // namespace

void add_tiles_command(CLI::App& app) {
  auto arguments = std::make_shared<TilesArguments>();
  CLI::App* command = app.add_subcommand("tiles", "Write a mesh as a 3D Tiles tileset: GLB files, coarse to fine");
  command->add_option("mesh", arguments->mesh, "PLY, OBJ or GLB; vertices get the colours of a texture")->required();
  command->add_option("-o,--output", arguments->output, "A folder: tileset.json and tiles/*.glb")->required();
  command->add_option("--max-triangles", arguments->options.max_triangles, "Largest number of triangles in a tile")
      ->check(CLI::Range(std::uint64_t(1000), std::uint64_t(10'000'000)))
      ->capture_default_str();
  add_common_options(*command, arguments->common);
  command->callback([arguments] { run(*arguments); });
}

}  // namespace lapseam::tool
