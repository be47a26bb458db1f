#pragma once

// One reader and one writer per mesh format, behind read_mesh and write_mesh of lapseam/io.h.
// Writers get a mesh that check_writable has passed; readers get the whole file, and `file` to name it in errors and to
// find its neighbours (materials, textures).

#include <filesystem>
#include <span>

#include "lapseam/io.h"

namespace lapseam {

void write_ply(const Mesh& mesh, const std::filesystem::path& file, const WriteMeshOptions& options);
void write_obj(const Mesh& mesh, const std::filesystem::path& file, const WriteMeshOptions& options);
void write_stl(const Mesh& mesh, const std::filesystem::path& file, const WriteMeshOptions& options);
void write_glb(const Mesh& mesh, const std::filesystem::path& file, const WriteMeshOptions& options);

bool looks_like_ply(std::span<const char> bytes);
bool looks_like_obj(std::span<const char> bytes);
bool looks_like_glb(std::span<const char> bytes);
Mesh read_ply(const std::filesystem::path& file, std::span<const char> bytes);
Mesh read_obj(const std::filesystem::path& file, std::span<const char> bytes);
Mesh read_glb(const std::filesystem::path& file, std::span<const char> bytes);

/// Where a reader of coordinates with more digits than a float puts the mesh's origin, given the first position:
/// the world origin up to 1 km away (60 µm is lost there), else the position in whole metres.
Eigen::Vector3d choose_origin(const Eigen::Vector3d& first_position_m);

}  // namespace lapseam
