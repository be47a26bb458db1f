#pragma once

// The standard deviation of residuals most of which are noise.

#include <vector>

namespace lapseam {

/// From absolute residuals, at least one; those that are edges are dropped from `sizes`. The median stands edges as far
/// as they are few; leaving out what is one and taking it again rids it of most of what they still add.
double robust_sigma(std::vector<float>& sizes);

}  // namespace lapseam
