#pragma once

// Sensor models. Each maps a sample (u, v, r) to a point in the sensor's own frame and back:
//   unproject(u, v, r) -> p        project(p) -> (u, v, r)
// are exact inverses (to rounding) inside the image. u runs along columns, v along rows, pixel centres at integers,
// so the image covers [-0.5, width - 0.5] × [-0.5, height - 0.5]. Metres and radians.
// What r is differs: see each model. r grows along the measurement ray, and is > 0 for every point that has one.

#include <Eigen/Core>
#include <array>
#include <cmath>
#include <memory>
#include <optional>
#include <string_view>
#include <variant>
#include <vector>

#include "lapseam/image.h"

namespace lapseam {

/// Where a point falls in an image, and its range there.
struct PixelRange {
  double u = 0, v = 0, r = 0;
};

/// Brown's radial and tangential lens distortion (Brown 1971, OpenCV's order of coefficients).
struct BrownDistortion {
  double k1 = 0, k2 = 0, p1 = 0, p2 = 0, k3 = 0;
  bool is_zero() const { return k1 == 0 && k2 == 0 && p1 == 0 && p2 == 0 && k3 == 0; }

  /// Ideal to distorted coordinates on the plane z = 1. False where the model folds over: there, points farther from
  /// the axis would land nearer to it.
  bool distort(double& x, double& y) const;
  /// The inverse, to rounding. Coordinates that no ray reaches give the edge of the fold on the way there.
  void undistort(double& x, double& y) const;
};

/// Perspective camera, x right, y down, z forward. r is z, the depth along the optical axis.
struct PinholeSensor {
  int width = 0, height = 0;
  double fx = 0, fy = 0, cx = 0, cy = 0;
  BrownDistortion distortion;

  Eigen::Vector3d unproject(double u, double v, double r) const;
  /// False for points at or behind the camera plane (z not above zero), or where the distortion model folds over.
  bool project(const Eigen::Vector3d& p, PixelRange& out) const;
};

/// Polar laser scanner, z up: direction (cos el cos az, cos el sin az, sin el). r is the distance from the origin.
/// One azimuth per column and one elevation per row; both tables strictly monotone (either way). Between samples the
/// angles are interpolated linearly, beyond the ends extrapolated by half a step.
/// Real scanners do not hit such a grid exactly: where a warp is given, pixel (u, v) looks where the tables look at
/// (u, v) + warp. project() then finds the pixel by search, as for measured grids.
struct SphericalSensor {
  std::vector<double> azimuth_rad;    ///< size width
  std::vector<double> elevation_rad;  ///< size height
  /// Pixels, row-major, size width·height; null: none. Shared, as copies of a sensor are many and warps are large.
  std::shared_ptr<const std::vector<Eigen::Vector2f>> warp = nullptr;

  /// Angles of the outer *edges* of the image: column u is centred at az_begin + (u + 0.5) / width · (az_end −
  /// az_begin).
  static SphericalSensor from_limits(int width, int height, double az_begin_rad, double az_end_rad, double el_begin_rad,
                                     double el_end_rad);

  int columns() const { return int(azimuth_rad.size()); }
  int rows() const { return int(elevation_rad.size()); }
  /// True when the last column is followed by the first: the table covers the full circle to within half a step.
  bool wraps() const;

  Eigen::Vector3d unproject(double u, double v, double r) const;
  /// False at the origin and for directions outside the table.
  bool project(const Eigen::Vector3d& p, PixelRange& out) const;
};

/// Parallel rays along +z, x right, y down: p = ((u − cx)·pitch_x, (v − cy)·pitch_y, r). r is z.
struct OrthographicSensor {
  int width = 0, height = 0;
  double pitch_x_m = 0, pitch_y_m = 0;
  double cx = 0, cy = 0;

