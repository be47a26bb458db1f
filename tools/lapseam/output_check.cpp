#include "output_check.h"

#include <CLI/CLI.hpp>
#include <string>

#include "lapseam/error.h"

namespace lapseam::tool {

void check_mesh_output(const std::filesystem::path& output, MeshOutput formats) {
  const std::string ending = output.extension().string();
  const bool takes_stl = formats == MeshOutput::kAny;
  if (ending != ".ply" && ending != ".glb" && ending != ".obj" && !(takes_stl && ending == ".stl")) {
    const std::string endings = takes_stl ? ".ply, .glb, .obj or .stl" : ".ply, .glb or .obj";
    throw CLI::ValidationError("--output", "must end in " + endings + ": " + output.string());
  }
  check_folder_of(output);
}

void check_folder_of(const std::filesystem::path& output) {
  const auto folder = output.has_parent_path() ? output.parent_path() : std::filesystem::path(".");
  if (!std::filesystem::is_directory(folder)) throw IoError(folder, "no such folder");
}

}  // namespace lapseam::tool
