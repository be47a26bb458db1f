#pragma once

// How far a measured range may be off, along its ray.

#include <span>

#include "lapseam/image.h"
#include "lapseam/sensor.h"

namespace lapseam {

class Context;
struct View;

/// Standard deviation of the range along the ray: sigma(r) = max(floor, s0 + s1·r + s2·r²), metres. correlation: how
/// many neighbouring samples have one error between them, at least 1; where ranges are rounded to steps larger than
/// their noise, those on one step are off alike, and a mean of them by as much as each.
struct NoiseModel {
  double s0_m = 0;
  double s1 = 0;
  double s2_per_m = 0;
  double floor_m = 0;
  double correlation = 1;

  double sigma(double range_m) const {
    const double s = s0_m + range_m * (s1 + range_m * s2_per_m);
    return s > floor_m ? s : floor_m;
  }
};

/// The noise of a sensor, from range images of unknown scenes. What neighbouring samples disagree by on surfaces that
/// are smooth over five samples is noise; edges and texture are outvoted (median absolute deviation per bin of range).
/// Exact for planes under any sensor. Covers what differs from sample to sample; an error that whole neighbourhoods
/// share, as of calibration, does not show. The floor is what rounding of the stored values alone makes (correlation:
/// where it exceeds the roughness, by how much, squared, up to 4); without any noise the model is tiny but positive.
/// sigma does not fall with range. views: one or more, loaded, all of one sensor. Parallel over views, deterministic;
/// about 3 ms for a view of any size. Throws InvalidInput when there is no view or no sample in them.
NoiseModel estimate_noise(std::span<const View* const> views, Context& context);

}  // namespace lapseam
