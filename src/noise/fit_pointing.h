#pragma once

// What incidence adds to the noise.

#include <span>

#include "lapseam/noise.h"
#include "noise/roughness.h"

namespace lapseam {

/// The pointing_rad that explains by how much rougher slanted planes are than `noise` says of their ranges. 0 where
/// that does not show clearly.
double fit_pointing(std::span<const Roughness> samples, const NoiseModel& noise);

/// What of a sample's standard deviation is left where the surface faces the sensor. sample.slope_m: known.
float facing_share(const NoiseModel& noise, const Roughness& sample);

}  // namespace lapseam
