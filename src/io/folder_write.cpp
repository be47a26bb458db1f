// Folders of images, writing: our manifest with EXR, and the layouts of RGB-D tools (TUM, Redwood and Open3D,
// nerfstudio), which hold 16-bit depth along z of one pinhole camera, and colours in its pixels.

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <mutex>
#include <nlohmann/json.hpp>

#include "io/number_text.h"
#include "io/output_file.h"
#include "io/scene_formats.h"
#include "io/scene_writer.h"
#include "lapseam/io.h"

namespace lapseam {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

void make_folder(const fs::path& folder) {
  std::error_code error;
  fs::create_directories(folder, error);
  if (error) throw IoError(folder, "cannot make this folder: " + error.message());
}

/// The image as it is where it is a PNG or JPEG file of its own, else as PNG. Gives the file's name.
std::string write_color(const LoadedView& loaded, const fs::path& folder, const std::string& stem) {
  const ColorSource& color = *loaded.source.color;
  const FileKind kind = color.memory ? FileKind::kUnknown : recognise_file(color.file);
  if (kind != FileKind::kPng && kind != FileKind::kJpeg) {
    write_png(folder / (stem + ".png"), *loaded.color);
    return stem + ".png";
  }
  const std::string name = stem + (kind == FileKind::kPng ? ".png" : ".jpg");
  const std::vector<char> bytes = read_file_bytes(color.file);
  OutputFile out(folder / name);
  out.write(bytes.data(), bytes.size());
  out.commit();
  return name;
}

class ManifestWriter : public SceneWriter {
 public:
  explicit ManifestWriter(const fs::path& folder) : folder_(folder) {
    make_folder(folder / "range");
    scene_.file = folder / "scene.json";
  }

  void write_files(const LoadedView& loaded) override {
    // Where every pixel has numbers of its own, no manifest can hold the colour camera; the file of the ranges does.
    const ColorImage* inside = holds_color(loaded) ? &*loaded.color : nullptr;
    write_range_exr(range_file(loaded), loaded.view.range, loaded.view.sensor, loaded.view.T_world_view, inside);
    if (!loaded.view.intensity.pixels.empty()) write_png8(intensity_file(loaded), loaded.view.intensity);
    if (!loaded.color || inside) return;
    make_folder(folder_ / "color");
    const std::string name = write_color(loaded, folder_ / "color", loaded.file_stem);
    const std::lock_guard lock(mutex_);
    color_names_[loaded.file_stem] = name;
  }

  void add(const LoadedView& loaded) override {
    ViewSource view = loaded.source;
    view.sensor = loaded.view.sensor;
    const bool is_spherical = std::holds_alternative<SphericalSensor>(loaded.view.sensor);
    view.range = RangeSource{};
    view.range.format = RangeFormat::kExr;
    view.range.file = range_file(loaded);
    if (!loaded.view.intensity.pixels.empty()) view.range.intensity_file = intensity_file(loaded);
    view.range.quantity = is_spherical ? RangeQuantity::kDistance : RangeQuantity::kZ;
    if (loaded.color) {
      view.color->file =
          holds_color(loaded) ? range_file(loaded) : folder_ / "color" / color_names_.at(loaded.file_stem);
      view.color->memory.reset();
      view.color->index = 0;
      view.color->offset = 0;
    }
    scene_.views.push_back(std::move(view));
  }

  void finish() override { write_scene(scene_, scene_.file); }

 private:
  fs::path range_file(const LoadedView& loaded) const { return folder_ / "range" / (loaded.file_stem + ".exr"); }

  fs::path intensity_file(const LoadedView& loaded) const {
    return folder_ / "range" / (loaded.file_stem + "-intensity.png");
  }

  static bool holds_color(const LoadedView& loaded) {
    const auto* spherical = std::get_if<SphericalSensor>(&loaded.view.sensor);
    const bool is_own =
        std::holds_alternative<MeasuredGridSensor>(loaded.view.sensor) || (spherical && spherical->warp);
    return is_own && has_registered_color(loaded);
  }

  fs::path folder_;
  Scene scene_;
  std::mutex mutex_;
  std::map<std::string, std::string> color_names_;
};

/// What the layouts of RGB-D tools share.
class RgbdWriter : public SceneWriter {
 public:
  RgbdWriter(const fs::path& folder, const char* format, double units_per_m, const char* color_folder, Context& context)
      : folder_(folder), format_(format), units_per_m_(units_per_m), color_folder_(color_folder), context_(context) {
    make_folder(folder_ / "depth");
  }

