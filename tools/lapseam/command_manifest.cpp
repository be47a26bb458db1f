// lapseam manifest: writes any readable scene as scene.json, with what the command line corrects in it.

#include <fmt/format.h>

#include <cmath>
#include <cstdio>
#include <filesystem>
#include <numbers>
#include <optional>
#include <vector>

#include "command.h"
#include "lapseam/io.h"
#include "pose_lists.h"

namespace lapseam::tool {
namespace {

struct ManifestArguments {
  CommonOptions common;
  std::string scene, output;
  std::vector<double> color_intrinsics, color_offset_m, color_distortion;
  std::string color_size;
  std::optional<double> range_scale_m;
  std::vector<double> perturb_mm_deg;
  std::uint64_t seed = 1;
  std::string align_to;
  bool skip_bad_views = false;
};

struct Size {
  int width = 0, height = 0;
};

Size parse_size(const std::string& text) {
  Size size;
  char rest = 0;
  const int fields = std::sscanf(text.c_str(), "%dx%d%c", &size.width, &size.height, &rest);
  if (fields != 2 || size.width < 1 || size.height < 1)
    throw CLI::ValidationError("--color-size", "expected WIDTHxHEIGHT, such as 1280x960; found '" + text + "'");
  return size;
}

void check(const ManifestArguments& arguments) {
  const bool has_intrinsics = !arguments.color_intrinsics.empty();
  if (has_intrinsics && !(arguments.color_intrinsics[0] > 0 && arguments.color_intrinsics[1] > 0))
    throw CLI::ValidationError("--color-intrinsics", "focal lengths must be greater than 0");
  for (const auto* numbers :
       {&arguments.color_intrinsics, &arguments.color_offset_m, &arguments.color_distortion, &arguments.perturb_mm_deg})
    for (const double number : *numbers)
      if (!std::isfinite(number)) throw CLI::ValidationError("numbers must be finite");
  if (!has_intrinsics && (!arguments.color_size.empty() || !arguments.color_distortion.empty()))
    throw CLI::ValidationError("--color-size and --color-distortion", "need --color-intrinsics");
}

PinholeSensor make_color_camera(const ManifestArguments& arguments, Size image) {
  const std::vector<double>& k = arguments.color_intrinsics;
  const Size size = arguments.color_size.empty() ? image : parse_size(arguments.color_size);
  const double x = double(image.width) / size.width, y = double(image.height) / size.height;
  PinholeSensor camera;
  camera.width = image.width;
  camera.height = image.height;
  camera.fx = k[0] * x;
  camera.fy = k[1] * y;
  // Pixel centres are at integers, so that the image begins at −0.5.
  camera.cx = size.width == image.width ? k[2] : (k[2] + 0.5) * x - 0.5;
  camera.cy = size.height == image.height ? k[3] : (k[3] + 0.5) * y - 0.5;
  if (const std::vector<double>& d = arguments.color_distortion; !d.empty()) {
    camera.distortion.k1 = d[0];
    camera.distortion.k2 = d[1];
    camera.distortion.p1 = d[2];
    camera.distortion.p2 = d[3];
    camera.distortion.k3 = d[4];
  }
  return camera;
}

/// The colour camera of a view, as the command line describes it.
void correct_color(const ManifestArguments& arguments, ColorSource& color) {
  if (!arguments.color_intrinsics.empty())
    color.camera = make_color_camera(arguments, {width(color.camera), height(color.camera)});
  if (!arguments.color_offset_m.empty())
    color.T_view_color.translation() = Eigen::Vector3d(arguments.color_offset_m.data());
}

void perturb(const ManifestArguments& arguments, Scene& scene) {
  std::vector<Eigen::Isometry3d> poses;
  for (const ViewSource& view : scene.views) poses.push_back(view.T_world_view);
  poses = perturb_poses(poses, {.translation_m = arguments.perturb_mm_deg[0] / 1000,
                                .rotation_rad = arguments.perturb_mm_deg[1] * std::numbers::pi / 180,
                                .seed = arguments.seed});
  for (std::size_t i = 0; i < poses.size(); ++i) scene.views[i].T_world_view = poses[i];
}

void align(const Scene& truth, Scene& scene) {
  const PosePairs pairs = match_poses(scene, truth);
  const Eigen::Isometry3d T = align_poses(pairs.poses, pairs.truth);
  for (ViewSource& view : scene.views) view.T_world_view = T * view.T_world_view;
}

void run(const ManifestArguments& arguments) {
  check(arguments);
  const std::unique_ptr<Context> context = make_context(arguments.common);
  Scene scene = read_scene(arguments.scene, {.skip_bad_views = arguments.skip_bad_views}, *context);
  std::size_t with_color = 0;
  for (ViewSource& view : scene.views) {
    if (arguments.range_scale_m) view.range.scale_m = *arguments.range_scale_m;
    if (!view.color) continue;
    correct_color(arguments, *view.color);
    ++with_color;
  }
  const bool is_color_asked = !arguments.color_intrinsics.empty() || !arguments.color_offset_m.empty();
  if (is_color_asked && with_color == 0)
    throw CLI::ValidationError("--color-...", "no view of " + arguments.scene + " has a colour image");
  if (!arguments.perturb_mm_deg.empty()) perturb(arguments, scene);
  if (!arguments.align_to.empty()) align(read_scene(arguments.align_to, {}, *context), scene);
  write_scene(scene, arguments.output);
  fmt::print("{}: {} views, {} with colour\n", arguments.output, scene.views.size(), with_color);
}

}  // namespace

void add_manifest_command(CLI::App& app) {
  auto arguments = std::make_shared<ManifestArguments>();
  CLI::App* command = app.add_subcommand("manifest", "Write a scene as a manifest (scene.json), to be edited");
  command->add_option("scene", arguments->scene, "scene.json, a Stanford .conf, or a folder that is recognised")
      ->required();
  command->add_option("-o,--output", arguments->output, "The manifest to write")->required();
  command->add_option("--color-intrinsics", arguments->color_intrinsics, "fx,fy,cx,cy of the colour camera, pixels")
      ->delimiter(',')
      ->expected(4);
  command
      ->add_option("--color-offset", arguments->color_offset_m,
                   "x,y,z: position of the colour camera in the range sensor's frame, metres")
      ->delimiter(',')
      ->expected(3);
  command->add_option("--color-distortion", arguments->color_distortion, "k1,k2,p1,p2,k3 of the colour camera (Brown)")
      ->delimiter(',')
      ->expected(5);
  command->add_option("--color-size", arguments->color_size,
                      "WIDTHxHEIGHT that --color-intrinsics refer to; they are scaled to the size of the images");
  command->add_option("--range-scale", arguments->range_scale_m, "Metres per stored unit of the range images")
      ->check(CLI::PositiveNumber);
  command
      ->add_option(
          "--perturb", arguments->perturb_mm_deg,
          "MM,DEG: put every pose but the first off by that much, in random directions, to try registration on")
      ->delimiter(',')
      ->expected(2)
      ->check(CLI::NonNegativeNumber);
  command->add_option("--seed", arguments->seed, "Other random directions for --perturb")->capture_default_str();
  command->add_option("--align-to", arguments->align_to,
                      "Move all poses by the one rigid motion that brings them nearest to those of this scene");
  command->add_flag("--skip-bad-views", arguments->skip_bad_views, "Leave out unusable views with a warning");
  command->footer(
      "Example: the red kitchen of 7-Scenes, whose colour camera is not its depth camera:\n"
      "  lapseam manifest redkitchen -o redkitchen.json --color-intrinsics 525,525,320,240 --color-offset 0.025,0,0");
  add_common_options(*command, arguments->common);
  command->callback([arguments] { run(*arguments); });
}

}  // namespace lapseam::tool
