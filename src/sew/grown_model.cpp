#include "sew/grown_model.h"

#include <Eigen/Geometry>
#include <algorithm>

#include "core/parallel.h"
#include "patch/by_view.h"
#include "patch/wide_normal.h"

namespace lapseam {
namespace {

constexpr std::size_t kChunk = 256;  // triangles

CoarseNormal normal_at(const Patch& patch, std::size_t pixel) {
  const auto w = std::size_t(patch.grid.width);
  const Eigen::Vector3f normal =
      patch.view.T_world_view.linear().cast<float>() * WideNormal(patch).at(int(pixel % w), int(pixel / w));
  return (normal * 127).array().round().matrix().cast<std::int8_t>();
}

}  // namespace

bool is_before(const OpenEdge& x, const OpenEdge& y) {
  const std::uint64_t kx = undirected(x.a, x.b), ky = undirected(y.a, y.b);
  return kx != ky ? kx < ky : x.triangle < y.triangle;
}

std::uint32_t GrownModel::add_vertex(std::uint32_t view, std::size_t pixel, const Eigen::Vector3f& position_m) {
  const auto id = std::uint32_t(mesh.positions_m.size());
  mesh.positions_m.push_back(position_m);
  mesh.vertex_view.push_back(view);
  mesh.vertex_pixel.push_back(std::uint32_t(pixel));
  error_m.push_back(expected_error_m(patches[view], pixel));
  normal.push_back(normal_at(patches[view], pixel));
  return id;
}

void GrownModel::add_triangle(const Triangle& triangle, TriangleTag tag, std::uint32_t view) {
  mesh.triangles.push_back(triangle);
  mesh.triangle_tag.push_back(tag);
  mesh.triangle_view.push_back(view);
}

// Everything that is known of the border, from the triangles alone.
void GrownModel::find_border(Context& context) {
  std::vector<OpenEdge> edges;
  edges.reserve(mesh.triangle_count() * 3);
  for (std::uint32_t t = 0; t < mesh.triangle_count(); ++t)
    for (std::size_t k = 0; k < 3; ++k) edges.push_back({mesh.triangles[t][k], mesh.triangles[t][(k + 1) % 3], t});
  parallel_sort(context, edges.begin(), edges.end(), is_before);
  open.clear();
  std::vector<std::uint8_t> on_border(mesh.vertex_count(), 0);
  for (std::size_t i = 0; i < edges.size(); ++i) {
    const std::uint64_t key = undirected(edges[i].a, edges[i].b);
    const bool is_paired = (i > 0 && undirected(edges[i - 1].a, edges[i - 1].b) == key) ||
                           (i + 1 < edges.size() && undirected(edges[i + 1].a, edges[i + 1].b) == key);
    if (is_paired) continue;
    open.push_back(edges[i]);
    on_border[edges[i].a] = on_border[edges[i].b] = 1;
  }
  border_edges.clear();
  for (const OpenEdge& edge : edges)
    if (on_border[edge.a] && on_border[edge.b]) border_edges.insert(undirected(edge.a, edge.b));
  chunks.clear();
  add_chunks(0);
}

void GrownModel::add_chunks(std::size_t begin) {
  for (std::size_t first = begin; first < mesh.triangles.size(); first += kChunk) {
    Chunk chunk{first, std::min(first + kChunk, mesh.triangles.size()), Eigen::Vector3f::Zero(), 0, 0};
    Eigen::AlignedBox3f box;
    for (std::size_t t = chunk.first; t < chunk.last; ++t)
      for (const std::uint32_t v : mesh.triangles[t]) {
        box.extend(mesh.positions_m[v]);
        chunk.error_m = std::max(chunk.error_m, error_m[v]);
      }
    chunk.center = box.center();
    chunk.radius_m = 0.5f * box.diagonal().norm();
    chunks.push_back(chunk);
  }
}
void GrownModel::replace(Mesh replacement, Context& context) {
  mesh = std::move(replacement);
  error_m.resize(mesh.vertex_count());
  normal.resize(mesh.vertex_count());
  const VerticesByView vertices(mesh, patches.size());
  parallel_for(context, patches.size(), 1, [&](std::size_t i) {
    for (const std::uint32_t v : vertices.of(i)) {
      error_m[v] = expected_error_m(patches[i], mesh.vertex_pixel[v]);
      normal[v] = normal_at(patches[i], mesh.vertex_pixel[v]);
    }
    relieve(patches[i]);
  });
  find_border(context);
}

Mesh GrownModel::take() {
  Mesh taken = std::move(mesh);
  mesh = {};
  mesh.origin_m = taken.origin_m;
  error_m = {};
  normal = {};
  open = {};
  chunks = {};
  border_edges = {};
  return taken;
}

}  // namespace lapseam
