#include "health/incidence.h"

#include <numeric>

#include "core/parallel.h"

namespace lapseam {

Incidence build_incidence(std::size_t vertices, std::span<const Triangle> triangles) {
  Incidence incidence;
  incidence.offset.assign(vertices + 1, 0);
  for (const Triangle& t : triangles)
    if (!has_repeated_vertex(t))
      for (const std::uint32_t v : t) ++incidence.offset[v + 1];
  std::partial_sum(incidence.offset.begin(), incidence.offset.end(), incidence.offset.begin());
  incidence.triangle.resize(incidence.offset.back());
  // Filling moves each offset to the end of its run, which is where the next one starts: shifted back afterwards.
  for (std::size_t i = 0; i < triangles.size(); ++i)
    if (!has_repeated_vertex(triangles[i]))
      for (const std::uint32_t v : triangles[i]) incidence.triangle[incidence.offset[v]++] = std::uint32_t(i);
  for (std::size_t v = vertices; v > 0; --v) incidence.offset[v] = incidence.offset[v - 1];
  incidence.offset[0] = 0;
  return incidence;
}

Weld weld_equal_positions(std::span<const Eigen::Vector3f> positions_m, Context& context) {
  std::vector<std::uint32_t> order(positions_m.size());
  std::iota(order.begin(), order.end(), 0u);
  parallel_sort(context, order.begin(), order.end(), [&](std::uint32_t a, std::uint32_t b) {
    const Eigen::Vector3f &p = positions_m[a], &q = positions_m[b];
    for (int i = 0; i < 3; ++i)
      if (p[i] != q[i]) return p[i] < q[i];
    return a < b;
  });
  Weld weld;
  weld.new_index.assign(positions_m.size(), kInvalidIndex);
  // First every vertex learns the first one at its place, then the first ones are numbered in their old order.
  for (std::size_t i = 0; i < order.size(); ++i) {
    const bool is_same = i > 0 && positions_m[order[i]] == positions_m[order[i - 1]];
    weld.new_index[order[i]] = is_same ? weld.new_index[order[i - 1]] : order[i];
  }
  for (std::size_t v = 0; v < positions_m.size(); ++v) {
    if (weld.new_index[v] == v) {
      weld.new_index[v] = std::uint32_t(weld.first_vertex.size());
      weld.first_vertex.push_back(std::uint32_t(v));
    } else {
      weld.new_index[v] = weld.new_index[weld.new_index[v]];  // a smaller vertex, numbered already
    }
  }
  return weld;
}

WeldedSurface weld_surface(const Mesh& mesh, Context& context) {
  const Weld weld = weld_equal_positions(mesh.positions_m, context);
  WeldedSurface surface;
  surface.positions_m.reserve(weld.first_vertex.size());
  for (const std::uint32_t v : weld.first_vertex) surface.positions_m.push_back(mesh.positions_m[v]);
  surface.triangles.resize(mesh.triangle_count());
  parallel_for(context, mesh.triangle_count(), 4096, [&](std::size_t i) {
    for (std::size_t k = 0; k < 3; ++k) surface.triangles[i][k] = weld.new_index[mesh.triangles[i][k]];
  });
  return surface;
}

}  // namespace lapseam
