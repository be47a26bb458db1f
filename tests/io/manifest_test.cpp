#include <cmath>
#include <numbers>

#include "io/scene_formats.h"
#include "io_support.h"
#include "lapseam/context.h"
#include "lapseam/io.h"

namespace lapseam::test {
namespace {

constexpr const char* kManifest = R"({
  "format": "lapseam-scene",
  "version": 1,
  "name": "test",
  "unit_m": 0.5,
  "sensors": {
    "tof": {"model": "pinhole", "width": 8, "height": 6, "fx": 10, "fy": 11, "cx": 3.5, "cy": 2.5,
            "noise": {"s0_m": 0.001, "s2_per_m": 0.002}},
    "rgb": {"model": "pinhole", "width": 16, "height": 12, "fx": 20, "fy": 22, "cx": 7, "cy": 5,
            "distortion": {"k1": -0.1, "p2": 0.001}}
  },
  "views": [
    {"name": "left", "sensor": "tof",
     "T_world_view": [[1, 0, 0, 2], [0, 1, 0, 4], [0, 0, 1, 6], [0, 0, 0, 1]],
     "range": {"file": "depth/left.png", "quantity": "z", "scale_m": 0.001, "invalid": [65535]},
     "color": {"file": "left.png", "camera": "rgb", "T_view_color": [[1, 0, 0, 0.1], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]}},
    {"name": "right", "sensor": "tof",
     "T_world_view": [[0, -1, 0, 0], [1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]],
     "range": {"file": "depth/right.png", "quantity": "distance", "scale_m": 0.0002, "intensity": "depth/bright.png"},
     "noise": {"floor_m": 0.003, "correlation": 2.5, "pointing_rad": 0.0004, "intensity_power": 0.5,
               "intensity_reference": 90}}
  ]
})";

class Manifest : public testing::Test {
 protected:
  Manifest() {
    std::filesystem::create_directories(folder / "depth");
    write_png16(folder / "depth/left.png", Image<std::uint16_t>(8, 6, 2000));
    write_png16(folder / "depth/right.png", Image<std::uint16_t>(8, 6, 5000));
    write_png(folder / "left.png", make_color(16, 12));
    write_png8(folder / "depth/bright.png", Image<std::uint8_t>(8, 6, 200));
  }

  Scene read(const std::string& text, const ReadSceneOptions& options = {}) {
    write_bytes(folder / "scene.json", text);
    return read_scene(folder / "scene.json", options, context);
  }

  /// The manifest with one place changed.
  static std::string changed(const std::string& from, const std::string& to) {
    std::string text = kManifest;
    const std::size_t at = text.find(from);
    EXPECT_NE(at, std::string::npos) << from;
    return text.replace(at, from.size(), to);
  }

  void expect_change_refused(const std::string& from, const std::string& to, std::initializer_list<std::string> words) {
    SCOPED_TRACE(from + " -> " + to);
    expect_refused([&] { read(changed(from, to)); }, words);
  }

  const TempFolder folder;
  Context context{1};
};

