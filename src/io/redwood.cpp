// Folders as Redwood (Choi et al. 2015) and Open3D's reconstruction system have them: depth/ and color/ (or rgb/,
// image/), a trajectory (.log) and, mostly, the intrinsics as JSON.

#include <array>
#include <cmath>

#include "io/json_object.h"
#include "io/output_file.h"
#include "io/rgbd.h"
#include "io/rigid.h"
#include "io/text_scan.h"
#include "lapseam/context.h"

namespace lapseam {
namespace {

namespace fs = std::filesystem;

constexpr double kScale_m = 0.001;
// Logs are written with eight digits.
constexpr double kPoseTolerance = 1e-3;

struct LoggedPose {
  std::int64_t frame;
  Eigen::Isometry3d T_world_view;
};

std::vector<LoggedPose> read_log(const Source& source) {
  const std::vector<char> bytes = read_file_bytes(source.file);
  std::string_view rest(bytes.data(), bytes.size());
  std::vector<LoggedPose> poses;
  while (!trim(rest).empty()) {
    const std::string field = "pose " + std::to_string(poses.size() + 1);
    std::array<double, 19> n{};  // three numbers of the frame, 4 × 4 of the pose
    for (double& value : n) {
      const auto number = parse_number<double>(take_word(rest));
      if (!number) source.refuse(field, "expected three numbers and a matrix of 4 x 4");
      value = *number;
    }
    const Eigen::Map<const Eigen::Matrix<double, 4, 4, Eigen::RowMajor>> matrix(n.data() + 3);
    if (!(n[0] >= 0 && n[0] < 1e9)) source.refuse(field, "its frame must be a number that is not negative");
    poses.push_back({std::int64_t(n[0]), to_rigid(matrix, source, field, kPoseTolerance)});
  }
  if (poses.empty()) source.refuse("pose 1", "missing: the trajectory is empty");
  return poses;
}

/// The trajectory of a folder: the one .log that begins like one; empty when there is none or more than one.
fs::path find_log(const fs::path& folder) {
  fs::path found;
  for (const std::string& name : list_files(folder, ".log")) {
    const std::string start = read_file_start(folder / name, 512);
    std::string_view rest = start;
    std::string_view line = take_line(rest);
    std::size_t integers = 0;
    for (std::string_view word = take_word(line); !word.empty(); word = take_word(line))
      integers = parse_number<std::int64_t>(word) ? integers + 1 : 99;
    if (integers != 3) continue;
    if (!found.empty()) return {};
    found = folder / name;
  }
  return found;
}

std::vector<std::string> list_images(const fs::path& folder) {
  std::vector<std::string> names;
  if (!fs::is_directory(folder)) return names;
  for (const char* ending : {".png", ".jpg", ".jpeg"}) {
    names = list_files(folder, ending);
    if (!names.empty()) break;
  }
  return names;
}

std::optional<PinholeSensor> read_intrinsics(const fs::path& folder) {
  for (const char* name : {"camera_intrinsic.json", "intrinsic.json", "intrinsics.json"}) {
    if (!fs::exists(folder / name)) continue;
    const Source source{folder / name, {}};
    const nlohmann::json document = parse_json_file(source.file);
    const JsonObject object(document, source, "",
                            {"width", "height", "intrinsic_matrix", "depth_scale", "stream_length_usec", "fps",
                             "color_format", "depth_format", "device_name", "serial_number"});
    const std::vector<double> k = object.numbers("intrinsic_matrix");
    // By columns: fx 0 0, 0 fy 0, cx cy 1.
    if (k.size() != 9 || !(k[0] > 0 && k[4] > 0) || k[1] != 0 || k[2] != 0 || k[3] != 0 || k[5] != 0 || k[8] != 1)
      object.refuse("intrinsic_matrix", "expected fx, 0, 0, 0, fy, 0, cx, cy, 1");
    return PinholeSensor{object.size_px("width"), object.size_px("height"), k[0], k[4], k[6], k[7], {}};
  }
  return std::nullopt;
}

}  // namespace

bool is_redwood_folder(const fs::path& folder) {
  return fs::is_directory(folder / "depth") && !find_log(folder).empty();
}

Scene read_redwood(const fs::path& folder, const ReadSceneOptions& options, Context& context) {
  SceneBuilder builder(folder, options, context);
  builder.set_name(resolved_path(folder).filename().string());
  const Source log{find_log(folder), {}};
  const std::vector<LoggedPose> poses = read_log(log);
  const std::vector<std::string> depth_names = list_images(folder / "depth");
  fs::path color_folder;
  for (const char* name : {"color", "rgb", "image"})
    if (color_folder.empty() && fs::is_directory(folder / name)) color_folder = folder / name;
  const std::vector<std::string> color_names = list_images(color_folder);
  const PinholeSensor camera = read_intrinsics(folder).value_or(
      PinholeSensor{640, 480, kDefaultFocal_px, kDefaultFocal_px, kDefaultCx_px, kDefaultCy_px, {}});
  for (const LoggedPose& pose : poses) {
    builder.add([&] {
      const auto frame = std::size_t(pose.frame);
      if (frame >= depth_names.size())
        log.refuse("frame " + std::to_string(frame),
                   "the folder has " + std::to_string(depth_names.size()) + " depth images");
      const Source depth{folder / "depth" / depth_names[frame], fs::path(depth_names[frame]).stem().string()};
      ViewDraft draft = depth_draft(depth, kScale_m, camera, pose.T_world_view);
      if (color_names.size() == depth_names.size())
        draft.view.color = registered_color({color_folder / color_names[frame], depth.view},
                                            std::get<PinholeSensor>(*draft.view.sensor));
      return draft;
    });
  }
  return builder.finish();
}

}  // namespace lapseam
