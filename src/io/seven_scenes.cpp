// Folders of frame-NNNNNN.{depth.png,pose.txt,color.png or color.jpg}, as the 7-Scenes data set has them (Shotton et
// al., "Scene Coordinate Regression Forests for Camera Relocalization in RGB-D Images", 2013).

#include <algorithm>
#include <cmath>

#include "io/codecs.h"
#include "io/rgbd.h"
#include "io/rigid.h"
#include "io/scene_formats.h"

namespace lapseam {
namespace {

constexpr const char* kDepthEnding = ".depth.png";
constexpr const char* kIntrinsicsFile = "camera-intrinsics.txt";
// The tracker of the data set lets the scale of its rotations drift, to 1.2e-4 in 500 frames.
constexpr double kPoseTolerance = 1e-3;

struct Intrinsics {
  double fx = 585, fy = 585, cx = 320, cy = 240;  ///< of the data set's Kinect, where no file says otherwise
};

Intrinsics read_intrinsics(const std::filesystem::path& folder) {
  const Source source{folder / kIntrinsicsFile, {}};
  if (!std::filesystem::exists(source.file)) return {};
  const std::vector<double> k = read_numbers(source, "intrinsics", 9);
  for (const double number : k)
    if (!std::isfinite(number)) source.refuse("intrinsics", "a number is not finite");
  const bool has_shape = k[0] > 0 && k[4] > 0 && k[1] == 0 && k[3] == 0 && k[6] == 0 && k[7] == 0 && k[8] == 1;
  if (!has_shape) source.refuse("intrinsics", "expected the rows fx 0 cx, 0 fy cy, 0 0 1");
  return {k[0], k[4], k[2], k[5]};
}

Eigen::Isometry3d read_pose(const Source& source) {
  if (!std::filesystem::exists(source.file)) source.refuse("pose", "no such file");
  const std::vector<double> numbers = read_numbers(source, "pose", 16);
  const Eigen::Map<const Eigen::Matrix<double, 4, 4, Eigen::RowMajor>> matrix(numbers.data());
  return to_rigid(matrix, source, "pose", kPoseTolerance);
}

ViewDraft make_view(const std::filesystem::path& folder, const std::string& name, const Intrinsics& k) {
  ViewDraft draft;
  ViewSource& view = draft.view;
  view.name = name;
  view.sensor_id = "depth";
  view.T_world_view = read_pose({folder / (name + ".pose.txt"), name});
  draft.has_pose = true;
  view.range.file = folder / (name + kDepthEnding);
  view.range.format = RangeFormat::kPng16;
  view.range.scale_m = 0.001;
  view.range.invalid_values = {65535};
  const ImageSize size = probe_png({view.range.file, name}).size;
  const PinholeSensor camera{size.width, size.height, k.fx, k.fy, k.cx, k.cy, {}};
  view.sensor = camera;
  for (const char* ending : {".color.png", ".color.jpg", ".color.jpeg"}) {
    const std::filesystem::path file = folder / (name + ending);
    if (!std::filesystem::exists(file)) continue;
    view.color = registered_color({file, name}, camera);
    break;
  }
  return draft;
}

}  // namespace

bool is_seven_scenes_folder(const std::filesystem::path& folder) {
  const std::vector<std::string> names = list_files(folder, kDepthEnding);
  return std::any_of(names.begin(), names.end(), [](const std::string& name) { return name.starts_with("frame-"); });
}

Scene read_seven_scenes(const std::filesystem::path& folder, const ReadSceneOptions& options, Context& context) {
  SceneBuilder builder(folder, options, context);
  builder.set_name(resolved_path(folder).filename().string());
  const Intrinsics intrinsics = read_intrinsics(folder);
  for (const std::string& file_name : list_files(folder, kDepthEnding)) {
    if (!file_name.starts_with("frame-")) continue;
    const std::string name = file_name.substr(0, file_name.size() - std::string_view(kDepthEnding).size());
    builder.add([&] { return make_view(folder, name, intrinsics); });
  }
  return builder.finish();
}

}  // namespace lapseam
