#include "texture/cells.h"

#include <Eigen/Geometry>
#include <algorithm>

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

CellBorders find_borders(const Mesh& mesh, const Cells& cells, const std::vector<SharedEdge>& edges,
                         const std::vector<std::uint8_t>& is_marked) {
  const std::vector<std::uint32_t> cell = cell_of_triangles(cells);
  CellBorders out;
  for (const SharedEdge& edge : edges) {
    const std::uint32_t a = std::min(cell[edge.a], cell[edge.b]), b = std::max(cell[edge.a], cell[edge.b]);
    if (a == b || !is_marked[a] || !is_marked[b]) continue;
    const Triangle& t = mesh.triangles[edge.a];
    out.all.push_back(
        {a, b, (mesh.positions_m[t[edge.corner_a]] - mesh.positions_m[t[(edge.corner_a + 1u) % 3]]).norm()});
  }
  std::stable_sort(out.all.begin(), out.all.end(),
                   [](const CellBorder& x, const CellBorder& y) { return x.a != y.a ? x.a < y.a : x.b < y.b; });
  std::size_t kept = 0;
  for (const CellBorder& border : out.all) {
    if (kept > 0 && out.all[kept - 1].a == border.a && out.all[kept - 1].b == border.b)
      out.all[kept - 1].length_m += border.length_m;
    else
      out.all[kept++] = border;
  }
  out.all.resize(kept);
  out.begin.assign(cells.count() + 1, 0);
  for (const CellBorder& border : out.all) ++out.begin[border.a + 1], ++out.begin[border.b + 1];
  for (std::size_t i = 0; i < cells.count(); ++i) out.begin[i + 1] += out.begin[i];
  out.numbers.resize(2 * out.all.size());
  std::vector<std::uint32_t> next(out.begin.begin(), out.begin.end() - 1);
  for (std::uint32_t e = 0; e < out.all.size(); ++e) {
    out.numbers[next[out.all[e].a]++] = e;
    out.numbers[next[out.all[e].b]++] = e;
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
