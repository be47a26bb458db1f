#pragma once

// Which triangles an edge has.

#include <algorithm>
#include <cstdint>
#include <numeric>
#include <span>
#include <vector>

#include "lapseam/mesh.h"

namespace lapseam {

/// The sides of all edges, dealt out by the lower end of their edge; there in the order of triangles. The few at one
/// vertex are compared with each other: nothing is sorted.
class EdgeSides {
 public:
  struct Side {
    std::uint32_t higher;  ///< the other end
    std::uint32_t corner;  ///< 3 · triangle + k: the edge runs from corner k to the next one
  };

  EdgeSides(std::span<const Triangle> triangles, std::size_t vertices) : end_(vertices + 1, 0) {
    const auto for_each_side = [&](const auto& visit) {
      for (std::uint32_t i = 0; i < triangles.size(); ++i)
        for (std::uint32_t k = 0; k < 3; ++k) {
          const std::uint32_t a = triangles[i][k], b = triangles[i][k == 2 ? 0 : k + 1];
          visit(std::min(a, b), Side{std::max(a, b), 3 * i + k});
        }
    };
    for_each_side([&](std::uint32_t lower, const Side&) { ++end_[lower + 1]; });
    std::partial_sum(end_.begin(), end_.end(), end_.begin());
    sides_.resize(3 * triangles.size());
    for_each_side([&](std::uint32_t lower, const Side& side) { sides_[end_[lower]++] = side; });
  }

  /// Of the edges whose lower end it is.
  std::span<const Side> at(std::size_t vertex) const {
    const std::size_t begin = vertex == 0 ? 0 : end_[vertex - 1];
    return {sides_.data() + begin, end_[vertex] - begin};
  }
  std::size_t vertices() const { return end_.size() - 1; }

  /// Calls visit(corner, next corner) for each side of an edge and the next one of the same edge.
  template <typename Visit>
  void for_each_pair(const Visit& visit) const {
    for (std::size_t v = 0; v < vertices(); ++v) {
      const std::span<const Side> sides = at(v);
      for (std::size_t i = 0; i < sides.size(); ++i)
        for (std::size_t j = i + 1; j < sides.size(); ++j) {
          if (sides[j].higher != sides[i].higher) continue;
          visit(sides[i].corner, sides[j].corner);
          break;
        }
    }
  }

 private:
  std::vector<std::uint32_t> end_;  // of each vertex's sides
  std::vector<Side> sides_;
};

}  // namespace lapseam
