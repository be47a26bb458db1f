#pragma once

// Range image to triangles. After Sun, Dumont, Abidi 2000, §2.1 (six configurations of four neighbouring samples).

#include "lapseam/patch.h"

namespace lapseam {

class Context;

/// The largest range difference between neighbours of one surface, as a function of range; nobody sets it.
/// It follows from the sample spacing, the steepest incidence that is believed, and the noise.
struct StepThreshold {
  double spacing_offset_m = 0, spacing_slope = 0;  ///< sample spacing at range r: offset + slope · r
  NoiseModel noise;

  double spacing(double r) const { return spacing_offset_m + spacing_slope * r; }
  /// For neighbours in a row or column whose range changes in line with their own neighbours (a plane at grazing
  /// incidence).
  double continued(double r) const;
  /// For neighbours of which nothing else is known.
  double isolated(double r) const;
};
StepThreshold make_step_threshold(const Sensor& sensor, const NoiseModel& noise);

/// The triangles of a view. Where four samples lie on one surface the diagonal shorter in 3D splits them;
/// where exactly three do, they make one triangle. Deterministic; about 20 ns per sample.
PatchGrid triangulate(const View& view, const RayTable& rays, const StepThreshold& threshold, Context& context);

/// Fills confidence and incidence of a patch whose grid is there: the inverse of the expected error, which grows with
/// noise, sample spacing and obliqueness, and towards step discontinuities and image borders (Sun et al. 2000, §2.2:
/// cosine between normal and measurement ray × distance factor; Turk & Levoy 1994, §3: lower weight at borders).
void measure_confidence(Patch& patch, const StepThreshold& threshold, Context& context);

}  // namespace lapseam
