#pragma once

// A grid of samples as few triangles as its noise allows: large ones where the surface is flat, single cells along
// borders and where it bends. After W. Evans, D. Kirkpatrick, G. Townsend, Right-Triangulated Irregular Networks, 2001.

#include <array>
#include <cstdint>
#include <functional>
#include <vector>

#include "lapseam/context.h"
#include "lapseam/image.h"

namespace lapseam {

/// Corners as sample indices v·width + u; for u to the right and v down they turn left (up is −v).
using SampleTriangle = std::array<std::uint32_t, 3>;

/// How far the sample m is from the plane through a, b, c, in units of what is allowed: above 1 the plane will not do.
using SampleDeviation = std::function<float(std::uint32_t a, std::uint32_t b, std::uint32_t c, std::uint32_t m)>;

/// Triangles that cover exactly the cells for which is_full is not 0 (cell (u, v) lies between samples (u, v) and
/// (u+1, v+1); the last row and column are ignored), conforming: no corner of one lies inside an edge of another.
/// Along the outline of the full cells every sample is a corner. `deviation` is called from several threads at once.
/// Same result for any number of threads. Cost: about 40 ns of processor time per full cell.
std::vector<SampleTriangle> adaptive_triangles(const Image<std::uint8_t>& is_full, const SampleDeviation& deviation,
                                               Context& context);

}  // namespace lapseam
