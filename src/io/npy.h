#pragma once

// NumPy's .npy files (format versions 1 to 3) with one depth map.

#include <string_view>

#include "io/source.h"
#include "lapseam/image.h"

namespace lapseam {

bool looks_like_npy(std::string_view start);
/// Height × width of float32, float64, uint16, int16, uint32 or int32, little-endian, in rows or columns; a third axis
/// of length 1 is let pass. Refuses all else, and a file of the wrong length.
ImageSize probe_npy(const Source& source);
/// Stored values, unscaled.
Image<double> read_npy(const Source& source);

}  // namespace lapseam
