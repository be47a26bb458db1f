#include <ImfChannelList.h>
#include <ImfFrameBuffer.h>
#include <ImfHeader.h>
#include <ImfOutputFile.h>
#include <ImfStandardAttributes.h>
#include <ImfStringAttribute.h>

#include <cstring>
#include <numbers>
#include <random>

#include "io/exr.h"
#include "io/scene_formats.h"
#include "io_support.h"
#include "lapseam/context.h"
#include "lapseam/io.h"

namespace lapseam::test {
namespace {

constexpr double kPi = std::numbers::pi;

Eigen::Isometry3d random_pose(unsigned seed) {
  std::mt19937_64 random(seed);
  std::normal_distribution<double> normal;
  Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
  pose.linear() = Eigen::Quaterniond(normal(random), normal(random), normal(random), normal(random))
                      .normalized()
                      .toRotationMatrix();
  pose.translation() = Eigen::Vector3d(normal(random), normal(random), normal(random)) * 10;
  return pose;
}

RangeImage make_range(int width, int height) {
  RangeImage range(width, height);
  for (std::size_t i = 0; i < range.size(); ++i) range.pixels[i] = i % 5 == 0 ? kInvalidRange : 1.0f + float(i) / 7.0f;
  return range;
}

std::vector<Sensor> make_sensors(int width, int height) {
  PinholeSensor pinhole{width, height, 525.123456789, 524.9, 319.5 / 3, 1.0 / 3, {}};
  PinholeSensor distorted = pinhole;
  distorted.distortion = {};
  distorted.distortion.k1 = -0.1;
  distorted.distortion.k2 = 0.02;
  distorted.distortion.p1 = 1e-3;
  distorted.distortion.p2 = -2e-4;
  distorted.distortion.k3 = 1.0 / 700;
  SphericalSensor table = SphericalSensor::from_limits(width, height, -1.0, 2.0, 0.5, -0.25);
  table.azimuth_rad[1] += 1e-5;
  table.elevation_rad[1] += 1e-5;
  MeasuredGridSensor grid;
  grid.width = width;
  grid.height = height;
  for (int i = 0; i < 4; ++i) grid.rational[std::size_t(i)] = Eigen::Vector4d(i + 0.1, 2.0 / (i + 3), -i, 1);
  grid.forward = Eigen::Vector3d(1, 2, -3).normalized();
  grid.range_offset_m = 1.0 / 9;
  grid.fit_rms_px = 0.25;
  for (int i = 0; i < width * height; ++i) grid.warp.emplace_back(float(i) * 0.3f, -float(i) / 7);
  return {pinhole,
          distorted,
          SphericalSensor::from_limits(width, height, -kPi, kPi, kPi / 2, -kPi / 3),
          SphericalSensor::from_limits(width, height, -0.1234567, 1.7, 0.3, -0.777),
          table,
          OrthographicSensor{width, height, 0.0005, 0.00051, 7.5, 3.25},
          grid};
}

TEST(Exr, SensorPoseAndRangeComeBackExactly) {
  const TempFolder folder;
  Context context(1);
  unsigned seed = 1;
  for (const Sensor& sensor : make_sensors(17, 11)) {
    const Eigen::Isometry3d pose = random_pose(seed++);
    const RangeImage range = make_range(17, 11);
    write_range_exr(folder / "a.exr", range, sensor, pose);
    const Scene scene = read_scene(folder / "a.exr", {}, context);
    ASSERT_EQ(scene.views.size(), 1u);
    const View view = load_view(scene.views[0]);
    EXPECT_TRUE(is_same_sensor(view.sensor, sensor)) << kind_name(sensor);
    EXPECT_EQ(view.T_world_view.matrix(), pose.matrix()) << kind_name(sensor);
    EXPECT_EQ(view.range.pixels, range.pixels);
    EXPECT_FALSE(scene.views[0].color);
  }
}

TEST(Exr, ColourInTheSameFileKeepsAllValues) {
  const TempFolder folder;
  Context context(1);
  ColorImage color(256, 2);
  for (int u = 0; u < 256; ++u) {
    const auto value = std::uint8_t(u);
    color.at(u, 0) = {value, std::uint8_t(255 - u), 0};
    color.at(u, 1) = {0, value, value};
  }
  for (const Sensor& sensor : make_sensors(256, 2)) {
    write_range_exr(folder / "a.exr", make_range(256, 2), sensor, Eigen::Isometry3d::Identity(), &color);
    const Scene scene = read_scene(folder / "a.exr", {}, context);
    ASSERT_TRUE(scene.views[0].color) << kind_name(sensor);
    EXPECT_EQ(load_color(scene.views[0]).pixels, color.pixels);
    EXPECT_TRUE(is_same_sensor(scene.views[0].color->camera, sensor));
    EXPECT_EQ(load_view(scene.views[0]).range.pixels, make_range(256, 2).pixels);
  }
}

TEST(Exr, AFolderOfFilesIsAScene) {
  const TempFolder folder;
  Context context(1);
  const std::vector<Sensor> sensors = make_sensors(9, 8);
  write_range_exr(folder / "b.exr", make_range(9, 8), sensors[0], random_pose(2));
  write_range_exr(folder / "a.exr", make_range(9, 8), sensors[0], random_pose(1));
  write_range_exr(folder / "c.exr", make_range(9, 8), sensors[1], random_pose(3));
  write_range_exr(folder / "d.exr", make_range(9, 8), sensors[5], random_pose(4));
  const Scene scene = read_scene(folder.path(), {}, context);
  ASSERT_EQ(scene.views.size(), 4u);
  EXPECT_EQ(scene.views[0].name, "a");
  EXPECT_EQ(scene.views[1].name, "b");
  // Equal sensors share an id, and with it their noise model.
  EXPECT_EQ(scene.views[0].sensor_id, scene.views[1].sensor_id);
  EXPECT_NE(scene.views[0].sensor_id, scene.views[2].sensor_id);
  EXPECT_NE(scene.views[2].sensor_id, scene.views[3].sensor_id);
}

// ---- files that other programs wrote

struct ForeignFile {
  int width = 40, height = 30;
  std::vector<std::string> channels{"Z"};
  std::function<void(Imf::Header&)> edit = [](Imf::Header&) {};

