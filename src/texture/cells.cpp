#include "texture/cells.h"

#include <Eigen/Geometry>

namespace lapseam {
namespace {

constexpr std::size_t kMostTriangles = 16;
constexpr float kAlike = 0.7f;  // cosine between normals

Eigen::Vector3f normal_of(const Mesh& mesh, std::uint32_t i) {
  const Triangle& t = mesh.triangles[i];
  const Eigen::Vector3f a = mesh.positions_m[t[0]];
  return (mesh.positions_m[t[1]] - a).cross(mesh.positions_m[t[2]] - a).normalized();
}

}  // namespace

Cells make_cells(const Mesh& mesh, const std::vector<SharedEdge>& edges) {
  const std::vector<std::array<std::uint32_t, 3>> sides = edges_of_triangles(mesh, edges);
  Cells cells;
  cells.triangles.reserve(mesh.triangle_count());
  cells.begin.push_back(0);
  std::vector<std::uint8_t> is_taken(mesh.triangle_count(), 0);
  for (std::uint32_t seed = 0; seed < mesh.triangle_count(); ++seed) {
    if (is_taken[seed]) continue;
    const Eigen::Vector3f normal = normal_of(mesh, seed);
    const std::size_t begin = cells.triangles.size();
    cells.triangles.push_back(seed);
    is_taken[seed] = 1;
    for (std::size_t next = begin; next < cells.triangles.size(); ++next)
      for (const std::uint32_t e : sides[cells.triangles[next]]) {
        if (e == kNoEdge || cells.triangles.size() - begin == kMostTriangles) continue;
        const std::uint32_t other = edges[e].a == cells.triangles[next] ? edges[e].b : edges[e].a;
        if (is_taken[other] || !(normal.dot(normal_of(mesh, other)) > kAlike)) continue;
        is_taken[other] = 1;
        cells.triangles.push_back(other);
      }
    cells.begin.push_back(std::uint32_t(cells.triangles.size()));
  }
  return cells;
}

Cells take_apart(const Cells& cells, const std::vector<std::uint8_t>& is_marked) {
  Cells out;
  out.begin.push_back(0);
  for (std::size_t c = 0; c < cells.count(); ++c) {
    for (const std::uint32_t i : cells.of(c)) {
      out.triangles.push_back(i);
      if (is_marked[c]) out.begin.push_back(std::uint32_t(out.triangles.size()));
    }
    if (!is_marked[c]) out.begin.push_back(std::uint32_t(out.triangles.size()));
  }
  return out;
}

std::vector<std::uint32_t> cell_of_triangles(const Cells& cells) {
  std::vector<std::uint32_t> cell(cells.triangles.size());
  for (std::uint32_t c = 0; c < cells.count(); ++c)
    for (const std::uint32_t i : cells.of(c)) cell[i] = c;
  return cell;
}

}  // namespace lapseam
