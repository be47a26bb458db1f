#pragma once

// What the readers of RGB-D folders share.

#include <cstdint>
#include <vector>

#include "io/scene_formats.h"

namespace lapseam {

/// Whether a file that another file names is there. Names in damaged files may be such that the system refuses to look,
/// too long for one: then it is not.
inline bool is_there(const std::filesystem::path& file) {
  std::error_code ignored;
  return std::filesystem::exists(file, ignored);
}
inline bool is_regular(const std::filesystem::path& file) {
  std::error_code ignored;
  return std::filesystem::is_regular_file(file, ignored);
}

/// All numbers of a small text file; there must be `count`.
std::vector<double> read_numbers(const Source& source, const std::string& field, std::size_t count);

/// The same optics at another resolution: both show the same field.
PinholeSensor resized(const PinholeSensor& sensor, ImageSize size);

/// A colour image that shows what the depth camera sees, at any resolution.
ColorSource registered_color(const Source& source, const PinholeSensor& depth_camera);

/// A draft of a view with a 16-bit PNG or .npy along z, whose camera has the size of the image.
ViewDraft depth_draft(const Source& depth, double scale_m, const PinholeSensor& camera,
                      const Eigen::Isometry3d& T_world_view);

/// Unit quaternion and position, checked; `field` for errors.
Eigen::Isometry3d to_pose(const Source& source, const std::string& field, const Eigen::Vector3d& t, double qw,
                          double qx, double qy, double qz);

/// Focal lengths and principal point where no file says otherwise: what PrimeSense cameras are taken to have.
inline constexpr double kDefaultFocal_px = 525, kDefaultCx_px = 319.5, kDefaultCy_px = 239.5;

}  // namespace lapseam