  void write(const std::filesystem::path& file) const {
    Imf::Header header(width, height);
    edit(header);
    const std::vector<float> values(std::size_t(width) * std::size_t(height), 2.5f);
    Imf::FrameBuffer buffer;
    const Imath::Box2i window = header.dataWindow();
    const std::size_t row_bytes = sizeof(float) * std::size_t(width);
    const auto base = reinterpret_cast<std::intptr_t>(values.data()) - window.min.x * std::intptr_t(sizeof(float)) -
                      window.min.y * std::intptr_t(row_bytes);
    for (const std::string& channel : channels) {
      header.channels().insert(channel.c_str(), Imf::Channel(Imf::FLOAT));
      buffer.insert(channel.c_str(), Imf::Slice(Imf::FLOAT, reinterpret_cast<char*>(base), sizeof(float), row_bytes));
    }
    Imf::OutputFile output(file.c_str(), header, 0);
    output.setFrameBuffer(buffer);
    output.writePixels(height);
  }
};

/// Row-vector matrix, as OpenEXR has them.
Imath::M44f to_imath(const Eigen::Matrix4d& matrix) {
  Imath::M44f result;
  for (int row = 0; row < 4; ++row)
    for (int column = 0; column < 4; ++column) result[column][row] = float(matrix(row, column));
  return result;
}

/// What a renderer writes for the camera `pinhole` at `pose`: its camera frame has axes turned by `signs`.
void add_renderer_camera(Imf::Header& header, const PinholeSensor& pinhole, const Eigen::Isometry3d& pose,
                         const Eigen::Vector3d& signs, bool with_ndc) {
  const Eigen::Matrix4d camera_view = signs.homogeneous().asDiagonal();
  const Eigen::Matrix4d camera_world = camera_view * pose.inverse().matrix();
  Imf::addWorldToCamera(header, to_imath(camera_world));
  if (!with_ndc) return;
  Eigen::Matrix4d ndc_view = Eigen::Matrix4d::Zero();  // [−1, 1]², y up
  const double w = pinhole.width, h = pinhole.height;
  ndc_view.row(0) << 2 * pinhole.fx / w, 0, 2 * (pinhole.cx + 0.5) / w - 1, 0;
  ndc_view.row(1) << 0, -2 * pinhole.fy / h, 1 - 2 * (pinhole.cy + 0.5) / h, 0;
  ndc_view.row(2) << 0, 0, 1.001, -0.2;
  ndc_view.row(3) << 0, 0, 1, 0;
  Imf::addWorldToNDC(header, to_imath(ndc_view * pose.inverse().matrix()));
}

TEST(ExrStandardAttributes, CamerasOfRenderersAreUnderstood) {
  const TempFolder folder;
  Context context(1);
  const PinholeSensor pinhole{40, 30, 45.5, 44, 18.25, 16, {}};
  const Eigen::Isometry3d pose = random_pose(7);
  // OpenGL: y up, looks along −z. RenderMan: y up, looks along +z (left-handed).
  for (const Eigen::Vector3d& signs : {Eigen::Vector3d(1, -1, -1), Eigen::Vector3d(1, -1, 1)}) {
    ForeignFile file;
    file.edit = [&](Imf::Header& header) { add_renderer_camera(header, pinhole, pose, signs, true); };
    file.write(folder / "a.exr");
    const View view = load_view(read_scene(folder / "a.exr", {}, context).views.at(0));
    const auto& sensor = std::get<PinholeSensor>(view.sensor);
    // The attributes are floats.
    EXPECT_NEAR(sensor.fx, pinhole.fx, 1e-3);
    EXPECT_NEAR(sensor.fy, pinhole.fy, 1e-3);
    EXPECT_NEAR(sensor.cx, pinhole.cx, 1e-3);
    EXPECT_NEAR(sensor.cy, pinhole.cy, 1e-3);
    EXPECT_TRUE(view.T_world_view.isApprox(pose, 1e-5)) << view.T_world_view.matrix();
  }
}

TEST(ExrStandardAttributes, TheDataWindowMovesThePrincipalPoint) {
  const TempFolder folder;
  Context context(1);
  const PinholeSensor pinhole{100, 80, 90, 90, 50, 40, {}};  // of the display window
  ForeignFile file;
  file.edit = [&](Imf::Header& header) {
    header.displayWindow() = Imath::Box2i({0, 0}, {99, 79});
    header.dataWindow() = Imath::Box2i({20, 10}, {59, 39});
    add_renderer_camera(header, pinhole, Eigen::Isometry3d::Identity(), {1, -1, -1}, true);
  };
  file.write(folder / "a.exr");
  const View view = load_view(read_scene(folder / "a.exr", {}, context).views.at(0));
  const auto& sensor = std::get<PinholeSensor>(view.sensor);
  EXPECT_EQ(sensor.width, 40);
  EXPECT_NEAR(sensor.fx, 90, 1e-3);
  EXPECT_NEAR(sensor.cx, 30, 1e-3);
  EXPECT_NEAR(sensor.cy, 30, 1e-3);
  EXPECT_FLOAT_EQ(view.range.at(3, 3), 2.5f);
}

TEST(ExrStandardAttributes, AManifestGivesTheSensorAndItsPoseWins) {
  const TempFolder folder;
  Context context(1);
  const Eigen::Isometry3d pose = random_pose(8);
  ForeignFile file;
  file.edit = [&](Imf::Header& header) { add_renderer_camera(header, {}, pose, {1, -1, -1}, false); };
  file.write(folder / "a.exr");
  expect_refused([&] { read_scene(folder / "a.exr", {}, context); }, {"a.exr", "'a'", "sensor"});

  const std::string head = R"({"format": "lapseam-scene", "version": 1, "sensors": {"cam": {"model": "pinhole",
    "width": 40, "height": 30, "fx": 30, "fy": 30, "cx": 20, "cy": 15}}, "views": [{"name": "x", "sensor": "cam",)";
  write_bytes(folder / "scene.json", head + R"("range": {"file": "a.exr"}}]})");
  EXPECT_TRUE(read_scene(folder / "scene.json", {}, context).views[0].T_world_view.isApprox(pose, 1e-5));
  write_bytes(folder / "scene.json", head + R"("T_world_view": [[1,0,0,7],[0,1,0,8],[0,0,1,9],[0,0,0,1]],
    "range": {"file": "a.exr"}}]})");
  EXPECT_EQ(read_scene(folder / "scene.json", {}, context).views[0].T_world_view.translation(),
            Eigen::Vector3d(7, 8, 9));
}

