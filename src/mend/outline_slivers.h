#pragma once

// Slivers at the borders: along the rays of the image they come from, or needles that seams left.

#include <cstdint>

#include "mend/witnesses.h"
#include "sew_meshes/live_mesh.h"

namespace lapseam {

class Context;

/// Where noise is as large as a step between two surfaces, a view cannot tell the step from a steep surface, and spans
/// it. What it makes there are slivers along its rays, of which a range says nothing. At borders they go, with what
/// came to the border by that and is no better. So do needles of seams that stick out. Returns how many went.
/// Deterministic.
std::uint64_t remove_outline_slivers(LiveMesh& mesh, const Witnesses& witnesses, Context& context);

}  // namespace lapseam