  void write_files(const LoadedView& loaded) override {
    camera_of(loaded);
    Image<std::uint16_t> depth(loaded.view.range.width, loaded.view.range.height);
    std::size_t beyond = 0;
    for (std::size_t i = 0; i < depth.size(); ++i) {
      const double stored = std::round(double(loaded.view.range.pixels[i]) * units_per_m_);
      beyond += stored > kLargest;
      depth.pixels[i] = stored > kLargest ? std::uint16_t(0) : std::uint16_t(stored);
    }
    write_png16(folder_ / "depth" / (stem_of(loaded) + ".png"), depth);
    if (beyond > 0)
      context_.warn("view " + loaded.view.name + ": " + std::to_string(beyond) + " samples beyond " +
                    number_text(kLargest / units_per_m_) + " m do not fit into 16 bits and are left out");
    if (!loaded.color) return;
    if (!has_registered_color(loaded)) {
      context_.warn("view " + loaded.view.name + ": its colour camera is not its depth camera, which a " +
                    std::string(format_) + " folder cannot say; colour is left out");
      return;
    }
    make_folder(folder_ / color_folder_);
    const std::string name = write_color(loaded, folder_ / color_folder_, stem_of(loaded));
    const std::lock_guard lock(mutex_);
    color_names_[loaded.file_stem] = name;
  }

 protected:
  const PinholeSensor& camera_of(const LoadedView& loaded) const {
    const auto* pinhole = std::get_if<PinholeSensor>(&loaded.view.sensor);
    if (!pinhole)
      throw InvalidInput(
          folder_, loaded.view.name, "sensor",
          "is " + std::string(kind_name(loaded.view.sensor)) + "; a " + format_ + " folder holds pinhole cameras");
    return *pinhole;
  }

  /// For layouts with one camera for all views, and no lens.
  void check_same_camera(const LoadedView& loaded) {
    const PinholeSensor& camera = camera_of(loaded);
    if (!camera.distortion.is_zero())
      throw InvalidInput(folder_, loaded.view.name, "sensor.distortion",
                         std::string("cannot be written: a ") + format_ + " folder has none");
    if (camera_ && !is_same_sensor(Sensor(*camera_), Sensor(camera)))
      throw InvalidInput(folder_, loaded.view.name, "sensor",
                         std::string("differs from the first view's; a ") + format_ + " folder has one camera");
    camera_ = camera;
  }

  virtual std::string stem_of(const LoadedView& loaded) const { return loaded.file_stem; }

  /// Empty without colour.
  std::string color_file(const LoadedView& loaded) const {
    const auto found = color_names_.find(loaded.file_stem);
    return found == color_names_.end() ? "" : std::string(color_folder_) + "/" + found->second;
  }

  static constexpr double kLargest = 65534;  // 65535 is "no sample" to some
  fs::path folder_;
  const char* format_;
  double units_per_m_;
  const char* color_folder_;
  Context& context_;
  std::optional<PinholeSensor> camera_;

 private:
  std::mutex mutex_;
  std::map<std::string, std::string> color_names_;
};

class TumWriter : public RgbdWriter {
 public:
  TumWriter(const fs::path& folder, Context& context) : RgbdWriter(folder, "TUM", 5000, "rgb", context) {}

  void add(const LoadedView& loaded) override {
    check_same_camera(loaded);
    // There are no times: a frame takes a second.
    const std::string stamp = std::to_string(++count_) + ".000000";
    depth_ += stamp + " depth/" + stem_of(loaded) + ".png\n";
    if (const std::string color = color_file(loaded); !color.empty()) rgb_ += stamp + " " + color + "\n";
    const Eigen::Quaterniond q(loaded.view.T_world_view.linear());
    const Eigen::Vector3d t = loaded.view.T_world_view.translation();
    poses_ += stamp;
    for (const double value : {t.x(), t.y(), t.z(), q.x(), q.y(), q.z(), q.w()}) poses_ += " " + number_text(value);
    poses_ += "\n";
  }

