#pragma once

// What lies over another layer of the same surface, at the borders of either.

#include <cstdint>
#include <span>

#include "lapseam/overlap.h"
#include "sew_meshes/triangle_check.h"

namespace lapseam {

class Context;

/// Removes border triangles whose middle lies over another triangle that faces alike, shares no vertex with them, and
/// is no farther off than the noise of both allows; then what came to the border by that. The least sure go first
/// (seams, then by error). error_m: per vertex, along its normal. Returns how many went. Same result for any number of
/// threads.
std::uint64_t trim_double_layers(LiveMesh& mesh, const TriangleCheck& check, std::span<const float> error_m,
                                 const OverlapOptions& options, Context& context);

}  // namespace lapseam
