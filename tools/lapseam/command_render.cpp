#include <fmt/format.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <charconv>
#include <cmath>
#include <filesystem>
#include <numbers>
#include <optional>
#include <vector>

#include "command.h"
#include "lapseam/error.h"
#include "lapseam/io.h"
#include "lapseam/render.h"
#include "output_check.h"

namespace lapseam::tool {
namespace {

struct RenderArguments {
  CommonOptions common;
  std::string mesh, output, scene;
  std::string mode = "shaded", size, view, orbit, eye, target, up;
  double fov_deg = 50;
  int turntable = 0, samples = 3;
  bool textured = false, boundary = false, wireframe = false, smooth = false, cull = false;
};

constexpr double kRadians = std::numbers::pi / 180;

/// Numbers with a separator between them, and nothing else.
std::vector<double> parse_numbers(const std::string& option, const std::string& text, char separator, std::size_t least,
                                  std::size_t most) {
  std::vector<double> numbers;
  const char* next = text.data();
  const char* const end = next + text.size();
  bool is_wrong = false;
  while (!is_wrong) {
    double number = 0;
    const auto [after, error] = std::from_chars(next, end, number);
    is_wrong = error != std::errc() || !std::isfinite(number);
    numbers.push_back(number);
    if (is_wrong || after == end) break;
    is_wrong = *after != separator;
    next = after + 1;
  }
  if (is_wrong || numbers.size() < least || numbers.size() > most)
    throw CLI::ValidationError(option, fmt::format("takes {}{} numbers with '{}' between them, not '{}'", least,
                                                   least == most ? "" : fmt::format(" to {}", most), separator, text));
  return numbers;
}

Eigen::Vector3d parse_vector(const std::string& option, const std::string& text) {
  const std::vector<double> numbers = parse_numbers(option, text, ',', 3, 3);
  return {numbers[0], numbers[1], numbers[2]};
}

Eigen::Vector3d parse_up(const RenderArguments& arguments) {
  if (arguments.up.empty()) return Eigen::Vector3d::Zero();
  const Eigen::Vector3d up = parse_vector("--up", arguments.up);
  if (up.isZero(0)) throw CLI::ValidationError("--up", "must not be zero");
  return up;
}

struct PictureSize {
  int width, height;
};

PictureSize parse_size(const RenderArguments& arguments, PictureSize fallback) {
  if (arguments.size.empty()) return fallback;
  const std::vector<double> numbers = parse_numbers("--size", arguments.size, 'x', 2, 2);
  for (const double number : numbers)
    if (number < 1 || number > 32768 || number != std::floor(number))
      throw CLI::ValidationError("--size", "takes whole numbers from 1 to 32768, such as 1280x960");
  return {int(numbers[0]), int(numbers[1])};
}

RenderMode parse_mode(const RenderArguments& arguments) {
  const std::string& mode = arguments.textured ? "textured" : arguments.mode;
  if (mode == "textured") return RenderMode::kTextured;
  if (mode == "colors") return RenderMode::kColors;
  if (mode == "provenance") return RenderMode::kProvenance;
  return RenderMode::kShaded;
}

/// By name, else by place in the list.
const ViewSource& find_view(const Scene& scene, const std::string& wanted) {
  for (const ViewSource& view : scene.views)
    if (view.name == wanted) return view;
  std::size_t index = 0;
  const auto [end, error] = std::from_chars(wanted.data(), wanted.data() + wanted.size(), index);
  if (error != std::errc() || end != wanted.data() + wanted.size() || index >= scene.views.size())
    throw CLI::ValidationError(
        "--view", fmt::format("the scene has no view '{}'; it has {}, named like '{}'", wanted, scene.views.size(),
                              scene.views.empty() ? "" : scene.views.front().name));
  return scene.views[index];
}

RenderCamera view_camera(const RenderArguments& arguments, Context& context) {
  const Scene scene = read_scene(arguments.scene, {}, context);
  const ViewSource& source = find_view(scene, arguments.view);
  RenderCamera camera;
  camera.T_world_camera = source.T_world_view;
  if (source.sensor) {
    camera.sensor = *source.sensor;
  } else {
    const View view = load_view(source);
    camera.sensor = view.sensor;
    camera.T_world_camera = view.T_world_view;
  }
  const PictureSize size = parse_size(arguments, {0, 0});
  camera.width = size.width;
  camera.height = size.height;
  return camera;
}

RenderCamera free_camera(const RenderArguments& arguments) {
  const PictureSize size = parse_size(arguments, {1280, 960});
  return look_at_camera({.eye_m = parse_vector("--eye", arguments.eye),
                         .target_m = parse_vector("--target", arguments.target),
                         .up = parse_up(arguments),
                         .fov_rad = arguments.fov_deg * kRadians,
                         .width = size.width,
                         .height = size.height});
}

Orbit parse_orbit(const RenderArguments& arguments) {
  const PictureSize size = parse_size(arguments, {1280, 960});
  Orbit orbit{.up = parse_up(arguments), .width = size.width, .height = size.height};
  if (arguments.orbit.empty()) return orbit;
  const std::vector<double> numbers = parse_numbers("--orbit", arguments.orbit, ',', 2, 3);
  orbit.azimuth_rad = numbers[0] * kRadians;
  orbit.elevation_rad = numbers[1] * kRadians;
  if (numbers.size() == 3) orbit.zoom = numbers[2];
  if (!(orbit.zoom > 0)) throw CLI::ValidationError("--orbit", "the zoom must be greater than 0");
  return orbit;
}

/// picture.png -> picture-007.png
std::filesystem::path numbered(const std::filesystem::path& file, int number) {
  std::filesystem::path result = file;
  return result.replace_filename(fmt::format("{}-{:03}{}", file.stem().string(), number, file.extension().string()));
}

// Refused before the work starts, not after it.
void check_arguments(const RenderArguments& arguments) {
  const std::filesystem::path output = arguments.output;
  if (output.extension() != ".png") throw CLI::ValidationError("--output", "must end in .png: " + arguments.output);
  check_folder_of(output);
  parse_size(arguments, {0, 0});
  if (arguments.eye.empty()) {
    parse_orbit(arguments);
  } else {
    free_camera(arguments);
  }
}

void draw(const RenderArguments& arguments, const Mesh& mesh, const std::optional<RenderCamera>& fixed_camera,
          const RenderOptions& options, Context& context) {
  const Renderer renderer(mesh, context);
  const int pictures = std::max(arguments.turntable, 1);
  Orbit orbit = parse_orbit(arguments);
  if (orbit.up.isZero(0)) orbit.up = guess_up(mesh);
  for (int i = 0; i < pictures; ++i) {
    const ColorImage image =
        renderer.render(fixed_camera ? *fixed_camera : orbit_camera(mesh, orbit), options, context);
    write_png(arguments.turntable > 0 ? numbered(arguments.output, i) : std::filesystem::path(arguments.output), image);
    orbit.azimuth_rad += 2 * std::numbers::pi / pictures;
  }
}

void run(const RenderArguments& arguments) {
  check_arguments(arguments);
  const std::unique_ptr<Context> context = make_context(arguments.common);
  std::optional<RenderCamera> fixed_camera;
  if (!arguments.scene.empty()) fixed_camera = view_camera(arguments, *context);
  if (!arguments.eye.empty()) fixed_camera = free_camera(arguments);

  const RenderOptions options{.mode = parse_mode(arguments),
                              .smooth_normals = arguments.smooth,
                              .cull_backfaces = arguments.cull,
                              .show_boundary = arguments.boundary,
                              .show_wireframe = arguments.wireframe,
                              .samples_per_side = arguments.samples};
  const Mesh mesh = read_mesh(arguments.mesh);
  try {
    draw(arguments, mesh, fixed_camera, options, *context);
  } catch (const InvalidInput& error) {
    // The library does not know which file the mesh came from.
    throw InvalidInput(arguments.mesh, {}, {}, error.what());
  }
}

}  // namespace

void add_render_command(CLI::App& app) {
  CLI::App* command = app.add_subcommand("render", "Draw a picture of a mesh");
  const auto arguments = std::make_shared<RenderArguments>();
  command->add_option("mesh", arguments->mesh, "Mesh to draw: PLY, OBJ or GLB")->required()->type_name("MESH");
  command->add_option("-o,--output", arguments->output, "Picture to write")->required()->type_name("FILE.png");
  auto* mode = command
                   ->add_option("--mode", arguments->mode,
                                "shaded, textured, colors, or provenance (a colour per "
                                "view, seams white, filled holes magenta)")
                   ->check(CLI::IsMember({"shaded", "textured", "colors", "provenance"}))
                   ->type_name("MODE")
                   ->capture_default_str();
  command->add_flag("--textured", arguments->textured, "Same as --mode textured")->excludes(mode);
  command->add_flag("--boundary", arguments->boundary, "Draw open edges yellow, faulty ones cyan");
  command->add_flag("--wireframe", arguments->wireframe, "Draw the edges of all triangles");
  command->add_flag("--smooth", arguments->smooth, "Smooth shading instead of flat triangles");
  command->add_flag("--cull", arguments->cull, "Look through surfaces from behind (else their backs are red)");
  command->add_option("--size", arguments->size, "Size of the picture (1280x960, or that of the view)")
      ->type_name("WxH");
  command->add_option("--samples", arguments->samples, "Rays per pixel, in each direction")
      ->check(CLI::Range(1, 8))
      ->capture_default_str();

  auto* orbit = command->add_option("--orbit", arguments->orbit, "Look from outside: azimuth and elevation in degrees")
                    ->type_name("AZ,EL[,ZOOM]");
  auto* turntable =
      command->add_option("--turntable", arguments->turntable, "N pictures all around, named FILE-000.png and on")
          ->check(CLI::Range(1, 1000))
          ->type_name("N");
  auto* up = command->add_option("--up", arguments->up, "Which way is up (else guessed)")->type_name("X,Y,Z");
  auto* eye = command->add_option("--eye", arguments->eye, "Look from here, metres")->type_name("X,Y,Z");
  auto* target = command->add_option("--target", arguments->target, "Look there, metres")->type_name("X,Y,Z");
  command->add_option("--fov", arguments->fov_deg, "Height of the picture in degrees, with --eye")
      ->check(CLI::Range(0.01, 179.0))
      ->needs(eye)
      ->capture_default_str();
  auto* scene = command->add_option("--scene", arguments->scene, "Scene whose view is the camera")->type_name("SCENE");
  auto* view = command->add_option("--view", arguments->view, "Name of the view, or its place in the list from 0");
  view->type_name("VIEW")->needs(scene);
  scene->needs(view)->excludes(orbit)->excludes(turntable)->excludes(up)->excludes(eye);
  eye->needs(target)->excludes(orbit)->excludes(turntable);
  target->needs(eye);
  add_common_options(*command, arguments->common);
  command->callback([arguments] { run(*arguments); });
}

}  // namespace lapseam::tool
