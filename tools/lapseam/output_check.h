#pragma once

// Where results go is looked at before the work starts, not after it.

#include <filesystem>

namespace lapseam::tool {

enum class MeshOutput {
  kAny,       ///< .ply, .glb, .obj or .stl
  kTextured,  ///< not .stl
};

/// Throws CLI::ValidationError for another ending, IoError where there is no folder to write to.
void check_mesh_output(const std::filesystem::path& output, MeshOutput formats = MeshOutput::kAny);

/// Throws IoError where there is no folder to write to.
void check_folder_of(const std::filesystem::path& output);

}  // namespace lapseam::tool
