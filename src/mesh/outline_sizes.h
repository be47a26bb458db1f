#pragma once

// How long the outlines of a mesh are.

#include <cstdint>
#include <vector>

#include "core/disjoint_sets.h"

namespace lapseam {

/// Of each vertex, how many of the open edges (with ends a and b) hang together where it lies; 0 elsewhere.
template <typename Edges>
std::vector<std::uint32_t> outline_sizes(std::size_t vertices, const Edges& open) {
  DisjointSets outlines(vertices);
  for (const auto& edge : open) outlines.unite(edge.a, edge.b);
  std::vector<std::uint32_t> size(vertices, 0);
  for (const auto& edge : open) ++size[outlines.find(edge.a)];
  for (std::uint32_t v = 0; v < vertices; ++v) size[v] = size[outlines.find(v)];
  return size;
}

}  // namespace lapseam
