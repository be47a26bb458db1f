// Repairs that need only the topology: pinched vertices and stray pieces.

#include <algorithm>

#include "core/disjoint_sets.h"
#include "lapseam/sew.h"
#include "mesh/edge_sides.h"

namespace lapseam {
namespace {

std::uint32_t next_corner(std::uint32_t corner) { return corner % 3 == 2 ? corner - 2 : corner + 1; }

template <typename T>
void copy_element(std::vector<T>& array, std::uint32_t from) {
  if (!array.empty()) array.push_back(T(array[from]));
}

}  // namespace

std::uint64_t split_pinched_vertices(Mesh& mesh) {
  DisjointSets fans(mesh.triangle_count() * 3);
  EdgeSides(mesh.triangles, mesh.vertex_count()).for_each_pair([&](std::uint32_t p, std::uint32_t q) {
    // Opposite directions: the start of one is the end of the other.
    const bool is_opposite = mesh.triangles[p / 3][p % 3] != mesh.triangles[q / 3][q % 3];
    fans.unite(p, is_opposite ? next_corner(q) : q);
    fans.unite(next_corner(p), is_opposite ? q : next_corner(q));
  });
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
  const EdgeSides sides(mesh.triangles, mesh.vertex_count());
  std::vector<std::uint8_t> keep(mesh.triangle_count(), 1);
  const auto is_rising = [&](std::uint32_t corner) {
    const Triangle& t = mesh.triangles[corner / 3];
    return t[corner % 3] < t[next_corner(corner) % 3];
  };
  for (std::size_t v = 0; v < mesh.vertex_count(); ++v) {
    const auto at = sides.at(v);
    for (auto side = at.begin(); side != at.end(); ++side) {
      const auto is_same = [&](const EdgeSides::Side& other) {
        return other.higher == side->higher && keep[other.corner / 3] &&
               is_rising(other.corner) == is_rising(side->corner);
      };
      if (std::any_of(at.begin(), side, is_same)) keep[side->corner / 3] = 0;
    }
  }
  const auto removed = std::uint64_t(std::count(keep.begin(), keep.end(), std::uint8_t(0)));
  if (removed) mesh = compact(mesh, keep);
  return removed;
}

std::uint64_t remove_small_components(Mesh& mesh, std::uint64_t smallest) {
  DisjointSets components(mesh.triangle_count());
  EdgeSides(mesh.triangles, mesh.vertex_count()).for_each_pair([&](std::uint32_t p, std::uint32_t q) {
    components.unite(p / 3, q / 3);
  });
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