TEST_F(Manifest, SaysWhatItSays) {
  const Scene scene = read(kManifest);
  EXPECT_EQ(scene.name, "test");
  ASSERT_EQ(scene.views.size(), 2u);
  const ViewSource& left = scene.views[0];
  EXPECT_EQ(left.name, "left");
  EXPECT_EQ(left.sensor_id, "tof");
  EXPECT_EQ(left.T_world_view.translation(), Eigen::Vector3d(1, 2, 3));  // unit_m
  EXPECT_EQ(left.range.format, RangeFormat::kPng16);
  EXPECT_EQ(left.range.quantity, RangeQuantity::kZ);
  EXPECT_EQ(left.range.invalid_values, std::vector<double>{65535});
  EXPECT_EQ(std::get<PinholeSensor>(*left.sensor).fy, 11);
  ASSERT_TRUE(left.noise);
  EXPECT_EQ(left.noise->s0_m, 0.001);
  EXPECT_EQ(left.noise->s2_per_m, 0.002);
  ASSERT_TRUE(left.color);
  EXPECT_EQ(left.color->T_view_color.translation(), Eigen::Vector3d(0.05, 0, 0));
  EXPECT_EQ(std::get<PinholeSensor>(left.color->camera).distortion.k1, -0.1);
  EXPECT_EQ(load_color(left).pixels, make_color(16, 12).pixels);
  EXPECT_FLOAT_EQ(load_view(left).range.at(0, 0), 2.0f);

  const ViewSource& right = scene.views[1];
  EXPECT_EQ(right.range.quantity, RangeQuantity::kDistance);
  EXPECT_EQ(right.noise->floor_m, 0.003);
  EXPECT_EQ(right.noise->correlation, 2.5);
  EXPECT_EQ(right.noise->pointing_rad, 0.0004);
  EXPECT_EQ(right.noise->intensity_power, 0.5);
  EXPECT_EQ(right.noise->intensity_reference, 90);
  EXPECT_EQ(load_view(right).intensity.at(0, 0), 200);
  EXPECT_EQ(left.noise->intensity_power, 0);
  EXPECT_EQ(right.noise->s0_m, 0);
  EXPECT_FALSE(right.color);
}

TEST_F(Manifest, WhatIsWrittenReadsBackTheSame) {
  const Scene scene = read(kManifest);
  write_scene(scene, folder / "again.json");
  const Scene again = read_scene(folder / "again.json", {}, context);
  ASSERT_EQ(again.views.size(), 2u);
  for (std::size_t i = 0; i < 2; ++i) {
    const ViewSource &a = scene.views[i], &b = again.views[i];
    EXPECT_EQ(a.name, b.name);
    EXPECT_EQ(a.sensor_id, b.sensor_id);
    EXPECT_TRUE(is_same_sensor(*a.sensor, *b.sensor));
    EXPECT_EQ(a.T_world_view.matrix(), b.T_world_view.matrix());
    EXPECT_EQ(std::filesystem::canonical(a.range.file), std::filesystem::canonical(b.range.file));
    EXPECT_EQ(a.range.quantity, b.range.quantity);
    EXPECT_EQ(a.range.scale_m, b.range.scale_m);
    EXPECT_EQ(a.range.invalid_values, b.range.invalid_values);
    EXPECT_EQ(std::filesystem::weakly_canonical(a.range.intensity_file),
              std::filesystem::weakly_canonical(b.range.intensity_file));
    EXPECT_TRUE(is_same_noise(*a.noise, *b.noise));
    ASSERT_EQ(a.color.has_value(), b.color.has_value());
    if (!a.color) continue;
    EXPECT_TRUE(is_same_sensor(a.color->camera, b.color->camera));
    EXPECT_EQ(a.color->T_view_color.matrix(), b.color->T_view_color.matrix());
  }
  // Below the manifest's folder paths are relative, so that the folder can be moved.
  EXPECT_EQ(read_bytes(folder / "again.json").find(folder.path().string()), std::string::npos);
  // A second writing changes nothing.
  write_scene(again, folder / "third.json");
  EXPECT_EQ(read_bytes(folder / "third.json"), read_bytes(folder / "again.json"));
}

