#include "io/rgbd.h"

#include <cmath>

#include "io/codecs.h"
#include "io/npy.h"
#include "io/output_file.h"
#include "io/text_scan.h"

namespace lapseam {

std::vector<double> read_numbers(const Source& source, const std::string& field, std::size_t count) {
  const std::vector<char> bytes = read_file_bytes(source.file);
  std::string_view rest(bytes.data(), bytes.size());
  std::vector<double> numbers;
  for (std::string_view word = take_word(rest); !word.empty(); word = take_word(rest)) {
    const auto number = parse_number<double>(word);
    if (!number) source.refuse(field, "'" + std::string(word.substr(0, 40)) + "' is not a number");
    if (numbers.size() < count + 1) numbers.push_back(*number);
  }
  if (numbers.size() != count)
    source.refuse(field, "expected " + std::to_string(count) + " numbers, found " +
                             (numbers.size() > count ? "more" : std::to_string(numbers.size())));
  return numbers;
}

PinholeSensor resized(const PinholeSensor& sensor, ImageSize size) {
  const double x = double(size.width) / sensor.width, y = double(size.height) / sensor.height;
  return {size.width,
          size.height,
          sensor.fx * x,
          sensor.fy * y,
          (sensor.cx + 0.5) * x - 0.5,
          (sensor.cy + 0.5) * y - 0.5,
          sensor.distortion};
}

ColorSource registered_color(const Source& source, const PinholeSensor& depth_camera) {
  ColorSource color;
  color.file = source.file;
  if (is_there(source.file) && !is_regular(source.file)) source.refuse("color", "this is no regular file");
  const ImageSize size = probe_color_size(source);
  const bool is_same = size == ImageSize{depth_camera.width, depth_camera.height};
  color.camera = is_same ? depth_camera : resized(depth_camera, size);
  return color;
}

ViewDraft depth_draft(const Source& depth, double scale_m, const PinholeSensor& camera,
                      const Eigen::Isometry3d& T_world_view) {
  ViewDraft draft;
  ViewSource& view = draft.view;
  view.name = depth.view;
  view.T_world_view = T_world_view;
  draft.has_pose = true;
  view.range.file = depth.file;
  view.range.format = RangeFormat::kPng16;
  view.range.scale_m = scale_m;
  view.range.invalid_values = {65535};
  if (!is_there(depth.file)) depth.refuse("depth", "no such file");
  // A pipe or a device, named by a damaged file, could keep us waiting for ever.
  if (!is_regular(depth.file)) depth.refuse("depth", "this is no regular file");
  const bool is_npy = recognise_file(depth.file) == FileKind::kNpy;
  const ImageSize size = is_npy ? probe_npy(depth) : probe_png(depth).size;
  view.sensor = size == ImageSize{camera.width, camera.height} ? camera : resized(camera, size);
  return draft;
}

Eigen::Isometry3d to_pose(const Source& source, const std::string& field, const Eigen::Vector3d& t, double qw,
                          double qx, double qy, double qz) {
  const Eigen::Quaterniond q(qw, qx, qy, qz);
  constexpr double kTolerance = 1e-3;  // a few digits a component, and a wrong number is off by far more
  if (!t.allFinite() || !q.coeffs().allFinite()) source.refuse(field, "a number of the pose is not finite");
  if (!(std::abs(q.norm() - 1) < kTolerance))
    source.refuse(field, "the quaternion has length " + std::to_string(q.norm()) + ", not 1");
  Eigen::Isometry3d pose(q.normalized());
  pose.translation() = t;
  return pose;
}

}  // namespace lapseam
