#pragma once

// Compresses the rims of sheets where that leaves blocks to others.

#include <cstdint>
#include <vector>

#include "lapseam/mesh.h"
#include "texture/color_camera.h"
#include "texture/layout.h"

namespace lapseam {

class Context;

/// Many blocks at the rim of a sheet are owned for a pixel or two that reach into what their lookups read. Where that
/// is cheaper than a block, the outline is pushed back out of it, and what lies behind the outline is laid out closer
/// together, by the limits and at the price of frames (cost_of_stretch). The plane is deformed as a whole, so nothing
/// comes to lie over something else. view_of_triangle: whose image it shows.
void squeeze_outlines(const Mesh& mesh, const ColorCameras& cameras, const std::vector<std::uint32_t>& view_of_triangle,
                      Layout& layout, Context& context);

}  // namespace lapseam
