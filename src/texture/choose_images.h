#pragma once

// One image for each cell of triangles: a good one, and the same for large regions.

#include <vector>

#include "texture/candidates.h"
#include "texture/shared_edges.h"

namespace lapseam {

/// View of each cell; kInvalidIndex where there is no candidate. Minimises the candidates' costs, in pixels of the best
/// image that they concern, and the length of the borders between images in those pixels, where a border between images
/// that differ there counts for more. Starts with the best image of each cell.
std::vector<std::uint32_t> choose_images(const Mesh& mesh, const Cells& cells, const Candidates& candidates,
                                         const std::vector<SharedEdge>& edges, Context& context);

}  // namespace lapseam
