#pragma once

// OpenEXR range and colour images, with the sensor and the pose in attributes (docs/formats.md, "OpenEXR").

#include <Eigen/Geometry>
#include <optional>
#include <string>
#include <vector>

#include "io/source.h"
#include "lapseam/image.h"
#include "lapseam/view.h"

namespace lapseam {

/// What the header of an EXR file says; nothing of it is needed by all files.
struct ExrHeader {
  ImageSize size;
  std::vector<std::string> channels;
  bool has_rgb = false;
  bool is_measured_grid = false;  ///< the sensor needs pixels too: read_exr_measured_grid
  std::optional<Sensor> sensor;
  std::optional<Eigen::Isometry3d> T_world_view;
  std::optional<RangeQuantity> quantity;
};
ExrHeader read_exr_header(const Source& source);

/// The channel that holds ranges: `wanted` when it is not empty, else the first of range, Z, depth, Y, or the only one.
std::string choose_range_channel(const Source& source, const std::vector<std::string>& channels,
                                 const std::string& wanted);

/// Stored values, unscaled.
Image<float> read_exr_range(const Source& source, const std::string& wanted_channel);
/// R, G, B (or Y alone, grey), linear light, to 8-bit sRGB; alpha is ignored.
ColorImage read_exr_color(const Source& source);
MeasuredGridSensor read_exr_measured_grid(const Source& source);

}  // namespace lapseam
