// Stanford .conf files: `bmesh FILE tx ty tz qx qy qz qw` places one range grid.

#include <array>
#include <cmath>

#include "io/output_file.h"
#include "io/scene_formats.h"
#include "io/text_scan.h"

namespace lapseam {
namespace {

/// The files mean the conjugate of the usual reading: p_world = R(q)ᵀ p + t.
Eigen::Isometry3d to_pose(const Source& source, const std::array<double, 7>& numbers) {
  const auto [tx, ty, tz, qx, qy, qz, qw] = numbers;
  const Eigen::Quaterniond rotation(qw, qx, qy, qz);
  constexpr double kTolerance = 1e-3;  // six digits a component, and a wrong number is off by far more
  if (!(std::abs(rotation.norm() - 1) < kTolerance))
    source.refuse("bmesh", "the quaternion has length " + std::to_string(rotation.norm()) + ", not 1");
  Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
  pose.linear() = rotation.normalized().toRotationMatrix().transpose();
  pose.translation() = Eigen::Vector3d(tx, ty, tz);
  return pose;
}

ViewDraft make_view(const std::filesystem::path& file, std::string_view words, std::size_t line_number) {
  const std::string name(take_word(words));
  const std::string line = "line " + std::to_string(line_number);
  if (name.empty()) throw InvalidInput(file, {}, line, "bmesh needs a file name");
  ViewDraft draft;
  draft.view.name = std::filesystem::path(name).stem().string();
  const Source source{file, draft.view.name};
  std::array<double, 7> numbers{};
  for (double& number : numbers) {
    const auto value = parse_number<double>(take_word(words));
    if (!value) source.refuse(line, "bmesh needs a file name and 7 numbers: tx ty tz qx qy qz qw");
    if (!std::isfinite(*value)) source.refuse(line, "a number of the pose is not finite");
    number = *value;
  }
  if (!take_word(words).empty()) source.refuse(line, "more than a file name and 7 numbers");
  draft.view.range.file = file.parent_path() / name;
  draft.view.sensor_id = kRangeGridSensorId;
  draft.view.T_world_view = to_pose(source, numbers);
  draft.has_pose = true;
  return draft;
}

}  // namespace

Scene read_stanford_conf(const std::filesystem::path& file, const ReadSceneOptions& options, Context& context) {
  const std::vector<char> bytes = read_file_bytes(file);
  SceneBuilder builder(file, options, context);
  builder.set_name(file.stem().string());
  std::string_view rest(bytes.data(), bytes.size());
  std::size_t views = 0;
  for (std::size_t line_number = 1; !rest.empty(); ++line_number) {
    std::string_view line = take_line(rest);
    const std::string_view keyword = take_word(line);
    if (keyword.empty() || keyword.front() == '#' || keyword == "camera" || keyword == "mesh") continue;
    if (keyword != "bmesh") {
      throw InvalidInput(
          file, {}, "line " + std::to_string(line_number),
          "unknown keyword '" + std::string(keyword.substr(0, 40)) + "'; expected bmesh, mesh or camera");
    }
    builder.add([&] { return make_view(file, line, line_number); });
    ++views;
  }
  if (views == 0) throw InvalidInput(file, {}, "bmesh", "there is no bmesh line, so there are no views");
  return builder.finish();
}

Scene read_single_range_grid(const std::filesystem::path& file, const ReadSceneOptions& options, Context& context) {
  SceneBuilder builder(file, options, context);
  builder.set_name(file.stem().string());
  builder.add([&] {
    ViewDraft draft;
    draft.view.name = file.stem().string();
    draft.view.range.file = file;
    draft.view.sensor_id = kRangeGridSensorId;
    draft.has_pose = true;
    return draft;
  });
  return builder.finish();
}

}  // namespace lapseam
