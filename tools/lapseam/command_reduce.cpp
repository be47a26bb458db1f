#include <fmt/format.h>

#include <cmath>
#include <filesystem>

#include "command.h"
#include "lapseam/error.h"
#include "lapseam/io.h"
#include "lapseam/reduce.h"
#include "output_check.h"

namespace lapseam::tool {
namespace {

struct ReduceArguments {
  CommonOptions common;
  std::string input, output;
  std::uint64_t triangles = 0;
  double ratio = 0, max_error_mm = 0;
  bool keeps_vertices = false;
};

// Refused before the work starts, not after it.
void check(const ReduceArguments& arguments) {
  check_mesh_output(arguments.output);
  if (!(std::isfinite(arguments.ratio) && arguments.ratio >= 0 && arguments.ratio <= 1))
    throw CLI::ValidationError("--ratio", fmt::format("must be between 0 and 1: {}", arguments.ratio));
  if (!(std::isfinite(arguments.max_error_mm) && arguments.max_error_mm >= 0))
    throw CLI::ValidationError("--max-error", fmt::format("must be a length in mm: {}", arguments.max_error_mm));
}

void run(const ReduceArguments& arguments) {
  check(arguments);
  const std::unique_ptr<Context> context = make_context(arguments.common);
  const Mesh mesh = read_mesh(arguments.input);
  ReduceOptions options;
  options.max_error_m = 1e-3 * arguments.max_error_mm;
  options.max_triangles = arguments.triangles;
  if (arguments.ratio > 0)
    options.max_triangles = std::max<std::uint64_t>(1, std::uint64_t(arguments.ratio * double(mesh.triangle_count())));
  if (arguments.keeps_vertices) options.placement = Placement::kEndpoint;
  const ReduceResult result = reduce(mesh, {}, options, *context);
  {
    StageScope stage(*context, "write");
    write_mesh(result.mesh, arguments.output);
  }
  fmt::print("{}: {} triangles of {}", arguments.output, result.mesh.triangle_count(), mesh.triangle_count());
  if (result.report.max_error_m > 0) fmt::print("; error up to {:.3g} mm", 1e3 * result.report.max_error_m);
  fmt::print("\n");
}

}  // namespace

void add_reduce_command(CLI::App& app) {
  auto arguments = std::make_shared<ReduceArguments>();
  CLI::App* command = app.add_subcommand("reduce", "Fewer triangles for the same surface, by default within its noise");
  command->add_option("mesh", arguments->input, "Mesh to reduce: PLY, OBJ or GLB")->required();
  command->add_option("-o,--output", arguments->output, "Result: .ply, .glb, .obj or .stl, without texture")
      ->required();
  CLI::Option* triangles = command->add_option("--triangles", arguments->triangles, "Stop at this many triangles")
                               ->check(CLI::Range(std::uint64_t(1), std::uint64_t(4'000'000'000)));
  command->add_option("--ratio", arguments->ratio, "Stop at this share of the triangles, 0 to 1")->excludes(triangles);
  command->add_option("--max-error", arguments->max_error_mm,
                      "Root mean square distance of a vertex to the planes it stands for, mm, at most; with a count "
                      "too, the first that is reached");
  command->add_flag("--keep-vertices", arguments->keeps_vertices,
                    "Move no vertex: the result's vertices are some of those given");
  add_common_options(*command, arguments->common);
  command->callback([arguments] { run(*arguments); });
}

}  // namespace lapseam::tool
