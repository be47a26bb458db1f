#pragma once

// What the range images of one sensor are off by, all alike: found from how views of one surface contradict each other.

#include <map>
#include <span>
#include <string>
#include <vector>

#include "lapseam/context.h"
#include "lapseam/register.h"
#include "register/associate.h"

namespace lapseam {

/// Adds to the corrections of each depth camera (pinhole sensors by id, of eight views or more) what still contradicts.
/// Least squares over all matches of all pairs; poses are held. Each half of the pairs has to predict the other one: a
/// sensor whose offsets do not is left as it is. Returns whether any changed. Deterministic.
bool add_range_offsets(std::span<const View> views, std::span<const Posed> posed, std::span<const GatedPair> pairs,
                       std::size_t surfels, std::map<std::string, RangeCorrection>& corrections, Context& context);

}  // namespace lapseam
