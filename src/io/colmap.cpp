#include "io/colmap.h"

#include <array>
#include <cmath>
#include <cstring>
#include <map>

#include "io/output_file.h"
#include "io/rgbd.h"
#include "io/text_scan.h"
#include "lapseam/context.h"
#include "lapseam/io.h"

namespace lapseam {
namespace {

namespace fs = std::filesystem;

struct Model {
  std::string_view name;
  std::size_t parameters;
};
// By COLMAP's numbers; those after FULL_OPENCV are fisheyes and the like.
constexpr std::array<Model, 7> kModels{{{"SIMPLE_PINHOLE", 3},
                                        {"PINHOLE", 4},
                                        {"SIMPLE_RADIAL", 4},
                                        {"RADIAL", 5},
                                        {"OPENCV", 8},
                                        {"OPENCV_FISHEYE", 8},
                                        {"FULL_OPENCV", 12}}};
constexpr std::size_t kFisheye = 5, kFullOpencv = 6;

struct CameraPose {
  std::uint32_t camera = 0;
  Eigen::Isometry3d T_world_view;
  std::string name;
};

struct Reconstruction {
  std::map<std::uint32_t, PinholeSensor> cameras;
  std::vector<CameraPose> images;
};

/// Focal lengths, principal point, then what the model adds; pixel centres are at 0.5 there.
PinholeSensor to_camera(const Source& source, const std::string& field, std::size_t model, double width, double height,
                        const std::vector<double>& p) {
  if (!(width >= 1 && height >= 1 && width * height <= double(kMaxPixels))) source.refuse(field, "has no size");
  if (model == kFisheye || model >= kModels.size()) source.refuse(field, "fisheye cameras are not read");
  PinholeSensor camera{int(width), int(height), p[0], p[0], p[1] - 0.5, p[2] - 0.5, {}};
  const bool has_two_focals = model == 1 || model >= 4;
  if (has_two_focals) {
    camera.fy = p[1];
    camera.cx = p[2] - 0.5;
    camera.cy = p[3] - 0.5;
  }
  if (model == 2) camera.distortion.k1 = p[3];
  if (model == 3) camera.distortion = {p[3], p[4], 0, 0, 0};
  if (model >= 4) camera.distortion = {p[4], p[5], p[6], p[7], 0};
  if (model == kFullOpencv) {
    camera.distortion.k3 = p[8];
    if (p[9] != 0 || p[10] != 0 || p[11] != 0) source.refuse(field, "k4, k5 and k6 cannot be read");
  }
  for (const double value : p)
    if (!std::isfinite(value)) source.refuse(field, "a parameter is not finite");
  if (!(camera.fx > 0 && camera.fy > 0)) source.refuse(field, "has no focal length");
  return camera;
}

/// World to camera in the files.
Eigen::Isometry3d to_world(const Source& source, const std::string& field, const std::array<double, 7>& n) {
  return to_pose(source, field, {n[4], n[5], n[6]}, n[0], n[1], n[2], n[3]).inverse();
}

// ---- text

template <typename Take>
void read_lines(const Source& source, const Take& take) {
  const std::vector<char> bytes = read_file_bytes(source.file);
  std::string_view rest(bytes.data(), bytes.size());
  for (std::size_t number = 1; !rest.empty(); ++number) {
    const std::string_view line = take_line(rest);
    if (!line.empty() && line.front() == '#') continue;
    take(line, "line " + std::to_string(number));
  }
}

double take_number(const Source& source, const std::string& field, std::string_view& words) {
  const auto number = parse_number<double>(take_word(words));
  if (!number) source.refuse(field, "expected a number");
  return *number;
}

void read_cameras_text(const Source& source, Reconstruction& out) {
  read_lines(source, [&](std::string_view line, const std::string& field) {
    if (trim(line).empty()) return;
    const auto id = parse_number<std::uint32_t>(take_word(line));
    if (!id) source.refuse(field, "expected the number of a camera");
    const std::string_view name = take_word(line);
    std::size_t model = 0;
    while (model < kModels.size() && kModels[model].name != name) ++model;
    if (model == kModels.size()) source.refuse(field, "'" + std::string(name.substr(0, 40)) + "' cameras are not read");
    const double width = take_number(source, field, line), height = take_number(source, field, line);
    std::vector<double> parameters(kModels[model].parameters);
    for (double& parameter : parameters) parameter = take_number(source, field, line);
    out.cameras[*id] = to_camera(source, field, model, width, height, parameters);
  });
}

/// Two lines an image; the second one, its points, may be empty.
void read_images_text(const Source& source, Reconstruction& out) {
  bool is_points = false;
  read_lines(source, [&](std::string_view line, const std::string& field) {
    if (is_points) {
      is_points = false;
      return;
    }
    if (trim(line).empty()) return;
    take_number(source, field, line);
    std::array<double, 7> n{};
    for (double& value : n) value = take_number(source, field, line);
    CameraPose image;
    const auto camera = parse_number<std::uint32_t>(take_word(line));
    if (!camera) source.refuse(field, "expected the number of a camera");
    image.camera = *camera;
    image.T_world_view = to_world(source, field, n);
    image.name = std::string(trim(line));
    out.images.push_back(std::move(image));
    is_points = true;
  });
}

// ---- binary

class Bytes {
 public:
  Bytes(const Source& source, const std::vector<char>& bytes) : source_(source), rest_(bytes.data(), bytes.size()) {}

