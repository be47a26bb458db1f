#include <string>

#include "io/mesh_formats.h"
#include "io/output_file.h"
#include "lapseam/error.h"

namespace lapseam {
namespace {

std::string lower_extension(const std::filesystem::path& file) {
  std::string extension = file.extension().string();
  for (char& c : extension)
    if (c >= 'A' && c <= 'Z') c = char(c - 'A' + 'a');
  return extension;
}

void check_texture(const Mesh& mesh, const std::filesystem::path& file) {
  if (mesh.triangle_page.empty()) return;
  for (std::size_t i = 0; i < mesh.triangle_count(); ++i) {
    const std::uint32_t page = mesh.triangle_page[i];
    if (page == kInvalidIndex) continue;
    if (page >= mesh.pages.size())
      throw InvalidInput(file, {}, "triangle_page",
                         "triangle " + std::to_string(i) + " uses page " + std::to_string(page) + " of " +
                             std::to_string(mesh.pages.size()));
    if (mesh.texcoords.empty()) throw InvalidInput(file, {}, "texcoords", "missing, but triangles have a page");
    for (const Eigen::Vector2f& uv : mesh.texcoords[i])
      if (!uv.allFinite()) throw InvalidInput(file, {}, "texcoords", "triangle " + std::to_string(i) + ": not finite");
  }
}

}  // namespace

Eigen::Vector3d choose_origin(const Eigen::Vector3d& first_position_m) {
  constexpr double kFloatsDoUpTo_m = 1000, kNothingIsFarther_m = 1e9;
  const double farthest_m = first_position_m.cwiseAbs().maxCoeff();
  if (!(farthest_m > kFloatsDoUpTo_m && farthest_m < kNothingIsFarther_m)) return Eigen::Vector3d::Zero();
  return first_position_m.array().round();
}

void write_mesh(const Mesh& mesh, const std::filesystem::path& file, const WriteMeshOptions& options) {
  check_mesh(mesh);
  check_texture(mesh, file);
  const std::string extension = lower_extension(file);
  if (extension == ".ply") return write_ply(mesh, file, options);
  if (extension == ".obj") return write_obj(mesh, file, options);
  if (extension == ".glb") return write_glb(mesh, file, options);
  if (extension == ".stl") return write_stl(mesh, file, options);
  throw InvalidInput(file, {}, {}, "a mesh is written as .ply, .obj, .glb or .stl, by the ending of the name");
}

Mesh read_mesh(const std::filesystem::path& file) {
  const std::vector<char> bytes = read_file_bytes(file);
  if (looks_like_ply(bytes)) return read_ply(file, bytes);
  if (looks_like_glb(bytes)) return read_glb(file, bytes);
  if (looks_like_obj(bytes)) return read_obj(file, bytes);
  throw InvalidInput(file, {}, {}, "this is not a PLY, OBJ or GLB mesh");
}

}  // namespace lapseam