TEST(Exr, ChannelsAreFoundInADocumentedOrder) {
  const Source source{"a.exr", "v"};
  EXPECT_EQ(choose_range_channel(source, {"Y", "Z", "range", "R"}, ""), "range");
  EXPECT_EQ(choose_range_channel(source, {"Y", "Z", "depth"}, ""), "Z");
  EXPECT_EQ(choose_range_channel(source, {"Y", "depth"}, ""), "depth");
  EXPECT_EQ(choose_range_channel(source, {"Y", "A"}, ""), "Y");
  EXPECT_EQ(choose_range_channel(source, {"R"}, ""), "R");
  EXPECT_EQ(choose_range_channel(source, {"R", "Z"}, "R"), "R");
  expect_refused(
      [&] {
        choose_range_channel(source, {"R", "G", "B"}, "");
      },
      {"a.exr", "'v'", "range.channel", "R, G, B"});
  expect_refused([&] { choose_range_channel(source, {"Z"}, "depth"); }, {"range.channel", "'depth'", "Z"});
}

TEST(Exr, BadAttributesAreNamed) {
  const TempFolder folder;
  Context context(1);
  ForeignFile file;
  file.edit = [](Imf::Header& header) { header.insert("lapseam:sensor", Imf::StringAttribute("fisheye")); };
  file.write(folder / "a.exr");
  expect_refused([&] { read_scene(folder / "a.exr", {}, context); }, {"a.exr", "lapseam:sensor", "fisheye"});
  file.edit = [](Imf::Header& header) { header.insert("lapseam:sensor", Imf::StringAttribute("pinhole")); };
  file.write(folder / "a.exr");
  expect_refused([&] { read_scene(folder / "a.exr", {}, context); }, {"a.exr", "lapseam:focalLength", "missing"});
  file.edit = [](Imf::Header& header) { header.insert("lapseam:viewToWorld", Imf::StringAttribute("identity")); };
  file.write(folder / "a.exr");
  expect_refused([&] { read_scene(folder / "a.exr", {}, context); }, {"a.exr", "lapseam:viewToWorld", "m44d"});
}

TEST(Exr, SizesThatDoNotFitAreNotWritten) {
  const TempFolder folder;
  const Sensor sensor = PinholeSensor{10, 10, 5, 5, 5, 5, {}};
  const Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
  expect_refused([&] { write_range_exr(folder / "a.exr", RangeImage(9, 10), sensor, pose); },
                 {"a.exr", "9 x 10", "10 x 10"});
  expect_refused([&] { write_range_exr(folder / "a.exr", RangeImage(), sensor, pose); }, {"a.exr", "without pixels"});
  const ColorImage color = make_color(5, 5);
  expect_refused([&] { write_range_exr(folder / "a.exr", RangeImage(10, 10), sensor, pose, &color); }, {"colour"});
}

}  // namespace
}  // namespace lapseam::test
