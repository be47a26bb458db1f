#include <bit>
#include <string>

#include "io/mesh_formats.h"
#include "io/number_text.h"
#include "io/output_file.h"

namespace lapseam {
namespace {

static_assert(std::endian::native == std::endian::little, "binary files are written in the machine's byte order");

std::string header_text(const Mesh& mesh, bool with_provenance) {
  std::string text = "ply\nformat binary_little_endian 1.0\ncomment written by lapseam\n";
  if (with_provenance && !mesh.triangle_tag.empty()) text += "comment tag: 0 measured, 1 seam, 2 filled\n";
  if (with_provenance && !mesh.is_unseen.empty())
    text += "comment unseen: 1 no image shows it, its colour is made up\n";
  if (!mesh.origin_m.isZero(0))
    text += "obj_info origin_m " + number_text(mesh.origin_m.x()) + " " + number_text(mesh.origin_m.y()) + " " +
            number_text(mesh.origin_m.z()) + "\n";
  text += "element vertex " + std::to_string(mesh.vertex_count()) + "\n";
  text += "property float x\nproperty float y\nproperty float z\n";
  if (!mesh.colors.empty()) text += "property uchar red\nproperty uchar green\nproperty uchar blue\n";
  if (with_provenance && !mesh.vertex_view.empty()) text += "property uint view\n";
  if (with_provenance && !mesh.vertex_pixel.empty()) text += "property uint pixel\n";
  text += "element face " + std::to_string(mesh.triangle_count()) + "\n";
  text += "property list uchar uint vertex_indices\n";
  if (with_provenance && !mesh.triangle_view.empty()) text += "property uint view\n";
  if (with_provenance && !mesh.triangle_tag.empty()) text += "property uchar tag\n";
  if (with_provenance && !mesh.is_unseen.empty()) text += "property uchar unseen\n";
  return text + "end_header\n";
}

}  // namespace

void write_ply(const Mesh& mesh, const std::filesystem::path& file, const WriteMeshOptions& options) {
  const bool with_provenance = options.with_provenance;
  OutputFile out(file);
  out.write(header_text(mesh, with_provenance));
  for (std::size_t i = 0; i < mesh.vertex_count(); ++i) {
    out.write(mesh.positions_m[i].data(), 3 * sizeof(float));
    if (!mesh.colors.empty()) out.put(mesh.colors[i]);
    if (with_provenance && !mesh.vertex_view.empty()) out.put(mesh.vertex_view[i]);
    if (with_provenance && !mesh.vertex_pixel.empty()) out.put(mesh.vertex_pixel[i]);
  }
  for (std::size_t i = 0; i < mesh.triangle_count(); ++i) {
    out.put(std::uint8_t(3));
    out.write(mesh.triangles[i].data(), sizeof(Triangle));
    if (with_provenance && !mesh.triangle_view.empty()) out.put(mesh.triangle_view[i]);
    if (with_provenance && !mesh.triangle_tag.empty()) out.put(mesh.triangle_tag[i]);
    if (with_provenance && !mesh.is_unseen.empty()) out.put(mesh.is_unseen[i]);
  }
  out.commit();
}

}  // namespace lapseam
