#pragma once

// Depth cameras give whole steps of disparity: a range stands for all that are rounded to it.

#include <span>
#include <vector>

#include "lapseam/context.h"
#include "lapseam/view.h"

namespace lapseam {

/// All values that the views' range images hold, ascending.
std::vector<float> range_values(std::span<const View* const> views, Context& context);

/// Moves each sample of given to where smoothed has it, as far as that is rounded to the same of the values (halfway to
/// its neighbours, in inverse range).
RangeImage within_rounding(const RangeImage& given, const RangeImage& smoothed, std::span<const float> values);

}  // namespace lapseam
