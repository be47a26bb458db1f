#pragma once

// Which edges there are.

#include <algorithm>
#include <cstdint>
#include <functional>
#include <iterator>
#include <vector>

#include "core/parallel.h"

namespace lapseam {

/// Keys of edges in sorted runs of doubling size: eight bytes an edge, few of them moved when more come. Based on:
/// J. Bentley, J. Saxe, Decomposable Searching Problems, 1980.
class EdgeSet {
 public:
  /// In any order; the same may come again and again.
  void add(std::vector<std::uint64_t> keys, Context& context) {
    if (keys.empty()) return;
    parallel_sort(context, keys.begin(), keys.end(), std::less<>());
    keys.erase(std::unique(keys.begin(), keys.end()), keys.end());
    runs_.push_back(std::move(keys));
    while (runs_.size() > 1 && runs_[runs_.size() - 2].size() < 2 * runs_.back().size()) {
      const std::vector<std::uint64_t>&a = runs_[runs_.size() - 2], &b = runs_.back();
      std::vector<std::uint64_t> merged;
      merged.reserve(a.size() + b.size());
      std::set_union(a.begin(), a.end(), b.begin(), b.end(), std::back_inserter(merged));
      runs_.pop_back();
      runs_.back() = std::move(merged);
    }
  }

  bool contains(std::uint64_t key) const {
    return std::any_of(runs_.begin(), runs_.end(),
                       [&](const auto& run) { return std::binary_search(run.begin(), run.end(), key); });
  }

  void clear() { runs_.clear(); }

 private:
  std::vector<std::vector<std::uint64_t>> runs_;  // the largest first
};

}  // namespace lapseam