  template <typename T>
  T take() {
    T value;
    if (rest_.size() < sizeof value) source_.refuse({}, "the file is truncated");
    std::memcpy(&value, rest_.data(), sizeof value);
    rest_.remove_prefix(sizeof value);
    return value;
  }
  std::string take_name() {
    const std::size_t end = rest_.find('\0');
    if (end == std::string_view::npos) source_.refuse({}, "the file is truncated");
    std::string name(rest_.substr(0, end));
    rest_.remove_prefix(end + 1);
    return name;
  }
  void skip(std::uint64_t count, std::uint64_t each) {
    if (count > rest_.size() / each) source_.refuse({}, "the file is truncated");
    rest_.remove_prefix(std::size_t(count * each));
  }

 private:
  const Source& source_;
  std::string_view rest_;
};

void read_cameras_binary(const Source& source, Reconstruction& out) {
  const std::vector<char> bytes = read_file_bytes(source.file);
  Bytes reader(source, bytes);
  const auto count = reader.take<std::uint64_t>();
  for (std::uint64_t i = 0; i < count; ++i) {
    const auto id = reader.take<std::uint32_t>();
    const auto model = std::size_t(reader.take<std::uint32_t>());
    const std::string field = "camera " + std::to_string(id);
    const auto width = double(reader.take<std::uint64_t>()), height = double(reader.take<std::uint64_t>());
    if (model >= kModels.size()) source.refuse(field, "model " + std::to_string(model) + " is not read");
    std::vector<double> parameters(kModels[model].parameters);
    for (double& parameter : parameters) parameter = reader.take<double>();
    out.cameras[id] = to_camera(source, field, model, width, height, parameters);
  }
}

void read_images_binary(const Source& source, Reconstruction& out) {
  const std::vector<char> bytes = read_file_bytes(source.file);
  Bytes reader(source, bytes);
  const auto count = reader.take<std::uint64_t>();
  for (std::uint64_t i = 0; i < count; ++i) {
    const std::string field = "image " + std::to_string(reader.take<std::uint32_t>());
    std::array<double, 7> n{};
    for (double& value : n) value = reader.take<double>();
    CameraPose image;
    image.camera = reader.take<std::uint32_t>();
    image.T_world_view = to_world(source, field, n);
    image.name = reader.take_name();
    reader.skip(reader.take<std::uint64_t>(), 24);  // x, y, and the number of the point
    out.images.push_back(std::move(image));
  }
}

// ---- the folder

struct Layout {
  fs::path model, depth_maps, images;
  bool is_binary = false;
};

std::optional<Layout> find_layout(const fs::path& folder) {
  for (const fs::path& workspace : {folder, folder / "dense", folder / "dense" / "0"}) {
    if (!fs::is_directory(workspace / "stereo" / "depth_maps")) continue;
    for (const fs::path& model : {workspace / "sparse", workspace / "sparse" / "0", workspace}) {
      for (const bool is_binary : {true, false}) {
        const char* ending = is_binary ? ".bin" : ".txt";
        if (fs::exists(model / (std::string("cameras") + ending)) &&
            fs::exists(model / (std::string("images") + ending)))
          return Layout{model, workspace / "stereo" / "depth_maps", workspace / "images", is_binary};
      }
    }
  }
  return std::nullopt;
}

struct DepthHeader {
  ImageSize size;
  std::size_t bytes = 0;
};

/// "640&480&1&", then floats row by row.
std::optional<DepthHeader> parse_depth_header(std::string_view start) {
  std::array<int, 3> numbers{};
  std::size_t at = 0;
  for (int& number : numbers) {
    const std::size_t end = start.find('&', at);
    if (end == std::string_view::npos || end - at > 10) return std::nullopt;
    const auto value = parse_number<int>(start.substr(at, end - at));
    if (!value || *value < 1) return std::nullopt;
    number = *value;
    at = end + 1;
  }
  if (numbers[2] != 1) return std::nullopt;
  return DepthHeader{{numbers[0], numbers[1]}, at};
}

}  // namespace

bool looks_like_colmap_depth(std::string_view start) { return parse_depth_header(start.substr(0, 40)).has_value(); }

ImageSize probe_colmap_depth(const Source& source) {
  const auto header = parse_depth_header(read_file_start(source.file, 40));
  if (!header) source.refuse({}, "this is no COLMAP depth map");
  const std::uint64_t pixels = std::uint64_t(header->size.width) * std::uint64_t(header->size.height);
  if (pixels > kMaxPixels || file_size_bytes(source.file) != header->bytes + pixels * sizeof(float))
    source.refuse("size", "the file's length is not that of " + to_string(header->size) + " floats");
  return header->size;
}

Image<float> read_colmap_depth(const Source& source) {
  const ImageSize size = probe_colmap_depth(source);
  const std::vector<char> bytes = read_file_bytes(source.file);
  Image<float> depth(size.width, size.height);
  const std::size_t body = depth.size() * sizeof(float);
  if (bytes.size() < body) source.refuse({}, "the file is truncated");
  std::memcpy(depth.pixels.data(), bytes.data() + bytes.size() - body, body);
  return depth;
}

bool is_colmap_folder(const fs::path& folder) { return find_layout(folder).has_value(); }

Scene read_colmap(const fs::path& folder, const ReadSceneOptions& options, Context& context) {
  const Layout layout = find_layout(folder).value();
  Reconstruction model;
  if (layout.is_binary) {
    read_cameras_binary({layout.model / "cameras.bin", {}}, model);
    read_images_binary({layout.model / "images.bin", {}}, model);
  } else {
    read_cameras_text({layout.model / "cameras.txt", {}}, model);
    read_images_text({layout.model / "images.txt", {}}, model);
  }
  SceneBuilder builder(folder, options, context);
  builder.set_name(resolved_path(folder).filename().string());
  std::size_t without_depth = 0;
  for (const CameraPose& image : model.images) {
    fs::path depth;
    // Geometrically consistent depth is worth more than photometric depth.
    for (const char* kind : {".geometric.bin", ".photometric.bin"})
      if (depth.empty() && is_there(layout.depth_maps / (image.name + kind)))
        depth = layout.depth_maps / (image.name + kind);
    if (depth.empty() && ++without_depth) continue;
    builder.add([&] {
      const Source source{depth, image.name};
      const auto camera = model.cameras.find(image.camera);
      if (camera == model.cameras.end()) source.refuse("camera", "there is no camera " + std::to_string(image.camera));
      ViewDraft draft;
      draft.view.name = image.name;
      draft.view.T_world_view = image.T_world_view;
      draft.has_pose = true;
      draft.view.range.file = depth;
      draft.view.range.format = RangeFormat::kColmapDepth;
      const ImageSize size = probe_colmap_depth(source);
      const PinholeSensor& full = camera->second;
      const PinholeSensor sensor = size == ImageSize{full.width, full.height} ? full : resized(full, size);
      draft.view.sensor = sensor;
      if (is_there(layout.images / image.name))
        draft.view.color = registered_color({layout.images / image.name, image.name}, sensor);
      return draft;
    });
  }
  if (without_depth > 0)
    context.warn(folder.string() + ": " + std::to_string(without_depth) + " images have no depth map and are left out");
  return builder.finish();
}

}  // namespace lapseam
