#pragma once

// COLMAP: models (text or binary) with the depth maps of its dense reconstruction.

#include <string_view>

#include "io/source.h"
#include "lapseam/image.h"

namespace lapseam {

bool looks_like_colmap_depth(std::string_view start);
ImageSize probe_colmap_depth(const Source& source);
/// Stored values, unscaled.
Image<float> read_colmap_depth(const Source& source);

}  // namespace lapseam
