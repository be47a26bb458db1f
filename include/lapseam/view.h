#pragma once

// Views and scenes: what was measured, from where, and which files hold it.

#include <Eigen/Geometry>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "lapseam/image.h"
#include "lapseam/noise.h"
#include "lapseam/sensor.h"

namespace lapseam {

enum class RangeFormat { kPng16, kExr, kStanfordGrid, kMemory };
/// What a stored value means for a pinhole or spherical sensor; converted to the sensor's own r when loaded.
enum class RangeQuantity { kZ, kDistance };

/// The range image of one view, not yet loaded.
struct RangeSource {
  RangeFormat format = RangeFormat::kPng16;
  std::filesystem::path file;
  RangeQuantity quantity = RangeQuantity::kZ;
  double scale_m = 1.0;                      ///< metres per stored unit
  std::vector<double> invalid_values;        ///< stored values that mean "no sample", beside 0, negative and non-finite
  std::string channel;                       ///< EXR channel; empty: "R"-less search for Z, range, depth, Y
  std::shared_ptr<const RangeImage> memory;  ///< for kMemory
};

/// The colour image of one view: its file and the camera that took it.
struct ColorSource {
  std::filesystem::path file;                                      ///< EXR, PNG or JPEG
  Sensor camera;                                                   ///< its width and height are the image's
  Eigen::Isometry3d T_view_color = Eigen::Isometry3d::Identity();  ///< colour camera frame -> view (range sensor) frame
  std::shared_ptr<const ColorImage> memory;                        ///< used instead of the file when set
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
  std::optional<NoiseModel> noise;
};

struct Scene {
  std::string name;
  std::filesystem::path file;  ///< manifest, .conf or folder it came from
  std::vector<ViewSource> views;
};

/// One view, loaded.
struct View {
  std::string name;
  std::string sensor_id;
  Sensor sensor;
  RangeImage range;
  Eigen::Isometry3d T_world_view = Eigen::Isometry3d::Identity();
};

}  // namespace lapseam
