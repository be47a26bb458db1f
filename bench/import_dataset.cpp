// import_dataset DIR OUT [--copy]: turns a simulated data set with known truth (dataset.json, depth/, depth_true/,
// color/, gt.ply) into a manifest and its truth:
//   OUT/scene.json         the measured views; no noise model, which is for lapseam to estimate
//   OUT/truth/scene.json   the same views with noiseless range images and true poses
//   OUT/truth/mesh.ply     the true surface
// The images stay where they are, unless --copy is given.

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <numbers>

#include "lapseam/context.h"
#include "lapseam/error.h"
#include "lapseam/io.h"

namespace {

namespace fs = std::filesystem;
using nlohmann::json;

struct Arguments {
  fs::path folder, out;
  bool copies_images = false;
};

json read_json(const fs::path& file) {
  std::ifstream stream(file, std::ios::binary);
  if (!stream) throw lapseam::IoError(file, "cannot read");
  return json::parse(stream);
}

lapseam::Sensor read_sensor(const json& dataset) {
  const int width = dataset.at("width"), height = dataset.at("height");
  const std::string model = dataset.at("model");
  if (model == "spherical") {
    // Azimuth −180° … 180° over the columns, elevation 90° … −90° down the rows.
    constexpr double kPi = std::numbers::pi;
    return lapseam::SphericalSensor::from_limits(width, height, -kPi, kPi, kPi / 2, -kPi / 2);
  }
  if (model != "perspective") throw lapseam::Error("unknown model '" + model + "' in dataset.json");
  lapseam::PinholeSensor sensor;
  sensor.width = width;
  sensor.height = height;
  sensor.fx = dataset.at("fx");
  sensor.fy = dataset.at("fy");
  sensor.cx = dataset.at("cx");
  sensor.cy = dataset.at("cy");
  return sensor;
}

Eigen::Isometry3d read_pose(const json& rows) {
  Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
  for (int row = 0; row < 3; ++row)
    for (int column = 0; column < 4; ++column)
      pose.matrix()(row, column) = rows.at(std::size_t(row)).at(std::size_t(column)).get<double>();
  return pose;
}

void copy_over(const fs::path& from, const fs::path& to) {
  fs::create_directories(to.parent_path());
  fs::remove(to);  // what is there may be write-protected, or a link to `from`
  fs::copy_file(from, to);
  fs::permissions(to, fs::perms::owner_write, fs::perm_options::add);
}

/// Where the manifest finds an image: at its place in the data set, or at `copy` after copying it.
fs::path place_image(const Arguments& arguments, const fs::path& image, const fs::path& copy) {
  const fs::path original = arguments.folder / image;
  if (!arguments.copies_images) return original;
  copy_over(original, arguments.out / copy);
  return arguments.out / copy;
}

lapseam::ViewSource make_view(const json& dataset, const json& view, const lapseam::Sensor& sensor) {
  lapseam::ViewSource source;
  source.name = fs::path(view.at("depth").get<std::string>()).stem().string();
  source.sensor = sensor;
  source.sensor_id = std::holds_alternative<lapseam::SphericalSensor>(sensor) ? "laser" : "rgbd";
  source.range.format = lapseam::RangeFormat::kPng16;
  source.range.scale_m = 1.0 / dataset.at("depth_scale").get<double>();
  return source;
}

void import(const Arguments& arguments) {
  const json dataset = read_json(arguments.folder / "dataset.json");
  const lapseam::Sensor sensor = read_sensor(dataset);
  lapseam::Scene scene, truth;
  scene.name = dataset.at("name");
  truth.name = scene.name + " (truth)";
  for (const json& view : dataset.at("views")) {
    const fs::path depth = view.at("depth"), depth_true = view.at("depth_true"), color = view.at("color");
    lapseam::ViewSource measured = make_view(dataset, view, sensor);
    lapseam::ViewSource exact = measured;
    measured.T_world_view = read_pose(view.at("T_cw"));
    measured.range.file = place_image(arguments, depth, depth);
    measured.color.emplace();
    measured.color->file = place_image(arguments, color, color);
    measured.color->camera = sensor;
    exact.T_world_view = read_pose(view.at("T_cw_true"));
    exact.range.file = place_image(arguments, depth_true, "truth" / depth);
    scene.views.push_back(std::move(measured));
    truth.views.push_back(std::move(exact));
  }

  fs::create_directories(arguments.out / "truth");
  lapseam::write_scene(scene, arguments.out / "scene.json");
  lapseam::write_scene(truth, arguments.out / "truth" / "scene.json");
  const fs::path mesh = arguments.out / "truth" / "mesh.ply";
  if (arguments.copies_images) {
    copy_over(arguments.folder / "gt.ply", mesh);
  } else {
    fs::remove(mesh);
    fs::create_symlink(fs::canonical(arguments.folder / "gt.ply"), mesh);
  }

  // Both manifests must be readable as they are now.
  lapseam::Context context(1);
  lapseam::read_scene(arguments.out / "truth", {}, context);
  const std::size_t views = lapseam::read_scene(arguments.out, {}, context).views.size();
  fmt::print("{}: {} views\n", (arguments.out / "scene.json").string(), views);
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app("Turns a simulated data set with known truth into a lapseam manifest.", "import_dataset");
  Arguments arguments;
  app.add_option("folder", arguments.folder, "Folder with dataset.json")->required();
  app.add_option("out", arguments.out, "Folder for scene.json and truth/; is created")->required();
  app.add_flag("--copy", arguments.copies_images, "Copy the images instead of pointing at them");
  CLI11_PARSE(app, argc, argv);
  try {
    import(arguments);
  } catch (const std::exception& error) {
    fmt::print(stderr, "import_dataset: error: {}\n", error.what());
    return 1;
  }
  return 0;
}