TEST_F(Manifest, SphericalAndOrthographicSensors) {
  const std::string views = R"("views": [{"name": "s", "sensor": "a",
     "T_world_view": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]], "range": {"file": "depth/left.png", "scale_m": 0.001}}]})";
  const std::string head = R"({"format": "lapseam-scene", "version": 1, "sensors": {"a": )";
  const Scene limits = read(head + R"({"model": "spherical", "width": 8, "height": 6, "azimuth_deg": [-180, 180],
      "elevation_table_deg": [60, 50, 40, 30, 20, -10]}}, )" +
                            views);
  const auto& sensor = std::get<SphericalSensor>(*limits.views[0].sensor);
  EXPECT_NEAR(sensor.azimuth_rad[0], -std::numbers::pi * 7 / 8, 1e-15);
  EXPECT_NEAR(sensor.elevation_rad[5], -std::numbers::pi / 18, 1e-15);
  write_scene(limits, folder / "again.json");
  const Scene again = read_scene(folder / "again.json", {}, context);
  const auto& sensor_again = std::get<SphericalSensor>(*again.views[0].sensor);
  for (std::size_t i = 0; i < 8; ++i) EXPECT_NEAR(sensor_again.azimuth_rad[i], sensor.azimuth_rad[i], 1e-12);
  for (std::size_t i = 0; i < 6; ++i) EXPECT_NEAR(sensor_again.elevation_rad[i], sensor.elevation_rad[i], 1e-12);

  const Scene parallel =
      read(head + R"({"model": "orthographic", "width": 8, "height": 6, "pitch_x_m": 0.001, "pitch_y_m": 0.002}}, )" +
           views);
  const auto& grid = std::get<OrthographicSensor>(*parallel.views[0].sensor);
  EXPECT_EQ(grid.cx, 3.5);
  EXPECT_EQ(grid.pitch_y_m, 0.002);

  expect_refused(
      [&] {
        read(head + R"({"model": "spherical", "width": 8, "height": 6, "azimuth_deg": [-180, 180],
      "elevation_table_deg": [60, 50, 40, 45, 20, -10]}}, )" +
             views);
      },
      {"sensors.a.elevation_table_deg", "angle 3"});
  expect_refused(
      [&] {
        read(head + R"({"model": "spherical", "width": 8, "height": 6, "azimuth_deg": [-180, 180],
      "elevation_table_deg": [60, 50]}}, )" +
             views);
      },
      {"sensors.a.elevation_table_deg", "2 angles for 6"});
  expect_refused(
      [&] {
        read(head + R"({"model": "spherical", "width": 8, "height": 6, "azimuth_deg": [0, 400],
      "elevation_deg": [10, -10]}}, )" +
             views);
      },
      {"sensors.a.azimuth_deg", "full circle"});
}

TEST_F(Manifest, UnknownKeysNameFileViewAndTheNearestKey) {
  expect_change_refused("\"unit_m\"", "\"unit\"", {"scene.json", "unit", "did you mean 'unit_m'"});
  expect_change_refused("\"fx\": 10", "\"f_x\": 10", {"scene.json", "sensors.tof.f_x", "did you mean 'fx'"});
  expect_change_refused("\"k1\"", "\"k_1\"", {"sensors.rgb.distortion.k_1", "'k1'"});
  expect_change_refused("\"s2_per_m\"", "\"s2\"", {"sensors.tof.noise.s2", "unknown key"});
  expect_change_refused("\"T_world_view\"", "\"T_word_view\"",
                        {"scene.json", "'left'", "T_word_view", "'T_world_view'"});
  expect_change_refused("\"scale_m\": 0.001", "\"scale\": 0.001", {"'left'", "range.scale", "'scale_m'"});
  expect_change_refused("\"camera\": \"rgb\"", "\"Camera\": \"rgb\"", {"'left'", "color.Camera", "'camera'"});
}

