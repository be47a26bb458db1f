#pragma once

// sRGB to linear light and back.

#include <Eigen/Core>

#include "lapseam/image.h"

namespace lapseam::simulation {

/// Linear channel value in [0, 1] of an 8-bit sRGB value.
float to_linear(std::uint8_t srgb);
Eigen::Vector3f to_linear(Rgb8 color);
/// Clips to [0, 1]; from a table, so exact to within half a step of 8 bits everywhere but in the darkest few values.
Rgb8 to_srgb(const Eigen::Vector3f& linear);

}  // namespace lapseam::simulation
