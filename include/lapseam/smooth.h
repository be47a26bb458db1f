#pragma once

// Edge-preserving smoothing of range images, within the noise.

#include "lapseam/view.h"

namespace lapseam {

class Context;

struct SmoothOptions {
  /// Widest tap distance, in samples; taps are 1, 2, 4, ... up to here. 0: no smoothing.
  int reach_px = 8;
};

struct SmoothResult {
  RangeImage range;
  /// What is left of the noise, as a factor on sigma: median over samples.
  double remaining_sigma_factor = 1;
};

/// Averages each sample with pairs of samples that lie symmetrically about it, in the quantity that is affine in pixel
/// coordinates on a plane (inverse range for central sensors, range for parallel rays), so that slanted planes come out
/// unchanged; where the noise is symmetric in the range, means of inverse ranges are corrected for it. A pair counts
/// only where its mean agrees with the centre within the noise: steps and creases are kept. Passes with growing
/// distance (à trous: Holschneider et al. 1989). What then has found too few pairs that agree (beside pixels without a
/// sample, at borders, steps and creases) is settled by the smoothed samples on lines through it, on one side where
/// there is no other. Invalid pixels stay invalid, and none is made. Deterministic. Cost: about 40 operations per
/// sample and pass, a tenth of a second for 640×480 samples.
SmoothResult smooth(const View& view, const NoiseModel& noise, const SmoothOptions& options, Context& context);

/// What steps between smoothed samples are told from: `remaining_sigma_factor` of the noise, or a fifth, since beside
/// steps smoothing leaves more than elsewhere.
NoiseModel noise_at_steps(const NoiseModel& noise, double remaining_sigma_factor);

}  // namespace lapseam
