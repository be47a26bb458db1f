#pragma once

// Scanners' files give a point per pixel and say nothing of the sensor. This finds it: a pinhole or a polar scanner
// where one explains the points, else a measured grid.

#include <Eigen/Core>
#include <functional>

#include "io/source.h"
#include "lapseam/context.h"
#include "lapseam/sensor.h"
#include "lapseam/view.h"

namespace lapseam {

/// One return of a scanner, at its pixel, in the scanner's frame. Files hold Cartesian or polar coordinates; what is
/// stored is kept, so that it comes back to the last bit, and the other is worked out when it is asked for.
struct GridSample {
  int u = 0, v = 0;
  bool is_polar = false;
  Eigen::Vector3d stored;  ///< x, y, z in metres; polar: azimuth, elevation (radians), distance in metres

  Eigen::Vector3d point_m() const;
  Eigen::Vector3d polar() const;
  double distance_m() const { return is_polar ? stored.z() : stored.norm(); }
};

/// Calls the function once per sample, always in the same order.
using VisitSample = std::function<void(const GridSample&)>;
using ForEachSample = std::function<void(const VisitSample&)>;

/// Samples in pieces that may be visited side by side. No two samples of several pieces share a pixel.
struct SamplePieces {
  std::size_t count = 1;
  std::function<void(std::size_t piece, const VisitSample&)> visit;
};

/// The sensor whose pixels the samples are. The same for any number of threads. Passes over the samples once; twice
/// where the polar grid is not exact (each pixel then has its own direction) or no regular sensor fits. Memory is rows
/// and columns, in the second case 8 bytes, in the third 24 bytes a pixel.
Sensor fit_grid_sensor(const Source& source, ImageSize size, const SamplePieces& samples, Context& context);

/// A polar grid for points that have none: steps as wide as the points lie apart, nearest points first where several
/// share a pixel. u and v of the samples are filled; a sample that lost its pixel to a nearer one gets u = −1.
/// The points then keep their exact directions. Refuses fewer than 16 samples.
SphericalSensor make_polar_grid(const Source& source, std::vector<GridSample>& samples);

/// The range that a sensor found by fit_grid_sensor has for a sample; 0 where it can have none.
float range_of(const Sensor& sensor, const GridSample& sample);

}  // namespace lapseam
