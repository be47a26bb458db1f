#pragma once

// Stanford range grids: PLY files with a point per pixel of a scanner's grid.

#include <Eigen/Core>
#include <vector>

#include "io/source.h"

namespace lapseam {

/// One point per pixel, row-major; x is NaN where the scanner saw nothing. Pixel (u, v) is column u of the file, row
/// height − 1 − v: the files' rows run up, ours run down.
struct RangeGrid {
  int width = 0, height = 0;
  std::vector<Eigen::Vector3d> points_m;
};

/// Size from the header alone. Refuses PLY files that hold no range grid.
ImageSize probe_range_grid(const Source& source);
/// ASCII and binary. `scale_m`: metres per stored unit.
RangeGrid read_range_grid(const Source& source, double scale_m);

}  // namespace lapseam
