#pragma once

// Better triangles in a seam, without new vertices: edges are turned, and short ones are taken out.

#include <algorithm>
#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "sew_meshes/triangle_check.h"

namespace lapseam {

class Context;

class SeamShape {
 public:
  struct Changes {
    std::uint64_t flips = 0, collapses = 0;
  };

  /// No triangle is bent by over 90 degrees against what is around it; on rough surfaces, where folds are everywhere,
  /// as much as what it replaces was, up to most_bent_cosine (0: nowhere).
  SeamShape(LiveMesh& mesh, TriangleCheck& check, double most_bent_cosine, Context& context)
      : mesh_(mesh), check_(check), most_bent_cosine_(most_bent_cosine), context_(context) {}

  /// Seam triangles from `first` on, and measured ones beside them where a sliver goes by it. What is made is valid by
  /// the check.
  Changes improve(std::uint32_t first);

 private:
  struct Change {
    std::vector<std::uint32_t> old;
    std::vector<Triangle> wanted;
  };

  TriangleRule rule_for(std::span<const std::uint32_t> old) const;
  double sine_of(const Triangle& t) const;
  std::optional<Change> find_flip(std::uint32_t a, std::uint32_t b) const;
  std::optional<Change> find_collapse(std::uint32_t from, std::uint32_t to) const;
  bool is_possible(const std::optional<Change>& change) const;
  bool make(const std::optional<Change>& change, bool was_possible);
  bool is_as_before(const Change& change) const;
  bool meets_new_ones(const Triangle& t) const;
  std::uint8_t edges_to_flip(std::uint32_t t) const;
  std::array<std::uint32_t, 2> shortest_edge(const Triangle& t) const;
  void begin_phase();
  bool is_due(std::uint32_t t) const;
  bool is_needle(std::uint32_t t) const;
  std::uint64_t flip_edges(std::uint32_t first);
  std::uint64_t collapse_needles(std::uint32_t first);

  std::uint8_t last_change(const Triangle& t) const {
    return std::max({last_change_[t[0]], last_change_[t[1]], last_change_[t[2]]});
  }
  bool is_settled(const Triangle& t) const;

  LiveMesh& mesh_;
  TriangleCheck& check_;
  double most_bent_cosine_;
  Context& context_;
  std::vector<std::uint8_t> last_change_;  // per vertex: number of the phase that last made a triangle at it, from 1
  std::uint8_t phase_ = 0;                 // flips and collapses take turns
  BoxForest new_boxes_;                    // of triangles made in this phase
};

}  // namespace lapseam
