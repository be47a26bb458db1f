// Repairs that need only the topology: pinched vertices and stray pieces.

#include <algorithm>
#include <numeric>

#include "core/disjoint_sets.h"
#include "lapseam/sew.h"

namespace lapseam {
namespace {

// One side of an edge: which triangle, and which of its corners come first.
struct EdgeSide {
  std::uint64_t edge;
  std::uint32_t corner;  // 3·triangle + k: the edge runs from corner k to corner k + 1
  bool operator<(const EdgeSide& o) const { return edge != o.edge ? edge < o.edge : corner < o.corner; }
};

// By edge, then corner: dealt out by the lower vertex, which few edges share, and sorted there.
std::vector<EdgeSide> sorted_edge_sides(const Mesh& mesh) {
  // Where each vertex's sides begin; once they are dealt out, where they end.
  std::vector<std::uint32_t> end(mesh.vertex_count() + 1, 0);
  const auto for_each_side = [&](const auto& visit) {
    for (std::uint32_t i = 0; i < mesh.triangle_count(); ++i)
      for (std::uint32_t k = 0; k < 3; ++k) {
        const std::uint32_t a = mesh.triangles[i][k], b = mesh.triangles[i][(k + 1) % 3];
        visit(std::min(a, b), std::max(a, b), 3 * i + k);
      }
  };
  for_each_side([&](std::uint32_t low, std::uint32_t, std::uint32_t) { ++end[low + 1]; });
  std::partial_sum(end.begin(), end.end(), end.begin());
  std::vector<EdgeSide> sides(mesh.triangle_count() * 3);
  for_each_side([&](std::uint32_t low, std::uint32_t high, std::uint32_t corner) {
    sides[end[low]++] = {std::uint64_t(low) << 32 | high, corner};
  });
  for (std::size_t v = 0, begin = 0; v < mesh.vertex_count(); begin = end[v++])
    std::sort(sides.begin() + std::ptrdiff_t(begin), sides.begin() + std::ptrdiff_t(end[v]));
  return sides;
}

std::uint32_t next_corner(std::uint32_t corner) { return corner % 3 == 2 ? corner - 2 : corner + 1; }

template <typename T>
void copy_element(std::vector<T>& array, std::uint32_t from) {
  if (!array.empty()) array.push_back(T(array[from]));
}

}  // namespace

std::uint64_t split_pinched_vertices(Mesh& mesh) {
  const std::vector<EdgeSide> sides = sorted_edge_sides(mesh);
  DisjointSets fans(mesh.triangle_count() * 3);
  for (std::size_t i = 0; i + 1 < sides.size(); ++i) {
    if (sides[i].edge != sides[i + 1].edge) continue;
    const std::uint32_t p = sides[i].corner, q = sides[i + 1].corner;
    // Opposite directions: the start of one is the end of the other.
    const bool is_opposite = mesh.triangles[p / 3][p % 3] != mesh.triangles[q / 3][q % 3];
    fans.unite(p, is_opposite ? next_corner(q) : q);
    fans.unite(next_corner(p), is_opposite ? q : next_corner(q));
  }
  std::vector<std::uint32_t> first_fan(mesh.vertex_count(), kInvalidIndex);
  std::vector<std::uint32_t> copy_of_fan(mesh.triangle_count() * 3, kInvalidIndex);
  std::uint64_t copies = 0;
  for (std::uint32_t corner = 0; corner < mesh.triangle_count() * 3; ++corner) {
    std::uint32_t& v = mesh.triangles[corner / 3][corner % 3];
    const std::uint32_t fan = fans.find(corner);
    if (first_fan[v] == kInvalidIndex) first_fan[v] = fan;
    if (first_fan[v] == fan) continue;
    if (copy_of_fan[fan] == kInvalidIndex) {
      copy_of_fan[fan] = std::uint32_t(mesh.vertex_count());
      copy_element(mesh.positions_m, v);
      copy_element(mesh.colors, v);
      copy_element(mesh.vertex_view, v);
      copy_element(mesh.vertex_pixel, v);
      ++copies;
    }
    v = copy_of_fan[fan];
  }
  return copies;
}

std::uint64_t remove_nonmanifold(Mesh& mesh) {
  const std::vector<EdgeSide> sides = sorted_edge_sides(mesh);
  std::vector<std::uint8_t> keep(mesh.triangle_count(), 1);
  const auto is_rising = [&](std::uint32_t corner) {
    const Triangle& t = mesh.triangles[corner / 3];
    return t[corner % 3] < t[next_corner(corner) % 3];
  };
  for (std::size_t i = 0; i < sides.size();) {
    std::size_t end = i;
    bool has_side[2] = {false, false};  // falling, rising
    for (; end < sides.size() && sides[end].edge == sides[i].edge; ++end) {
      const std::uint32_t corner = sides[end].corner;
      if (!keep[corner / 3]) continue;
      bool& has = has_side[is_rising(corner)];
      if (has) keep[corner / 3] = 0;
      has = true;
    }
    i = end;
  }
  const auto removed = std::uint64_t(std::count(keep.begin(), keep.end(), std::uint8_t(0)));
  if (removed) mesh = compact(mesh, keep);
  return removed;
}

std::uint64_t remove_small_components(Mesh& mesh, std::uint64_t smallest) {
  const std::vector<EdgeSide> sides = sorted_edge_sides(mesh);
  DisjointSets components(mesh.triangle_count());
  for (std::size_t i = 0; i + 1 < sides.size(); ++i)
    if (sides[i].edge == sides[i + 1].edge) components.unite(sides[i].corner / 3, sides[i + 1].corner / 3);
  std::vector<std::uint32_t> size(mesh.triangle_count(), 0);
  for (std::uint32_t i = 0; i < mesh.triangle_count(); ++i) ++size[components.find(i)];
  std::vector<std::uint8_t> keep(mesh.triangle_count());
  std::uint64_t removed = 0;
  for (std::uint32_t i = 0; i < mesh.triangle_count(); ++i) {
    keep[i] = size[components.find(i)] >= smallest;
    removed += keep[i] ? 0 : 1;
  }
  if (removed) mesh = compact(mesh, keep);
  return removed;
}

}  // namespace lapseam
