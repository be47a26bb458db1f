#pragma once

// In which quantity the noise of a sensor is symmetric: there, means are right.

#include <span>

#include "lapseam/context.h"
#include "lapseam/noise.h"
#include "lapseam/view.h"

namespace lapseam {

/// Whether the noise of a sensor is symmetric in its range (times of flight), not in its inverse range
/// (disparities). What is symmetric in the range is skewed in the inverse range by 6 sigma / range, which a few million
/// samples tell; false where they do not, and for sensors that are not central. views: of one sensor, with the noise of
/// each. Deterministic; about 5 ns per sample.
bool is_symmetric_in_range(std::span<const View* const> views, std::span<const NoiseModel* const> noise,
                           Context& context);

}  // namespace lapseam
