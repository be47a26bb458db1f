#pragma once

// Charts with smoother outlines: measured in the blocks that they own.

#include <vector>

#include "texture/layout.h"
#include "texture/shared_edges.h"

namespace lapseam {

class Context;

/// What reads a block at the rim of a sheet goes over to a neighbouring one where fewer blocks are owned then, by more
/// than its being coarser or larger there costs: ends, teeth, and thin arms. Border lengths, which frames are chosen
/// by, do not tell: what is finer than a block costs nothing.
void smooth_outlines(const Mesh& mesh, const std::vector<SharedEdge>& edges, const ColorCameras& cameras,
                     const std::vector<std::uint32_t>& view_of_triangle, Layout& layout, Context& context);

}  // namespace lapseam
