#pragma once

// How rough a mesh is beyond its curvature.

#include "reduce/partition.h"
#include "reduce/working_mesh.h"

namespace lapseam {

class Context;

/// Standard deviation of the vertices off the surface, metres: what neighbourhoods of some forty vertices are off a
/// quadratic fit, median over about a thousand of them, so that edges and clutter are outvoted. Noise that is smooth
/// over such a neighbourhood does not show. 0 for an exact mesh, or one that is too small to tell. Deterministic.
double estimate_mesh_noise(const Surface& surface, const Partition& parts, Context& context);

}  // namespace lapseam
