#pragma once

// In how many pieces is what the views truly saw? No mesh of it need have fewer.

#include <Eigen/Core>
#include <cstdint>
#include <unordered_map>
#include <utility>
#include <vector>

#include "core/disjoint_sets.h"
#include "lapseam/view.h"

namespace lapseam {

/// Samples fall into cubes of a given side. Cubes that touch are one surface, and so are those of neighbouring samples
/// of a view no farther apart than on a surface at 75° to the ray: gaps narrower than a cube do not count, which makes
/// for too few pieces rather than too many.
class SeenSurfaces {
 public:
  SeenSurfaces(double cell_m, const Eigen::Vector3d& origin_m) : cell_m_(cell_m), origin_m_(origin_m) {}

  /// Noiseless ranges, true pose. Not thread-safe; any order of the views gives the same figures.
  void visit(const View& view);

  /// The fewest pieces that hold 99 % of the cubes; 0 without samples.
  std::uint64_t pieces_99_percent();

 private:
  std::uint32_t cell_of(std::uint64_t key);

  double cell_m_;
  Eigen::Vector3d origin_m_;
  std::unordered_map<std::uint64_t, std::uint32_t> cells_;
  std::vector<std::uint64_t> keys_;                              // of each cell
  std::vector<std::pair<std::uint32_t, std::uint32_t>> linked_;  // of samples side by side, in different cells
};

}  // namespace lapseam
