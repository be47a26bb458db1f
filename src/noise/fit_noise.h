#pragma once

// Noise at several ranges to a noise model.

#include <span>

#include "lapseam/noise.h"

namespace lapseam {

/// The noise of samples around one range.
struct NoiseBin {
  double range_m;
  double sigma_m;  ///< > 0
  double samples;  ///< what sigma was taken from
};

/// The simplest s0 + s1·r + s2·r² that explains the bins, relative to their own sigma: positive for positive ranges,
/// and not falling between the bins and beyond. bins: at least one, ordered by range. The floor stays 0.
NoiseModel fit_noise(std::span<const NoiseBin> bins);

}  // namespace lapseam
