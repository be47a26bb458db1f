#pragma once

#include <algorithm>
#include <span>

namespace lapseam {

/// Linear between the two nearest values, as numpy's default. sorted: at least one value, in increasing order.
inline double percentile(std::span<const float> sorted, double percent) {
  const double place = percent / 100 * double(sorted.size() - 1);
  const auto below = std::size_t(place);
  const std::size_t above = std::min(below + 1, sorted.size() - 1);
  // Not a + f·(b − a) for f = 0: infinite values would give NaN.
  const double fraction = place - double(below);
  if (fraction == 0 || sorted[below] == sorted[above]) return double(sorted[below]);
  return double(sorted[below]) + fraction * (double(sorted[above]) - double(sorted[below]));
}

}  // namespace lapseam
