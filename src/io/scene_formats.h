#pragma once

// The kinds of scenes, and what their readers share.

#include <functional>
#include <string>
#include <vector>

#include "io/source.h"
#include "lapseam/io.h"

namespace lapseam {

/// A view on its way into a scene, and what its scene file has left for the range file to say.
struct ViewDraft {
  ViewSource view;
  bool has_pose = false;      ///< T_world_view is given
  bool has_quantity = false;  ///< range.quantity is given
  bool has_scale = true;      ///< range.scale_m is given
};

/// Collects the views of a scene. A view that cannot be used ends the reading, or is left out with a warning.
class SceneBuilder {
 public:
  SceneBuilder(const std::filesystem::path& file, const ReadSceneOptions& options, Context& context);

  /// Calls make() for a draft, completes it from its files' headers (format, sensor, pose, sizes), and keeps it.
  void add(const std::function<ViewDraft()>& make);
  void set_name(std::string name) { scene_.name = std::move(name); }
  /// Gives views without a sensor id one; throws InvalidInput when there is no view.
  Scene finish();

 private:
  void check_name(const ViewSource& view) const;
  void assign_sensor_ids();

  Scene scene_;
  ReadSceneOptions options_;
  Context& context_;
  std::string first_problem_;
};

Scene read_manifest(const std::filesystem::path& file, const ReadSceneOptions& options, Context& context);
Scene read_stanford_conf(const std::filesystem::path& file, const ReadSceneOptions& options, Context& context);
/// One range grid alone, at the world's origin.
Scene read_single_range_grid(const std::filesystem::path& file, const ReadSceneOptions& options, Context& context);
bool is_seven_scenes_folder(const std::filesystem::path& folder);
Scene read_seven_scenes(const std::filesystem::path& folder, const ReadSceneOptions& options, Context& context);
/// TUM RGB-D: depth.txt, groundtruth.txt, and, if there are any, rgb.txt and calibration.txt.
bool is_tum_folder(const std::filesystem::path& folder);
Scene read_tum(const std::filesystem::path& folder, const ReadSceneOptions& options, Context& context);
/// Redwood, Open3D: a trajectory (.log) beside depth/ and color/.
bool is_redwood_folder(const std::filesystem::path& folder);
Scene read_redwood(const std::filesystem::path& folder, const ReadSceneOptions& options, Context& context);
/// nerfstudio: a JSON file with frames.
bool is_nerfstudio(const std::filesystem::path& file);
Scene read_nerfstudio(const std::filesystem::path& file, const ReadSceneOptions& options, Context& context);
/// COLMAP: a model (cameras and images, text or binary) and stereo/depth_maps.
bool is_colmap_folder(const std::filesystem::path& folder);
Scene read_colmap(const std::filesystem::path& folder, const ReadSceneOptions& options, Context& context);
/// EXR files that hold sensor and pose; named after the files.
Scene read_exr_files(const std::filesystem::path& path, const std::vector<std::filesystem::path>& files,
                     const ReadSceneOptions& options, Context& context);

/// The path without links and dots, for names of scenes; as it is where that cannot be found out.
std::filesystem::path resolved_path(const std::filesystem::path& path);
/// Names of the entries of a folder that are files and end so, sorted.
std::vector<std::string> list_files(const std::filesystem::path& folder, const std::string& ending);

bool is_same_sensor(const Sensor& a, const Sensor& b);
bool is_same_noise(const NoiseModel& a, const NoiseModel& b);

/// Sensor ids of formats without names for sensors: views with equal ids share one noise model.
inline constexpr const char* kRangeGridSensorId = "range_grid";

}  // namespace lapseam
