// nerfstudio's transforms.json with depth images. Cameras look along −z with y up; pixel centres are at 0.5.

#include <array>
#include <cmath>

#include "io/codecs.h"
#include "io/json_object.h"
#include "io/rgbd.h"
#include "io/rigid.h"

namespace lapseam {
namespace {

using nlohmann::json;

constexpr double kPoseTolerance = 1e-3;

/// A key of a frame, or else of the whole document.
class Frame {
 public:
  Frame(const json& document, const json& frame, const Source& source)
      : document_(document), frame_(frame), source_(source) {}

  bool has(const char* key) const { return frame_.contains(key) || document_.contains(key); }

  double number(const char* key) const {
    const json& value = at(key);
    if (!value.is_number() || !std::isfinite(value.get<double>())) source_.refuse(key, "expected a finite number");
    return value.get<double>();
  }
  double number_or(const char* key, double missing) const { return has(key) ? number(key) : missing; }

  std::string text(const char* key) const {
    const json& value = at(key);
    if (!value.is_string()) source_.refuse(key, "expected text");
    return value.get<std::string>();
  }

  Eigen::Isometry3d pose() const {
    const json& rows = at("transform_matrix");
    Eigen::Matrix4d matrix = Eigen::Matrix4d::Identity();
    const bool is_matrix = rows.is_array() && (rows.size() == 4 || rows.size() == 3);
    for (std::size_t row = 0; is_matrix && row < rows.size(); ++row) {
      if (!rows[row].is_array() || rows[row].size() != 4) source_.refuse("transform_matrix", "expected rows of four");
      for (std::size_t column = 0; column < 4; ++column) {
        if (!rows[row][column].is_number()) source_.refuse("transform_matrix", "expected numbers");
        matrix(int(row), int(column)) = rows[row][column].get<double>();
      }
    }
    if (!is_matrix) source_.refuse("transform_matrix", "expected four rows of four numbers");
    matrix.col(1) *= -1;
    matrix.col(2) *= -1;
    return to_rigid(matrix, source_, "transform_matrix", kPoseTolerance);
  }

  PinholeSensor camera() const {
    const std::string model = has("camera_model") ? text("camera_model") : "OPENCV";
    if (model != "OPENCV" && model != "PINHOLE" && model != "SIMPLE_PINHOLE" && model != "OPENCV_FISHEYE")
      source_.refuse("camera_model", "'" + model.substr(0, 40) + "' is not read; PINHOLE and OPENCV are");
    if (model == "OPENCV_FISHEYE" || number_or("k4", 0) != 0)
      source_.refuse("camera_model", "fisheye lenses cannot be read");
    PinholeSensor camera;
    camera.width = pixels("w");
    camera.height = pixels("h");
    camera.fx = number("fl_x");
    camera.fy = number_or("fl_y", camera.fx);
    if (!(camera.fx > 0 && camera.fy > 0)) source_.refuse("fl_x", "must be positive");
    camera.cx = number("cx") - 0.5;
    camera.cy = number("cy") - 0.5;
    camera.distortion = {number_or("k1", 0), number_or("k2", 0), number_or("p1", 0), number_or("p2", 0),
                         number_or("k3", 0)};
    return camera;
  }

 private:
  int pixels(const char* key) const {
    const double value = number(key);
    if (!(value >= 1 && value <= 1 << 30 && value == std::floor(value)))
      source_.refuse(key, "expected a number of pixels");
    return int(value);
  }

  const json& at(const char* key) const {
    if (frame_.contains(key)) return frame_[key];
    if (!document_.contains(key)) source_.refuse(key, "missing");
    return document_[key];
  }

  const json& document_;
  const json& frame_;
  const Source& source_;
};

ViewDraft make_view(const std::filesystem::path& file, const json& document, const json& entry, std::size_t index) {
  Source source{file, "frames[" + std::to_string(index) + "]"};
  if (!entry.is_object()) source.refuse("frames", "expected objects");
  const Frame frame(document, entry, source);
  if (!entry.contains("depth_file_path"))
    source.refuse("depth_file_path", "missing: only frames with a depth image are range images");
  const std::filesystem::path depth_file = file.parent_path() / frame.text("depth_file_path");
  const std::string name = depth_file.stem().string();
  const double scale_m = frame.number_or("depth_unit_scale_factor", 0.001);
  if (!(scale_m > 0)) source.refuse("depth_unit_scale_factor", "must be positive");
  const PinholeSensor camera = frame.camera();
  ViewDraft draft = depth_draft({depth_file, name}, scale_m, camera, frame.pose());
  if (!entry.contains("file_path")) return draft;
  const std::filesystem::path color_file = file.parent_path() / frame.text("file_path");
  // The depth images alone are enough; many tools name colour images that were not copied.
  if (is_there(color_file)) draft.view.color = registered_color({color_file, name}, camera);
  return draft;
}

}  // namespace

bool is_nerfstudio(const std::filesystem::path& file) {
  if (recognise_file(file) != FileKind::kJson) return false;
  const std::string start = read_file_start(file, std::size_t(1) << 20);
  return start.find("\"frames\"") != std::string::npos && start.find("\"lapseam-scene\"") == std::string::npos;
}

Scene read_nerfstudio(const std::filesystem::path& file, const ReadSceneOptions& options, Context& context) {
  const json document = parse_json_file(file);
  const Source source{file, {}};
  if (!document.is_object() || !document.contains("frames") || !document["frames"].is_array())
    source.refuse("frames", "expected a list [ ] of frames");
  SceneBuilder builder(file, options, context);
  builder.set_name(resolved_path(file).parent_path().filename().string());
  const json& frames = document["frames"];
  for (std::size_t i = 0; i < frames.size(); ++i) builder.add([&] { return make_view(file, document, frames[i], i); });
  return builder.finish();
}

}  // namespace lapseam