TEST_F(Manifest, MissingKeysAndWrongTypes) {
  expect_change_refused("\"fx\": 10, ", "", {"scene.json", "sensors.tof.fx", "missing"});
  expect_change_refused("\"fx\": 10", "\"fx\": \"10\"", {"sensors.tof.fx", "number"});
  expect_change_refused("\"fx\": 10", "\"fx\": 0", {"sensors.tof.fx", "greater than 0"});
  expect_change_refused("\"width\": 8", "\"width\": 8.5", {"sensors.tof.width", "8.5"});
  expect_change_refused("\"width\": 8", "\"width\": 0", {"sensors.tof.width"});
  expect_change_refused("\"width\": 8", "\"width\": 9", {"depth/left.png", "'left'", "8 x 6", "9 x 6"});
  expect_change_refused("\"width\": 16", "\"width\": 1000000000", {"left.png", "'left'", "color", "16 x 12"});
  expect_change_refused("\"model\": \"pinhole\"", "\"model\": \"pin-hole\"", {"sensors.tof.model", "'pinhole'"});
  expect_change_refused("\"name\": \"left\", ", "", {"scene.json", "views[0]", "name", "missing"});
  expect_change_refused("\"name\": \"right\"", "\"name\": \"left\"", {"scene.json", "'left'", "name"});
  expect_change_refused("\"sensor\": \"tof\"", "\"sensor\": \"tofu\"", {"'left'", "sensor", "'tofu'", "'tof'"});
  expect_change_refused("\"camera\": \"rgb\"", "\"camera\": \"bgr\"", {"'left'", "color.camera", "'bgr'"});
  expect_change_refused("\"quantity\": \"z\"", "\"quantity\": \"depth\"", {"'left'", "range.quantity", "depth"});
  expect_change_refused(", \"scale_m\": 0.001", "", {"left.png", "'left'", "range.scale_m", "missing"});
  expect_change_refused("\"invalid\": [65535]", "\"invalid\": 65535", {"'left'", "range.invalid", "list"});
  expect_change_refused("\"invalid\": [65535]", "\"channel\": \"Z\"", {"'left'", "range.channel", "EXR"});
  expect_change_refused("\"file\": \"left.png\"", "\"file\": \"none.png\"",
                        {"none.png", "'left'", "color.file", "no such file"});
  expect_change_refused("depth/right.png", "depth/none.png",
                        {"depth/none.png", "'right'", "range.file", "no such file"});
  expect_change_refused("depth/bright.png", "depth/none.png",
                        {"depth/none.png", "'right'", "range.intensity", "no such file"});
  expect_change_refused("depth/right.png", "depth", {"depth", "'right'", "range.file", "no regular file"});
  expect_change_refused("depth/right.png", "scene.json", {"scene.json", "'right'", "range.file", "JSON"});
  expect_change_refused("\"floor_m\": 0.003", "\"floor_m\": -1", {"'right'", "noise.floor_m", "negative"});
  expect_change_refused("\"floor_m\": 0.003", "\"floor_m\": 0", {"'right'", "noise", "zero"});
  expect_change_refused("\"correlation\": 2.5", "\"correlation\": 0.5", {"'right'", "noise.correlation", "at least 1"});
  expect_change_refused("\"intensity_power\": 0.5", "\"intensity_power\": -1",
                        {"'right'", "noise.intensity_power", "negative"});
  expect_change_refused("\"intensity_reference\": 90", "\"intensity_reference\": 0",
                        {"'right'", "noise.intensity_reference", "greater than 0"});
  expect_change_refused("\"pointing_rad\": 0.0004", "\"pointing_rad\": -1",
                        {"'right'", "noise.pointing_rad", "negative"});
  expect_change_refused("\"s2_per_m\": 0.002", "\"s1\": -0.001", {"sensors.tof.noise.s1", "floor_m"});
  expect_change_refused("\"version\": 1", "\"version\": 2", {"scene.json", "version", "2"});
  expect_change_refused("\"lapseam-scene\"", "\"other\"", {"scene.json", "format"});
  expect_change_refused("\"unit_m\": 0.5", "\"unit_m\": -1", {"scene.json", "unit_m"});
}

