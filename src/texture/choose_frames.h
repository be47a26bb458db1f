#pragma once

// One image for each cell of triangles in whose frame it is laid out: mostly that which it shows, or that of what is
// around it.

#include <vector>

#include "texture/cells.h"
#include "texture/color_camera.h"
#include "texture/shared_edges.h"

namespace lapseam {

class Context;

/// View of each cell whose projection gives its place on a page; kInvalidIndex where view_of_cell is. Borders between
/// frames cost the padding of the charts on both sides, borders between images within a frame nothing: cells go over to
/// the frames of their neighbours where they lie next to them in it, not over anything else, and about as large as in
/// the image that they show. Minimises what pages hold beside that, as choose_images does its costs.
std::vector<std::uint32_t> choose_frames(const Mesh& mesh, const Cells& cells, const std::vector<SharedEdge>& edges,
                                         const ColorCameras& cameras, const std::vector<std::uint32_t>& view_of_cell,
                                         Context& context);

}  // namespace lapseam
