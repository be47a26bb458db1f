#pragma once

// The noise of a sensor with what it was estimated from, to be shown.

#include <span>
#include <vector>

#include "lapseam/noise.h"

namespace lapseam {

/// The noise of samples around one range.
struct NoiseBin {
  double range_m;
  double sigma_m;  ///< > 0
  double samples;  ///< what sigma was taken from
};

struct NoiseMeasurement {
  NoiseModel model;
  std::vector<NoiseBin> bins;  ///< by range; empty where too few samples lie next to one another
};

/// As estimate_noise, which returns the model alone, but does not ask whether it is symmetric in the range.
NoiseMeasurement measure_noise(std::span<const View* const> views, Context& context);

}  // namespace lapseam