  void finish() override {
    const PinholeSensor& k = camera_.value();
    write_text(folder_ / "calibration.txt",
               number_text(k.fx) + " " + number_text(k.fy) + " " + number_text(k.cx) + " " + number_text(k.cy) + "\n");
    write_text(folder_ / "groundtruth.txt", "# timestamp tx ty tz qx qy qz qw\n" + poses_);
    if (!rgb_.empty()) write_text(folder_ / "rgb.txt", "# timestamp filename\n" + rgb_);
    write_text(folder_ / "depth.txt", "# timestamp filename\n" + depth_);
  }

 private:
  std::size_t count_ = 0;
  std::string depth_, rgb_, poses_;
};

class RedwoodWriter : public RgbdWriter {
 public:
  RedwoodWriter(const fs::path& folder, Context& context) : RgbdWriter(folder, "Redwood", 1000, "color", context) {}

  void add(const LoadedView& loaded) override {
    check_same_camera(loaded);
    log_ += std::to_string(count_) + " " + std::to_string(count_) + " " + std::to_string(count_ + 1) + "\n";
    ++count_;
    for (int row = 0; row < 4; ++row) {
      for (int column = 0; column < 4; ++column)
        log_ += (column ? " " : "") + number_text(loaded.view.T_world_view.matrix()(row, column));
      log_ += "\n";
    }
  }

  void finish() override {
    const PinholeSensor& k = camera_.value();
    const json intrinsics = {{"width", k.width},
                             {"height", k.height},
                             {"intrinsic_matrix", {k.fx, 0, 0, 0, k.fy, 0, k.cx, k.cy, 1}}};  // by columns
    write_text(folder_ / "camera_intrinsic.json", intrinsics.dump(2) + "\n");
    write_text(folder_ / "trajectory.log", log_);
  }

 private:
  std::size_t count_ = 0;
  std::string log_;
};

class NerfstudioWriter : public RgbdWriter {
 public:
  NerfstudioWriter(const fs::path& folder, Context& context)
      : RgbdWriter(folder, "nerfstudio", 1000, "images", context) {}

  void add(const LoadedView& loaded) override {
    const PinholeSensor& k = camera_of(loaded);
    // Cameras look along −z there, with y up.
    Eigen::Matrix4d pose = loaded.view.T_world_view.matrix();
    pose.col(1) *= -1;
    pose.col(2) *= -1;
    json rows = json::array();
    for (int row = 0; row < 4; ++row) rows.push_back({pose(row, 0), pose(row, 1), pose(row, 2), pose(row, 3)});
    const std::string color = color_file(loaded);
    json frame = {{"depth_file_path", "depth/" + stem_of(loaded) + ".png"},
                  {"transform_matrix", rows},
                  {"w", k.width},
                  {"h", k.height},
                  {"fl_x", k.fx},
                  {"fl_y", k.fy},
                  {"cx", k.cx + 0.5},
                  {"cy", k.cy + 0.5}};
    frame["file_path"] = color.empty() ? "images/" + stem_of(loaded) + ".png" : color;
    const BrownDistortion& d = k.distortion;
    if (!d.is_zero()) {
      frame["k1"] = d.k1;
      frame["k2"] = d.k2;
      frame["k3"] = d.k3;
      frame["p1"] = d.p1;
      frame["p2"] = d.p2;
    }
    frames_.push_back(std::move(frame));
  }

  void finish() override {
    const json document = {{"camera_model", "OPENCV"}, {"depth_unit_scale_factor", 0.001}, {"frames", frames_}};
    write_text(folder_ / "transforms.json", document.dump(1) + "\n");
  }

 private:
  json frames_ = json::array();
};

}  // namespace

std::unique_ptr<SceneWriter> make_manifest_writer(const fs::path& folder) {
  return std::make_unique<ManifestWriter>(folder);
}
std::unique_ptr<SceneWriter> make_tum_writer(const fs::path& folder, Context& context) {
  return std::make_unique<TumWriter>(folder, context);
}
std::unique_ptr<SceneWriter> make_redwood_writer(const fs::path& folder, Context& context) {
  return std::make_unique<RedwoodWriter>(folder, context);
}
std::unique_ptr<SceneWriter> make_nerfstudio_writer(const fs::path& folder, Context& context) {
  return std::make_unique<NerfstudioWriter>(folder, context);
}

}  // namespace lapseam
