#pragma once

// Rims that reach farther out than most views saw them.

#include <cstdint>
#include <span>

#include "lapseam/overlap.h"
#include "mend/witnesses.h"
#include "sew_meshes/triangle_check.h"

namespace lapseam {

class Context;

/// Removes, from the border inwards, triangles whose middle more views (three at least) looked through than measured a
/// surface there, within half of what noise and poses may do: where views disagree, what stays ends where it ended for
/// the median of them. They go only within three times the registration error of something that stays, and with most of
/// their connected part: a thing thinner than poses may be off is out of place for most views, but there. error_m: of
/// each vertex, along its normal. Returns how many went; none without a registration error. Same result for any number
/// of threads.
std::uint64_t remove_seen_through(LiveMesh& mesh, const TriangleCheck& check, const Witnesses& witnesses,
                                  std::span<const float> error_m, const OverlapOptions& options, Context& context);

}  // namespace lapseam
