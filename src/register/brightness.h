#pragma once

// Pictures as brightness at points.

#include <memory>

#include "lapseam/register.h"
#include "register/surfels.h"

namespace lapseam {

/// Logarithm of the brightness, smoothed to the size that is asked for. Keeps a reduced copy of the picture.
BrightnessAt make_brightness(const ViewPicture& picture);

}  // namespace lapseam
