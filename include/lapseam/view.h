#pragma once

// Views and scenes: what was measured, from where, and which files hold it.

#include <Eigen/Geometry>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "lapseam/image.h"
#include "lapseam/noise.h"
#include "lapseam/sensor.h"

namespace lapseam {

enum class RangeFormat { kPng16, kExr, kStanfordGrid, kMemory, kE57, kPtx, kPcd, kSens, kColmapDepth, kNpy };
/// What a stored value means for a pinhole or spherical sensor; converted to the sensor's own r when loaded.
enum class RangeQuantity { kZ, kDistance };

/// The range image of one view, not yet loaded.
struct RangeSource {
  RangeFormat format = RangeFormat::kPng16;
  std::filesystem::path file;
  std::uint32_t index = 0;   ///< which scan or frame of a file that holds several (E57, PTX, .sens)
  std::uint64_t offset = 0;  ///< where in the file that one begins, where the format does not tell (PTX, .sens); bytes
  RangeQuantity quantity = RangeQuantity::kZ;
  double scale_m = 1.0;                      ///< metres per stored unit
  std::vector<double> invalid_values;        ///< stored values that mean "no sample", beside 0, negative and non-finite
  std::string channel;                       ///< EXR channel; empty: "R"-less search for Z, range, depth, Y
  std::shared_ptr<const RangeImage> memory;  ///< for kMemory
  /// An image of the intensity that the sensor itself received, pixel for pixel; scans (E57, PTX) have it inside.
  std::filesystem::path intensity_file;
};

inline constexpr std::uint32_t kImageOfFile = 0x80000000u;
/// The colour image of one view: its file and the camera that took it.
struct ColorSource {
  std::filesystem::path file;                                      ///< an image (EXR, PNG, JPEG), or a file of scans
  Sensor camera;                                                   ///< its width and height are the image's
  Eigen::Isometry3d T_view_color = Eigen::Isometry3d::Identity();  ///< colour camera frame -> view (range sensor) frame
  std::shared_ptr<const ColorImage> memory;                        ///< used instead of the file when set
  /// Which scan's own colours, or which frame (E57, PTX, PCD, .sens); kImageOfFile + n: the n-th image of an E57 file.
  std::uint32_t index = 0;
  std::uint64_t offset = 0;  ///< as in RangeSource
};

/// How uncertain a pose is: dx, dy, dz in metres, then rx, ry, rz in radians, all along the world's axes. The true pose
/// is the given one turned by r about the view's own origin and shifted by d.
using PoseCovariance = Eigen::Matrix<double, 6, 6>;

/// One view as a scene lists it: nothing loaded yet.
struct ViewSource {
  std::string name;
  /// Absent when the range file itself holds it (measured grids, EXR with sensor attributes).
  std::optional<Sensor> sensor;
  /// Views with the same sensor id share one noise model.
  std::string sensor_id;
  Eigen::Isometry3d T_world_view = Eigen::Isometry3d::Identity();
  std::optional<PoseCovariance> pose_covariance;  ///< as registration left it
  RangeSource range;
  std::optional<ColorSource> color;
  /// Further images, where `color` is one (E57 files have several for a scan); texture() chooses among them all.
  std::vector<ColorSource> more_colors;
  std::optional<NoiseModel> noise;
};

struct Scene {
  std::string name;
  std::filesystem::path file;  ///< manifest, .conf or folder it came from
  std::vector<ViewSource> views;
};

/// Pixels without a sample, by what the file says of them, and points that found no pixel.
struct MissingSamples {
  std::uint64_t zero = 0;        ///< a range of 0, or the point (0, 0, 0)
  std::uint64_t negative = 0;    ///< a range below 0
  std::uint64_t not_finite = 0;  ///< NaN, infinite, or beyond what a float holds
  std::uint64_t named = 0;       ///< a value that the format or the scene names (65535, say)
  std::uint64_t flagged = 0;     ///< the file's invalid state says so (E57)
  std::uint64_t absent = 0;      ///< the file has no record for the pixel
  std::uint64_t surplus = 0;     ///< points beyond the first of a pixel; not pixels
};

/// One view, loaded.
struct View {
  std::string name;
  std::string sensor_id;
  Sensor sensor;
  RangeImage range;
  Eigen::Isometry3d T_world_view = Eigen::Isometry3d::Identity();
  MissingSamples missing = {};
  /// As received with each range, 0 to 255 of what the sensor distinguishes; empty where the scene has none.
  Image<std::uint8_t> intensity = {};
};

}  // namespace lapseam
