// lapseam simulate: a scene that is known exactly, scanned by sensors that are known exactly.

#include <fmt/format.h>

#include <cmath>
#include <filesystem>
#include <numbers>
#include <string>
#include <vector>

#include "command.h"
#include "lapseam/io.h"
#include "lapseam/simulate.h"

namespace lapseam::tool {
namespace {

constexpr double kRadiansPerDegree = std::numbers::pi / 180;

struct SimulateArguments {
  CommonOptions common;
  std::string scene;
  std::string output;
  // scene
  std::string room_size, box_size;
  double radius_m = 0.5, thickness_m = 0.015;
  bool is_two_sided = false;
  // sensor
  std::string sensor = "rgbd", size, elevation_limits, color_size, color_offset;
  double fov_deg = 0, color_fov_deg = 0, extent_m = 0;
  // trajectory
  std::string trajectory, pose_file;
  int views = 0, rings = 1;
  double elevation_deg = 20, distance_m = 0;
  std::uint64_t seed = 1;
  // effects
  double noise_scale = 1, pointing_noise_mrad = 0, intensity_noise = 0, dark_dropout = 0, specular_dropout = 0,
         exposure_sigma = 0;
  std::string noise_model, incidence_noise, quantization, grazing, range_limits, pose_error;
  bool has_mixed_pixels = false;
  // output
  std::string format = "exr";
  bool has_no_color = false, declares_noise = false;
};

std::vector<double> parse_numbers(const std::string& text, const std::string& option, char separator, std::size_t least,
                                  std::size_t most) {
  std::vector<double> numbers;
  for (std::size_t begin = 0; begin <= text.size();) {
    const std::size_t end = std::min(text.find(separator, begin), text.size());
    const std::string word = text.substr(begin, end - begin);
    std::size_t used = 0;
    try {
      numbers.push_back(std::stod(word, &used));
    } catch (const std::exception&) {
      used = std::string::npos;
    }
    if (used != word.size() || !std::isfinite(numbers.back()))
      throw CLI::ValidationError(option, "'" + text + "' is not a list of numbers");
    begin = end + 1;
  }
  if (numbers.size() < least || numbers.size() > most) {
    const std::string count = least == most ? std::to_string(least) : fmt::format("{} to {}", least, most);
    throw CLI::ValidationError(option,
                               "'" + text + "' has " + std::to_string(numbers.size()) + " numbers, not " + count);
  }
  return numbers;
}

struct PixelSize {
  int width, height;
};

PixelSize parse_size(const std::string& text, const std::string& option) {
  const std::vector<double> n = parse_numbers(text, option, 'x', 2, 2);
  for (const double side : n)
    if (side != std::floor(side) || side < 2 || side > 32768)
      throw CLI::ValidationError(option, "'" + text + "' is not WIDTHxHEIGHT in pixels, 2 to 32768 each");
  return {int(n[0]), int(n[1])};
}

double focal_px(int width, double fov_deg) {
  return fov_deg > 0 ? 0.5 * width / std::tan(0.5 * fov_deg * kRadiansPerDegree) : 0.0;
}

SimulatedScene make_scene(const SimulateArguments& arguments) {
  SimulatedScene scene;
  if (arguments.scene == "room") {
    RoomOptions room{.seed = arguments.seed};
    if (!arguments.room_size.empty()) {
      const std::vector<double> n = parse_numbers(arguments.room_size, "--room", ',', 3, 3);
      room.width_m = n[0], room.depth_m = n[1], room.height_m = n[2];
    }
    scene = make_room(room);
  } else if (arguments.scene == "sphere") {
    scene = make_sphere_scene(arguments.radius_m);
  } else if (arguments.scene == "box") {
    Eigen::Vector3d size(0.8, 0.6, 0.5);
    if (!arguments.box_size.empty())
      size = Eigen::Map<const Eigen::Vector3d>(parse_numbers(arguments.box_size, "--box", ',', 3, 3).data());
    scene = make_box_scene(size);
  } else if (arguments.scene == "partition") {
    scene = make_partition_scene(arguments.thickness_m);
  } else {
    scene = make_mesh_scene(read_mesh(arguments.scene), std::filesystem::path(arguments.scene).stem().string());
  }
  scene.is_two_sided = arguments.is_two_sided;
  return scene;
}

/// The length of the scene's bounding box.
double diameter(const SimulatedScene& scene) {
  Eigen::AlignedBox3f box;
  for (const auto& p : scene.mesh.positions_m) box.extend(p);
  return double(box.diagonal().norm());
}

SensorRig make_rig(const SimulateArguments& arguments, const SimulatedScene& scene) {
  const bool is_laser = arguments.sensor == "laser";
  const std::string size_text = arguments.size.empty() ? (is_laser ? "2000x1000" : "640x480") : arguments.size;
  const PixelSize size = parse_size(size_text, "--size");
  if (is_laser) {
    double top = 90, bottom = -60;
    if (!arguments.elevation_limits.empty()) {
      const std::vector<double> n = parse_numbers(arguments.elevation_limits, "--elevation-limits", ',', 2, 2);
      top = n[0], bottom = n[1];
    }
    return make_laser_rig(size.width, size.height, top * kRadiansPerDegree, bottom * kRadiansPerDegree);
  }
  if (arguments.sensor == "ortho")
    return make_ortho_rig(size.width, size.height,
                          arguments.extent_m > 0 ? arguments.extent_m : 1.02 * diameter(scene));
  return make_rgbd_rig(size.width, size.height, focal_px(size.width, arguments.fov_deg));
}

/// A colour camera of its own, where one is asked for.
void set_color_camera(const SimulateArguments& arguments, SensorRig& rig) {
  if (arguments.has_no_color) rig.color.reset();
  const bool is_separate =
      !arguments.color_size.empty() || !arguments.color_offset.empty() || arguments.color_fov_deg > 0;
  if (!is_separate) return;
  if (arguments.has_no_color) throw CLI::ValidationError("--no-color", "contradicts the options of a colour camera");
  const auto* depth_camera = std::get_if<PinholeSensor>(&rig.sensor);
  if (!depth_camera) throw CLI::ValidationError("--color-*", "a colour camera of its own needs --sensor rgbd");
  PinholeSensor camera = *depth_camera;
  if (!arguments.color_size.empty()) {
    const PixelSize size = parse_size(arguments.color_size, "--color-size");
    // The same field of view across.
    camera.fx = camera.fy = depth_camera->fx * size.width / depth_camera->width;
    camera.width = size.width, camera.height = size.height;
    camera.cx = 0.5 * (size.width - 1), camera.cy = 0.5 * (size.height - 1);
  }
  if (arguments.color_fov_deg > 0) camera.fx = camera.fy = focal_px(camera.width, arguments.color_fov_deg);
  rig.color->camera = camera;
  if (!arguments.color_offset.empty())
    rig.color->T_view_color.translation() =
        Eigen::Map<const Eigen::Vector3d>(parse_numbers(arguments.color_offset, "--color-offset", ',', 3, 3).data());
}

SensorEffects make_effects(const SimulateArguments& arguments, const SensorEffects& defaults) {
  SensorEffects effects = defaults;
  if (!arguments.noise_model.empty()) {
    const std::vector<double> n = parse_numbers(arguments.noise_model, "--noise-model", ',', 1, 3);
    effects.noise = {n[0], n.size() > 1 ? n[1] : 0.0, n.size() > 2 ? n[2] : 0.0, 0};
    if (effects.noise.s0_m < 0 || effects.noise.s2_per_m < 0)
      throw CLI::ValidationError("--noise-model", "A and C must not be negative");
    // A parabola that dips must not reach zero.
    if (effects.noise.s1 < 0) effects.noise.floor_m = 1e-6;
  }
  if (arguments.pointing_noise_mrad > 0) effects.noise.pointing_rad = 0.001 * arguments.pointing_noise_mrad;
  effects.noise.intensity_power = arguments.intensity_noise;
  if (!arguments.incidence_noise.empty()) {
    const std::vector<double> n = parse_numbers(arguments.incidence_noise, "--incidence-noise", ',', 1, 2);
    effects.incidence_1 = n[0], effects.incidence_2 = n.size() > 1 ? n[1] : 0.0;
  }
  if (!arguments.quantization.empty()) {
    const std::vector<double> n = parse_numbers(arguments.quantization, "--quantize", ',', 1, 2);
    effects.quantization_m = n[0], effects.quantization_2_per_m = n.size() > 1 ? n[1] : 0.0;
  }
  if (!arguments.range_limits.empty()) {
    const std::vector<double> n = parse_numbers(arguments.range_limits, "--range", ',', 2, 2);
    if (!(n[0] >= 0 && n[1] > n[0])) throw CLI::ValidationError("--range", "must be MIN,MAX with 0 <= MIN < MAX");
    effects.min_range_m = n[0], effects.max_range_m = n[1];
  }
  if (!arguments.grazing.empty()) {
    const std::vector<double> n = parse_numbers(arguments.grazing, "--grazing", ',', 1, 2);
    effects.grazing_cosine = n[0], effects.grazing_dropout = n.size() > 1 ? n[1] : 1.0;
  }
  effects.has_mixed_pixels = arguments.has_mixed_pixels;
  effects.dark_dropout = arguments.dark_dropout;
  effects.specular_dropout = arguments.specular_dropout;
  effects.exposure_sigma = arguments.exposure_sigma;
  if (!arguments.pose_error.empty()) {
    const std::vector<double> n = parse_numbers(arguments.pose_error, "--pose-error", ',', 2, 2);
    effects.pose_sigma_m = 1e-3 * n[0], effects.pose_sigma_rad = n[1] * kRadiansPerDegree;
  }
  return scaled(effects, arguments.noise_scale);
}

std::vector<ViewSource> plan_views(const SimulateArguments& arguments, const SimulatedScene& scene,
                                   const SensorRig& rig, Context& context) {
  if (!arguments.pose_file.empty()) return read_trajectory(arguments.pose_file, rig);
  std::string kind = arguments.trajectory;
  if (kind.empty()) {
    if (scene.is_interior)
      kind = arguments.sensor == "laser" ? "stations" : "walk";
    else
      kind = arguments.scene == "sphere" || arguments.scene == "box" ? "axes" : "orbit";
  }
  TrajectoryOptions options{.rings = arguments.rings,
                            .elevation_rad = arguments.elevation_deg * kRadiansPerDegree,
                            .distance_m = arguments.distance_m,
                            .seed = arguments.seed};
  if (kind == "walk") options.kind = Trajectory::kWalk, options.views = 100;
  if (kind == "orbit") options.kind = Trajectory::kOrbit, options.views = 12;
  if (kind == "stations") options.kind = Trajectory::kStations, options.views = 4;
  if (kind == "axes") options.kind = Trajectory::kAxes, options.views = 6;
  if (arguments.views > 0) options.views = arguments.views;
  return make_trajectory(scene, rig, options, context);
}

void run_simulate(const SimulateArguments& arguments) {
  const auto context = make_context(arguments.common);
  const SimulatedScene scene = make_scene(arguments);
  SensorRig rig = make_rig(arguments, scene);
  set_color_camera(arguments, rig);
  rig.effects = make_effects(arguments, rig.effects);
  const std::vector<ViewSource> planned = plan_views(arguments, scene, rig, *context);
  const FolderOptions options{.range_format = arguments.format == "png" ? RangeFormat::kPng16 : RangeFormat::kExr,
                              .has_color = rig.color.has_value(),
                              .declares_noise = arguments.declares_noise,
                              .seed = arguments.seed};
  const FolderReport report = simulate_to_folder(scene, planned, rig.effects, arguments.output, options, *context);
  fmt::print("{}: {} views, {} samples, {} true triangles\n",
             (std::filesystem::path(arguments.output) / "scene.json").string(), report.views, report.samples,
             scene.mesh.triangle_count());
}

void add_scene_options(CLI::App& command, SimulateArguments& arguments) {
  command.add_option("SCENE", arguments.scene, "room, sphere, box, partition, or a mesh file (PLY, OBJ, GLB)")
      ->required();
  command.add_option("-o,--output", arguments.output, "Folder to write")->required();
  command.add_option("--seed", arguments.seed, "Of the room, the trajectory and the noise")->capture_default_str();
  command.add_option("--room", arguments.room_size, "Size of the room, W,D,H in metres (6,5,2.8)");
  command.add_option("--radius", arguments.radius_m, "Of the sphere, metres")
      ->check(CLI::PositiveNumber)
      ->capture_default_str();
  command.add_option("--box", arguments.box_size, "Size of the box, X,Y,Z in metres (0.8,0.6,0.5)");
  command.add_option("--thickness", arguments.thickness_m, "Of the partition, metres")
      ->check(CLI::PositiveNumber)
      ->capture_default_str();
  command.add_flag("--two-sided", arguments.is_two_sided, "Sensors see the backs of triangles too");
}

void add_sensor_options(CLI::App& command, SimulateArguments& arguments) {
  command.add_option("--sensor", arguments.sensor, "rgbd, laser or ortho")
      ->check(CLI::IsMember({"rgbd", "laser", "ortho"}))
      ->capture_default_str();
  command.add_option("--size", arguments.size, "WxH in pixels (640x480; laser 2000x1000)");
  command.add_option("--fov", arguments.fov_deg, "Field of view across, degrees (62.7)")->check(CLI::Range(1.0, 170.0));
  command.add_option("--elevation-limits", arguments.elevation_limits, "Laser: TOP,BOTTOM in degrees (90,-60)");
  command.add_option("--extent", arguments.extent_m, "Ortho: metres across the shorter side (all of the scene)")
      ->check(CLI::PositiveNumber);
  command.add_option("--color-size", arguments.color_size, "WxH of a colour camera of its own");
  command.add_option("--color-fov", arguments.color_fov_deg, "Its field of view across, degrees")
      ->check(CLI::Range(1.0, 170.0));
  command.add_option("--color-offset", arguments.color_offset, "Where it sits, X,Y,Z in metres: right, down, forward");
  command
      .add_option("--trajectory", arguments.trajectory, "walk, orbit, stations or axes (what suits scene and sensor)")
      ->check(CLI::IsMember({"walk", "orbit", "stations", "axes"}));
  command.add_option("--views", arguments.views, "How many (walk 100, orbit 12, axes 6, stations 4)")
      ->check(CLI::Range(1, 100000));
  command.add_option("--rings", arguments.rings, "Orbit: rings between 60 degrees below and above")
      ->check(CLI::Range(1, 1000))
      ->capture_default_str();
  command.add_option("--elevation", arguments.elevation_deg, "Orbit: of a single ring, degrees")
      ->check(CLI::Range(-89.0, 89.0))
      ->capture_default_str();
  command.add_option("--distance", arguments.distance_m, "Orbit, axes: from the middle, metres (the scene fits)")
      ->check(CLI::PositiveNumber);
  command.add_option("--poses", arguments.pose_file, "True poses, a line each: tx ty tz qx qy qz qw, or a 4x4 matrix")
      ->check(CLI::ExistingFile)
      ->excludes("--trajectory")
      ->excludes("--views");
}

void add_effect_options(CLI::App& command, SimulateArguments& arguments) {
  const auto probability = CLI::Range(0.0, 1.0);
  command.add_option("--noise", arguments.noise_scale, "Scales the noise; 0: none, and no dropouts either")
      ->check(CLI::NonNegativeNumber)
      ->capture_default_str();
  command.add_option("--noise-model", arguments.noise_model, "A,B,C: sigma = A + B r + C r^2, metres (the sensor's)");
  command
      .add_option("--pointing-noise", arguments.pointing_noise_mrad,
                  "What rays are off by, mrad: moves ranges by range x tan(incidence) of it (0)")
      ->check(CLI::NonNegativeNumber);
  command
      .add_option("--intensity-noise", arguments.intensity_noise,
                  "Write intensities; sigma grows with this power of 128 / intensity (0: neither)")
      ->check(CLI::Range(0.0, 2.0));
  command.add_option("--incidence-noise", arguments.incidence_noise,
                     "A,B: sigma times 1 + A t + B t^2, t radians off the normal");
  command.add_option("--quantize", arguments.quantization, "A,B: ranges in steps of A + B r^2 metres");
  command.add_option("--range", arguments.range_limits, "MIN,MAX in metres (rgbd 0.4,4.5; laser 0.3,60)");
  command.add_option("--grazing", arguments.grazing, "COSINE,P: samples below this cosine are lost with probability P");
  command.add_option("--dark-dropout", arguments.dark_dropout, "Probability of losing samples on dark surfaces")
      ->check(probability);
  command.add_option("--specular-dropout", arguments.specular_dropout, "The same on shiny surfaces seen aslant")
      ->check(probability);
  command.add_flag("--mixed-pixels", arguments.has_mixed_pixels, "Samples at depth edges average: flying pixels");
  command.add_option("--pose-error", arguments.pose_error, "MM,DEG: standard deviation of written poses, each axis");
  command.add_option("--exposure", arguments.exposure_sigma, "Standard deviation of the logarithm of each view's gain")
      ->check(CLI::NonNegativeNumber);
}

}  // namespace

void add_simulate_command(CLI::App& app) {
  CLI::App* command = app.add_subcommand("simulate", "Scan a made-up scene, with its truth");
  auto arguments = std::make_shared<SimulateArguments>();
  add_scene_options(*command, *arguments);
  add_sensor_options(*command, *arguments);
  add_effect_options(*command, *arguments);
  command->add_option("--format", arguments->format, "Range images: exr or png")
      ->check(CLI::IsMember({"exr", "png"}))
      ->capture_default_str();
  command->add_flag("--no-color", arguments->has_no_color, "Write no colour images");
  command->add_flag("--declare-noise", arguments->declares_noise, "Write the noise model into scene.json");
  add_common_options(*command, arguments->common);
  command->callback([arguments] { run_simulate(*arguments); });
}

}  // namespace lapseam::tool
