// Folders as of the TUM RGB-D benchmark (Sturm et al. 2012): lists of images and of poses by time stamp.

#include <algorithm>
#include <array>
#include <cmath>

#include "io/codecs.h"
#include "io/output_file.h"
#include "io/rgbd.h"
#include "io/text_scan.h"
#include "lapseam/context.h"

namespace lapseam {
namespace {

// As far apart as the benchmark's own tool lets images and poses be.
constexpr double kMaxGap_s = 0.02;
// Between poses no farther apart than this, the pose at the image's time is interpolated.
constexpr double kMaxPoseGap_s = 0.1;
constexpr double kScale_m = 1.0 / 5000;

struct StampedImage {
  double time_s;
  std::string file;
};
struct StampedPose {
  double time_s;
  Eigen::Quaterniond rotation;
  Eigen::Vector3d translation;
};

/// Calls take(time, rest of the line, line number) for the lines that are no comments.
template <typename Take>
void read_list(const Source& source, const Take& take) {
  const std::vector<char> bytes = read_file_bytes(source.file);
  std::string_view rest(bytes.data(), bytes.size());
  double last_s = -1e300;
  for (std::size_t number = 1; !rest.empty(); ++number) {
    std::string_view line = take_line(rest);
    const std::string_view word = take_word(line);
    if (word.empty() || word.front() == '#') continue;
    const std::string field = "line " + std::to_string(number);
    const auto time_s = parse_number<double>(word);
    if (!time_s || !std::isfinite(*time_s)) source.refuse(field, "expected a time stamp");
    if (!(*time_s > last_s)) source.refuse(field, "time stamps must rise");
    last_s = *time_s;
    take(*time_s, line, field);
  }
}

std::vector<StampedImage> read_images(const std::filesystem::path& file) {
  const Source source{file, {}};
  std::vector<StampedImage> images;
  read_list(source, [&](double time_s, std::string_view line, const std::string& field) {
    const std::string_view name = take_word(line);
    if (name.empty()) source.refuse(field, "expected a time stamp and a file name");
    images.push_back({time_s, std::string(name)});
  });
  return images;
}

std::vector<StampedPose> read_poses(const std::filesystem::path& file) {
  const Source source{file, {}};
  std::vector<StampedPose> poses;
  read_list(source, [&](double time_s, std::string_view line, const std::string& field) {
    std::array<double, 7> n{};
    for (double& value : n) {
      const auto number = parse_number<double>(take_word(line));
      if (!number) source.refuse(field, "expected a time stamp and tx ty tz qx qy qz qw");
      value = *number;
    }
    const Eigen::Isometry3d pose = to_pose(source, field, {n[0], n[1], n[2]}, n[6], n[3], n[4], n[5]);
    poses.push_back({time_s, Eigen::Quaterniond(pose.linear()), pose.translation()});
  });
  return poses;
}

template <typename Stamped>
const Stamped* nearest(const std::vector<Stamped>& list, double time_s) {
  const auto after = std::lower_bound(list.begin(), list.end(), time_s,
                                      [](const Stamped& entry, double t) { return entry.time_s < t; });
  const Stamped* best = nullptr;
  for (auto it = after == list.begin() ? after : after - 1; it != list.end() && it <= after; ++it)
    if (!best || std::abs(it->time_s - time_s) < std::abs(best->time_s - time_s)) best = &*it;
  return best && std::abs(best->time_s - time_s) <= kMaxGap_s ? best : nullptr;
}

/// The pose at a time: one with this very stamp, between its neighbours, or the nearest; nothing where none is near.
std::optional<Eigen::Isometry3d> pose_at(const std::vector<StampedPose>& poses, double time_s) {
  const auto make = [](const Eigen::Quaterniond& rotation, const Eigen::Vector3d& translation) {
    Eigen::Isometry3d pose(rotation);
    pose.translation() = translation;
    return pose;
  };
  const auto after = std::lower_bound(poses.begin(), poses.end(), time_s,
                                      [](const StampedPose& entry, double t) { return entry.time_s < t; });
  if (after != poses.end() && after->time_s == time_s) return make(after->rotation, after->translation);
  if (after != poses.end() && after != poses.begin()) {
    const StampedPose &a = *(after - 1), &b = *after;
    if (b.time_s - a.time_s <= kMaxPoseGap_s) {
      const double t = (time_s - a.time_s) / (b.time_s - a.time_s);
      return make(a.rotation.slerp(t, b.rotation), a.translation + t * (b.translation - a.translation));
    }
  }
  const StampedPose* pose = nearest(poses, time_s);
  return pose ? std::optional(make(pose->rotation, pose->translation)) : std::nullopt;
}

PinholeSensor read_camera(const std::filesystem::path& folder) {
  PinholeSensor camera{640, 480, kDefaultFocal_px, kDefaultFocal_px, kDefaultCx_px, kDefaultCy_px, {}};
  const Source source{folder / "calibration.txt", {}};
  if (!std::filesystem::exists(source.file)) return camera;
  const std::vector<double> k = read_numbers(source, "calibration", 4);
  if (!(k[0] > 0 && k[1] > 0 && std::isfinite(k[0] + k[1] + k[2] + k[3])))
    source.refuse("calibration", "expected fx fy cx cy");
  camera.fx = k[0];
  camera.fy = k[1];
  camera.cx = k[2];
  camera.cy = k[3];
  return camera;
}

}  // namespace

bool is_tum_folder(const std::filesystem::path& folder) {
  return std::filesystem::is_regular_file(folder / "depth.txt") &&
         std::filesystem::is_regular_file(folder / "groundtruth.txt");
}

Scene read_tum(const std::filesystem::path& folder, const ReadSceneOptions& options, Context& context) {
  SceneBuilder builder(folder, options, context);
  builder.set_name(resolved_path(folder).filename().string());
  const std::vector<StampedImage> depth_images = read_images(folder / "depth.txt");
  const std::vector<StampedPose> poses = read_poses(folder / "groundtruth.txt");
  std::vector<StampedImage> color_images;
  if (std::filesystem::exists(folder / "rgb.txt")) color_images = read_images(folder / "rgb.txt");
  PinholeSensor camera = read_camera(folder);
  std::size_t without_pose = 0;
  for (const StampedImage& image : depth_images) {
    const auto pose = pose_at(poses, image.time_s);
    // Trackers begin late and lose sight now and then: such frames are no mistake of the folder.
    if (!pose && ++without_pose) continue;
    builder.add([&] {
      const Source depth{folder / image.file, std::filesystem::path(image.file).stem().string()};
      if (is_regular(depth.file) && recognise_file(depth.file) == FileKind::kPng) {
        const ImageSize size = probe_png(depth).size;
        camera.width = size.width;
        camera.height = size.height;
      }
      ViewDraft draft = depth_draft(depth, kScale_m, camera, *pose);
      if (const StampedImage* color = nearest(color_images, image.time_s))
        draft.view.color = registered_color({folder / color->file, depth.view}, camera);
      return draft;
    });
  }
  if (without_pose > 0)
    context.warn(folder.string() + ": " + std::to_string(without_pose) + " depth images have no pose near their time");
  return builder.finish();
}

}  // namespace lapseam
