#include "lapseam/mesh.h"

#include <cmath>

#include "lapseam/error.h"

namespace lapseam {
namespace {

template <typename T>
void check_length(const std::vector<T>& array, std::size_t expected, const char* field) {
  if (!array.empty() && array.size() != expected)
    throw InvalidInput({}, {}, field,
                       "has " + std::to_string(array.size()) + " entries, not " + std::to_string(expected));
}

template <typename T>
void keep_marked(std::vector<T>& array, const std::vector<std::uint8_t>& keep) {
  if (array.empty()) return;
  std::size_t out = 0;
  for (std::size_t i = 0; i < array.size(); ++i)
    if (keep[i]) array[out++] = array[i];
  array.resize(out);
}

}  // namespace

void check_mesh(const Mesh& mesh) {
  const std::size_t vertices = mesh.vertex_count(), triangles = mesh.triangle_count();
  check_length(mesh.colors, vertices, "colors");
  check_length(mesh.vertex_view, vertices, "vertex_view");
  check_length(mesh.vertex_pixel, vertices, "vertex_pixel");
  check_length(mesh.triangle_view, triangles, "triangle_view");
  check_length(mesh.triangle_tag, triangles, "triangle_tag");
  check_length(mesh.texcoords, triangles, "texcoords");
  check_length(mesh.triangle_page, triangles, "triangle_page");
  check_length(mesh.is_unseen, triangles, "is_unseen");
  for (std::size_t i = 0; i < vertices; ++i)
    if (!mesh.positions_m[i].allFinite())
      throw InvalidInput({}, {}, "positions_m", "vertex " + std::to_string(i) + " is not finite");
  for (std::size_t i = 0; i < triangles; ++i)
    for (const std::uint32_t v : mesh.triangles[i])
      if (v >= vertices)
        throw InvalidInput(
            {}, {}, "triangles",
            "triangle " + std::to_string(i) + " uses vertex " + std::to_string(v) + " of " + std::to_string(vertices));
}

void drop_texture(Mesh& mesh) {
  mesh.texcoords = {};
  mesh.triangle_page = {};
  mesh.pages = {};
  // is_unseen stays: the colours of vertices are made up there too.
}

Mesh compact(const Mesh& mesh, const std::vector<std::uint8_t>& keep) {
  Mesh out = mesh;
  keep_marked(out.triangles, keep);
  keep_marked(out.triangle_view, keep);
  keep_marked(out.triangle_tag, keep);
  keep_marked(out.texcoords, keep);
  keep_marked(out.triangle_page, keep);
  keep_marked(out.is_unseen, keep);

  std::vector<std::uint8_t> is_used(mesh.vertex_count(), 0);
  for (const Triangle& t : out.triangles)
    for (const std::uint32_t v : t) is_used[v] = 1;
  std::vector<std::uint32_t> new_index(mesh.vertex_count(), kInvalidIndex);
  std::uint32_t next = 0;
  for (std::size_t i = 0; i < is_used.size(); ++i)
    if (is_used[i]) new_index[i] = next++;
  for (Triangle& t : out.triangles)
    for (std::uint32_t& v : t) v = new_index[v];
  keep_marked(out.positions_m, is_used);
  keep_marked(out.colors, is_used);
  keep_marked(out.vertex_view, is_used);
  keep_marked(out.vertex_pixel, is_used);
  return out;
}

}  // namespace lapseam
