#pragma once

// How rough range images are, from sample to sample.

#include <cstdint>
#include <vector>

#include "lapseam/view.h"

namespace lapseam {

/// One look at a neighbourhood: what its middle sample is off by from what its neighbours foretell, along the ray,
/// scaled so that independent noise of standard deviation sigma gives values of standard deviation sigma.
struct Roughness {
  float range;
  float residual_m;
  /// Of the plane that the tile shows: how far the range changes along it, times range: range · tan(incidence). Below 0
  /// where the tile shows none.
  float slope_m;
  std::uint8_t intensity;  ///< 0 where the view has none
};

/// From up to `tiles` tiles, spread evenly over the image. Zero on planes, whatever the sensor, and nearly so on smooth
/// surfaces. Ordered by tile and pixel.
std::vector<Roughness> measure_roughness(const View& view, int tiles);

}  // namespace lapseam