  Eigen::Vector3d unproject(double u, double v, double r) const;
  /// False where z is not above zero.
  bool project(const Eigen::Vector3d& p, PixelRange& out) const;
};

/// A scanner known only by its samples: a 3D point per pixel (Stanford range grids, organised clouds).
/// A rational projection is fitted to the points, q(p) = (n_u(p)/d_u(p), n_v(p)/d_v(p)) with n, d affine in p: it holds
/// perspective, orthographic and push-broom geometry (perspective in one direction only), the latter being what the
/// Cyberware scanners of the Stanford models are. What the fit leaves over is kept as a warp table q(u, v), so that
/// project() is exact at the samples; between them the warp is bilinear and is inverted by search.
/// r is the coordinate along `forward`, shifted so that it is positive.
struct MeasuredGridSensor {
  int width = 0, height = 0;
  /// n_u, d_u, n_v, d_v: rows of (x, y, z, 1).
  std::array<Eigen::Vector4d, 4> rational;
  /// Mean viewing direction, unit length; points away from the sensor.
  Eigen::Vector3d forward = Eigen::Vector3d::UnitZ();
  double range_offset_m = 0;          ///< r = forward · p + range_offset_m
  std::vector<Eigen::Vector2f> warp;  ///< q at each pixel minus (u, v); size width·height; filled at invalid pixels
  double fit_rms_px = 0;              ///< what the rational fit left over

  Eigen::Vector3d unproject(double u, double v, double r) const;
  /// False where r is not above zero, or behind the point or line through which the rays pass.
  bool project(const Eigen::Vector3d& p, PixelRange& out) const;
};

using Sensor = std::variant<PinholeSensor, SphericalSensor, OrthographicSensor, MeasuredGridSensor>;

/// Fits a measured-grid sensor to one point per pixel, and gives the range image that goes with it.
/// points_m: width·height, row-major, in the sensor frame; a non-finite x marks a pixel without a sample.
/// toward_scene: any direction with a positive component along the viewing direction (tells front from back).
/// Throws InvalidInput (empty file and view) when fewer than 16 samples, or samples that fix no projection.
struct MeasuredGrid {
  MeasuredGridSensor sensor;
  RangeImage range;
};
MeasuredGrid fit_measured_grid(int width, int height, const std::vector<Eigen::Vector3d>& points_m,
                               const Eigen::Vector3d& toward_scene);

// ---- generic access; for loops over pixels prefer one std::visit outside the loop
int width(const Sensor& sensor);
int height(const Sensor& sensor);
/// "pinhole", "spherical", "orthographic", "measured_grid".
std::string_view kind_name(const Sensor& sensor);
bool wraps(const Sensor& sensor);
/// All rays pass through one point; then a plane makes the inverse range affine in pixel coordinates.
bool is_central(const Sensor& sensor);
Eigen::Vector3d unproject(const Sensor& sensor, double u, double v, double r);
std::optional<PixelRange> project(const Sensor& sensor, const Eigen::Vector3d& p);
/// Unit vector of the measurement ray through (u, v), away from the sensor.
Eigen::Vector3d ray_direction(const Sensor& sensor, double u, double v);
/// +1 when (u, v, ray) is right-handed as in an ordinary photograph, −1 when the image is mirrored (azimuth growing
/// with u). Decides the winding of triangles.
int handedness(const Sensor& sensor);
/// Distance in metres between neighbouring samples of a surface that faces the sensor at range r, at (u, v):
/// the geometric mean of the column and row directions.
double sample_spacing(const Sensor& sensor, double u, double v, double r);
/// The same in the middle of the image, as a line over range: offset + slope · r. Of tables of angles, the mean steps
/// count: those in the middle may be few and uneven.
struct SpacingLine {
  double offset_m = 0, slope = 0;
  double at(double r) const { return offset_m + slope * r; }
};
SpacingLine spacing_line(const Sensor& sensor);

// ---- the models that loops over pixels call most, for the compiler to see through

inline Eigen::Vector3d PinholeSensor::unproject(double u, double v, double r) const {
  double x = (u - cx) / fx, y = (v - cy) / fy;
  if (!distortion.is_zero()) distortion.undistort(x, y);
  return {x * r, y * r, r};
}

inline bool PinholeSensor::project(const Eigen::Vector3d& p, PixelRange& out) const {
  if (!(p.z() > 0)) return false;
  double x = p.x() / p.z(), y = p.y() / p.z();
  if (!distortion.is_zero() && !distortion.distort(x, y)) return false;
  out = {fx * x + cx, fy * y + cy, p.z()};
  return std::isfinite(out.u + out.v + out.r);
}

inline Eigen::Vector3d OrthographicSensor::unproject(double u, double v, double r) const {
  return {(u - cx) * pitch_x_m, (v - cy) * pitch_y_m, r};
}

inline bool OrthographicSensor::project(const Eigen::Vector3d& p, PixelRange& out) const {
  if (!(p.z() > 0)) return false;
  out = {p.x() / pitch_x_m + cx, p.y() / pitch_y_m + cy, p.z()};
  return std::isfinite(out.u + out.v + out.r);
}

}  // namespace lapseam
