#pragma once

// Sensors and poses as attributes of an EXR header, both ways.

#include <ImfHeader.h>

#include "io/exr.h"

namespace lapseam {

inline constexpr const char* kWarpUChannel = "lapseam.warpU";
inline constexpr const char* kWarpVChannel = "lapseam.warpV";

/// Reads our own attributes, and OpenEXR's standard ones where ours are missing, into header.sensor, .T_world_view,
/// .quantity and .is_measured_grid; header.size and .channels are there already.
void read_attributes(const Source& source, const Imf::Header& attributes, ExrHeader& header);
/// All of a measured-grid sensor but its warp.
MeasuredGridSensor read_measured_grid_attributes(const Source& source, const Imf::Header& attributes, ImageSize size);

void write_attributes(const Sensor& sensor, const Eigen::Isometry3d& T_world_view, Imf::Header& attributes);

}  // namespace lapseam
