#pragma once

// From a view to a patch as the pipeline makes it, without the pipeline.

#include "lapseam/context.h"
#include "lapseam/patch.h"
#include "lapseam/triangulate.h"

namespace lapseam::test {

inline Patch make_patch(const View& view, const NoiseModel& noise, Context& context) {
  Patch patch{view, noise, make_ray_table(view.sensor), {}, {}, {}};
  const StepThreshold threshold = make_step_threshold(view.sensor, noise);
  patch.grid = triangulate(patch.view, *patch.rays, threshold, context);
  measure_confidence(patch, threshold, context);
  return patch;
}

}  // namespace lapseam::test
