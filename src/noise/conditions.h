#pragma once

// What incidence and intensity add to the noise of a range.

#include <span>
#include <vector>

#include "lapseam/noise.h"
#include "noise/roughness.h"

namespace lapseam {

/// The pointing_rad that explains by how much rougher slanted planes are than `noise` says of their ranges and
/// intensities. 0 where that does not show clearly.
double fit_pointing(std::span<const Roughness> samples, const NoiseModel& noise);

/// Sets intensity_power and intensity_reference of `noise` to what explains by how much rougher dark surfaces are than
/// it says of their ranges and incidences; the power is 0 where that does not show clearly.
void fit_intensity(std::span<const Roughness> samples, NoiseModel& noise);

/// The samples that are known well enough, as they would be on surfaces that face the sensor and have the reference's
/// intensity.
std::vector<Roughness> without_conditions(std::span<const Roughness> samples, const NoiseModel& noise);

}  // namespace lapseam
