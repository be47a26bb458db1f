#pragma once

// Where an image shows, on the nearer side of a jump of depth, what lies behind.

#include "lapseam/image.h"
#include "texture/color_camera.h"
#include "texture/depth_image.h"

namespace lapseam {

/// A surface that is some pixels beside its place, or wider than the thing, has the colours of what is behind it at its
/// rim, farther in than its fringe. Within twice `error_m` of a fringe, what is connected to it and is more like the
/// colours behind than like those farther in joins the fringe. Things narrower than that stay as they are: nothing says
/// which colours are theirs. So does the farther side: what it loses that way is more often its own.
void mark_foreign_colors(const ColorImage& image, bool wraps, double error_m, DepthImage& depth);

}  // namespace lapseam
