#pragma once

// Noise at several ranges to a noise model.

#include <span>

#include "lapseam/noise_measurement.h"

namespace lapseam {

/// The simplest s0 + s1·r + s2·r² that explains the bins, relative to their own sigma: positive for positive ranges,
/// and not falling between the bins and beyond. bins: at least one, ordered by range. The floor stays 0.
NoiseModel fit_noise(std::span<const NoiseBin> bins);

}  // namespace lapseam
