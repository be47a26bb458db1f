#pragma once

// One of two labels for each of some nodes, at the least cost.

#include <cstdint>
#include <vector>

namespace lapseam {

/// Minimises Σ cost(label of a node) + Σ cost of links whose first node has label 0 and second label 1, exactly, by a
/// minimum cut of a graph. Costs are rounded to 1/64, so that sums are exact and the same everywhere.
class MinCut {
 public:
  explicit MinCut(std::size_t nodes) : take_over_keep_(nodes, 0) {}

  /// What label 1 costs more than label 0; adds up.
  void add_cost(std::uint32_t node, double label_1_over_0) { take_over_keep_[node] += to_units(label_1_over_0); }
  /// Costs, 0 or more, when a has label 0 and b label 1, and the other way round.
  void add_link(std::uint32_t a, std::uint32_t b, double a0_b1, double a1_b0) {
    links_.push_back({a, b, to_units(a0_b1), to_units(a1_b0)});
  }

  /// Label of each node; of several minima, the one with the most zeros.
  std::vector<std::uint8_t> solve() const;

 private:
  struct Link {
    std::uint32_t a, b;
    std::int64_t forward, backward;
  };
  static std::int64_t to_units(double cost);

  std::vector<std::int64_t> take_over_keep_;
  std::vector<Link> links_;
};

}  // namespace lapseam
