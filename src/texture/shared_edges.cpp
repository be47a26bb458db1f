#include "texture/shared_edges.h"

#include <algorithm>

#include "core/disjoint_sets.h"
#include "core/parallel.h"

namespace lapseam {

std::vector<SharedEdge> find_shared_edges(const Mesh& mesh, Context& context) {
  struct Side {
    std::uint64_t vertices;
    std::uint32_t triangle;
    std::uint8_t corner;
  };
  std::vector<Side> sides(3 * mesh.triangle_count());
  parallel_for(context, mesh.triangle_count(), 16384, [&](std::size_t i) {
    for (std::size_t k = 0; k < 3; ++k) {
      const std::uint64_t p = mesh.triangles[i][k], q = mesh.triangles[i][(k + 1) % 3];
      sides[3 * i + k] = {p < q ? p << 32 | q : q << 32 | p, std::uint32_t(i), std::uint8_t(k)};
    }
  });
  parallel_sort(context, sides.begin(), sides.end(), [](const Side& x, const Side& y) {
    return x.vertices != y.vertices ? x.vertices < y.vertices : x.triangle < y.triangle;
  });
  std::vector<SharedEdge> edges;
  for (std::size_t i = 0; i + 1 < sides.size(); ++i) {
    const Side &x = sides[i], &y = sides[i + 1];
    if (x.vertices == y.vertices && x.triangle != y.triangle)
      edges.push_back({x.triangle, y.triangle, x.corner, y.corner});
  }
  return edges;
}

std::vector<std::array<std::uint32_t, 3>> edges_of_triangles(const Mesh& mesh, const std::vector<SharedEdge>& edges) {
  std::vector<std::array<std::uint32_t, 3>> out(mesh.triangle_count(), {kNoEdge, kNoEdge, kNoEdge});
  for (std::uint32_t e = 0; e < edges.size(); ++e) {
    out[edges[e].a][edges[e].corner_a] = e;
    out[edges[e].b][edges[e].corner_b] = e;
  }
  return out;
}

std::vector<std::uint32_t> find_regions(const std::vector<SharedEdge>& edges, const std::vector<std::uint32_t>& label) {
  DisjointSets sets(label.size());
  for (const SharedEdge& edge : edges)
    if (label[edge.a] != kInvalidIndex && label[edge.a] == label[edge.b]) sets.unite(edge.a, edge.b);
  std::vector<std::uint32_t> root(label.size(), kInvalidIndex);
  for (std::uint32_t i = 0; i < root.size(); ++i)
    if (label[i] != kInvalidIndex) root[i] = sets.find(i);
  return root;
}

}  // namespace lapseam