TEST_F(Manifest, PosesThatAreNone) {
  const std::string row = "[[1, 0, 0, 2], [0, 1, 0, 4]";
  expect_change_refused(row, "[[NaN, 0, 0, 2], [0, 1, 0, 4]", {"scene.json", "'left'", "T_world_view[0][0]", "NaN"});
  expect_change_refused(row, "[[1, 0, 0, -Infinity], [0, 1, 0, 4]", {"'left'", "T_world_view[0][3]", "Infinity"});
  expect_change_refused(row, "[[-1, 0, 0, 2], [0, 1, 0, 4]", {"'left'", "T_world_view", "reflection"});
  expect_change_refused(row, "[[1.01, 0, 0, 2], [0, 1, 0, 4]", {"'left'", "T_world_view", "not a rigid motion"});
  expect_change_refused(row, "[[1, 0.01, 0, 2], [0, 1, 0, 4]", {"'left'", "T_world_view"});
  expect_change_refused("[0, 0, 1, 6], [0, 0, 0, 1]", "[0, 0, 1, 6], [0, 0, 0, 2]",
                        {"'left'", "T_world_view", "last row"});
  expect_change_refused("[0, 0, 1, 6], [0, 0, 0, 1]", "[0, 0, 1, 6]", {"'left'", "T_world_view", "4 rows"});
  expect_change_refused("[[1, 0, 0, 2], [0, 1, 0, 4], [0, 0, 1, 6]", "[[2, 0, 0, 2], [0, 2, 0, 4], [0, 0, 2, 6]",
                        {"'left'", "T_world_view", "scale of 2"});
  expect_change_refused("[[1, 0, 0, 0.1]", "[[0, 0, 0, 0.1]", {"'left'", "color.T_view_color"});
}

TEST_F(Manifest, RoundingInAPoseIsTakenOut) {
  const Scene scene = read(changed("[[1, 0, 0, 2], [0, 1, 0, 4]", "[[1.00001, 0, 0, 2], [0.00002, 1, 0, 4]"));
  const Eigen::Matrix3d rotation = scene.views[0].T_world_view.linear();
  EXPECT_LT((rotation.transpose() * rotation - Eigen::Matrix3d::Identity()).norm(), 1e-14);
}

TEST_F(Manifest, SyntaxErrorsHaveAPlace) {
  expect_change_refused("\"version\": 1,", "\"version\": 1", {"scene.json", "line 4, column"});
  expect_change_refused("\"version\": 1,", "\"version\": 1, \"version\": 1,", {"scene.json", "version", "twice"});
  expect_change_refused("\"unit_m\": 0.5", "\"unit_m\": 1e999", {"scene.json"});
  const std::string text = kManifest;
  for (std::size_t length = 1; length + 1 < text.size(); length += 61)
    expect_refused([&] { read(text.substr(0, length)); }, {"scene.json"});
}

TEST_F(Manifest, BadViewsCanBeSkipped) {
  const Scene scene = read(changed("depth/right.png", "depth/none.png"), {.skip_bad_views = true});
  ASSERT_EQ(scene.views.size(), 1u);
  EXPECT_EQ(scene.views[0].name, "left");
  const std::vector<std::string> warnings = context.warnings();
  ASSERT_EQ(warnings.size(), 1u);
  EXPECT_NE(warnings[0].find("depth/none.png"), std::string::npos);
  EXPECT_NE(warnings[0].find("'right'"), std::string::npos);
  // Nothing left is an error all the same.
  std::filesystem::remove_all(folder / "depth");
  expect_refused([&] { read(kManifest, {.skip_bad_views = true}); }, {"scene.json", "no usable view"});
}

TEST_F(Manifest, WhatIsOnlyInMemoryIsNotWritten) {
  Scene scene = read(kManifest);
  scene.views[1].range.format = RangeFormat::kMemory;
  expect_refused([&] { write_scene(scene, folder / "x.json"); }, {"x.json", "'right'", "memory"});
  EXPECT_FALSE(std::filesystem::exists(folder / "x.json"));
}

TEST_F(Manifest, SensorsWithOneIdButDifferentModelsAreKeptApart) {
  Scene scene = read(kManifest);
  std::get<PinholeSensor>(*scene.views[1].sensor).fx = 99;
  write_scene(scene, folder / "x.json");
  const Scene again = read_scene(folder / "x.json", {}, context);
  EXPECT_EQ(std::get<PinholeSensor>(*again.views[0].sensor).fx, 10);
  EXPECT_EQ(std::get<PinholeSensor>(*again.views[1].sensor).fx, 99);
}

}  // namespace
}  // namespace lapseam::test
