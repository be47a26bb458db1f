// Folders and files that are recognised by what is in them, and those that are not.

#include "io_support.h"
#include "lapseam/context.h"
#include "lapseam/io.h"

namespace lapseam::test {
namespace {

constexpr const char* kPose = "0 -1 0 0.5\n1 0 0 -1.5\n0 0 1 2.5\n0 0 0 1\n";

class Frames : public testing::Test {
 protected:
  Frames() {
    for (const char* name : {"frame-000005", "frame-000000"}) {
      const std::string frame = name;
      Image<std::uint16_t> depth(8, 6, 1500);
      depth.pixels[1] = 65535;
      depth.pixels[2] = 0;
      write_png16(folder / (frame + ".depth.png"), depth);
      write_bytes(folder / (frame + ".pose.txt"), kPose);
    }
    write_png(folder / "frame-000000.color.png", make_color(8, 6));
  }

  Scene read(const ReadSceneOptions& options = {}) { return read_scene(folder.path(), options, context); }

  const TempFolder folder;
  Context context{1};
};

TEST_F(Frames, AreReadInTheOrderOfTheirNames) {
  const Scene scene = read();
  ASSERT_EQ(scene.views.size(), 2u);
  EXPECT_EQ(scene.views[0].name, "frame-000000");
  EXPECT_EQ(scene.views[1].name, "frame-000005");
  EXPECT_EQ(scene.views[0].sensor_id, scene.views[1].sensor_id);
  EXPECT_EQ(scene.views[0].T_world_view.translation(), Eigen::Vector3d(0.5, -1.5, 2.5));
  EXPECT_EQ(scene.views[0].T_world_view * Eigen::Vector3d(1, 0, 0), Eigen::Vector3d(0.5, -0.5, 2.5));
  const auto& sensor = std::get<PinholeSensor>(*scene.views[0].sensor);
  EXPECT_EQ(sensor.fx, 585);
  EXPECT_EQ(sensor.cx, 320);
  ASSERT_TRUE(scene.views[0].color);
  EXPECT_FALSE(scene.views[1].color);

  const View view = load_view(scene.views[0]);
  EXPECT_FLOAT_EQ(view.range.pixels[0], 1.5f);
  EXPECT_EQ(view.range.pixels[1], kInvalidRange);
  EXPECT_EQ(view.range.pixels[2], kInvalidRange);
}

TEST_F(Frames, UseIntrinsicsWhereThereAreSome) {
  write_bytes(folder / "camera-intrinsics.txt", "5.0e+01 0 3.5\n0 51 2.5\n0 0 1\n");
  const auto sensor = std::get<PinholeSensor>(*read().views[0].sensor);
  EXPECT_EQ(sensor.fx, 50);
  EXPECT_EQ(sensor.fy, 51);
  EXPECT_EQ(sensor.cx, 3.5);
  EXPECT_EQ(sensor.cy, 2.5);
  write_bytes(folder / "camera-intrinsics.txt", "50 0 3.5\n0 51 2.5\n0 0 2\n");
  expect_refused([&] { read(); }, {"camera-intrinsics.txt", "intrinsics"});
}

TEST_F(Frames, ColourOfAnotherSizeIsTakenToShowTheSame) {
  write_png(folder / "frame-000000.color.png", make_color(16, 12));
  const Scene scene = read();
  const auto& camera = std::get<PinholeSensor>(scene.views[0].color->camera);
  const auto& sensor = std::get<PinholeSensor>(*scene.views[0].sensor);
  EXPECT_EQ(camera.width, 16);
  PixelRange a, b;
  ASSERT_TRUE(sensor.project({0.1, 0.2, 1}, a));
  ASSERT_TRUE(camera.project({0.1, 0.2, 1}, b));
  EXPECT_NEAR((a.u + 0.5) / 8, (b.u + 0.5) / 16, 1e-12);
  EXPECT_NEAR((a.v + 0.5) / 6, (b.v + 0.5) / 12, 1e-12);
}

TEST_F(Frames, BadPosesNameTheFileAndTheFrame) {
  const auto expect_bad = [&](const std::string& pose, std::initializer_list<std::string> words) {
    write_bytes(folder / "frame-000005.pose.txt", pose);
    expect_refused([&] { read(); }, words);
  };
  expect_bad("nan nan nan nan\n0 1 0 0\n0 0 1 0\n0 0 0 1\n",
             {"frame-000005.pose.txt", "'frame-000005'", "pose", "not finite"});
  expect_bad("1 0 0 0\n0 1 0 0\n0 0 1 0\n", {"frame-000005.pose.txt", "16 numbers, found 12"});
  expect_bad("1 0 0 0\n0 1 0 0\n0 0 -1 0\n0 0 0 1\n", {"frame-000005.pose.txt", "reflection"});
  expect_bad("1 0 0 zero\n0 1 0 0\n0 0 1 0\n0 0 0 1\n", {"frame-000005.pose.txt", "'zero'"});
  std::filesystem::remove(folder / "frame-000005.pose.txt");
  expect_refused([&] { read(); }, {"frame-000005.pose.txt", "'frame-000005'", "no such file"});
  EXPECT_EQ(read({.skip_bad_views = true}).views.size(), 1u);
  EXPECT_EQ(context.warnings().size(), 1u);
}

TEST_F(Frames, DriftOfTheTrackersScaleIsTakenOut) {
  write_bytes(folder / "frame-000005.pose.txt", "0.99988 0 0 1\n0 0.99988 0 2\n0 0 0.99988 3\n0 0 0 1\n");
  EXPECT_TRUE(read().views[1].T_world_view.linear().isApprox(Eigen::Matrix3d::Identity(), 1e-14));
  write_bytes(folder / "frame-000005.pose.txt", "0.99 0 0 1\n0 0.99 0 2\n0 0 0.99 3\n0 0 0 1\n");
  expect_refused([&] { read(); }, {"frame-000005.pose.txt", "'frame-000005'", "scale of 0.99"});
}

TEST_F(Frames, BecomeAManifest) {
  write_scene(read(), folder / "scene.json");
  const Scene scene = read();  // the manifest comes first
  EXPECT_EQ(scene.file.filename(), "scene.json");
  ASSERT_EQ(scene.views.size(), 2u);
  EXPECT_EQ(load_view(scene.views[0]).range.pixels[1], kInvalidRange);
  EXPECT_EQ(load_color(scene.views[0]).pixels, make_color(8, 6).pixels);
}

TEST(Recognition, SaysWhatItWouldHaveUnderstood) {
  const TempFolder folder;
  Context context(1);
  expect_refused([&] { read_scene(folder.path(), {}, context); }, {folder.path().string(), "scene.json", ".conf"});
  write_bytes(folder / "a.txt", "hello");
  expect_refused([&] { read_scene(folder / "a.txt", {}, context); }, {"a.txt", "unknown kind", "scene.json"});
  write_png(folder / "a.png", make_color(3, 3));
  expect_refused([&] { read_scene(folder / "a.png", {}, context); }, {"a.png", "PNG", "scene.json"});
  write_bytes(folder / "a.json", "{\"asset\": 3}");
  expect_refused([&] { read_scene(folder / "a.json", {}, context); }, {"a.json", "format"});
  write_bytes(folder / "a.ply", "ply\nformat ascii 1.0\nelement vertex 0\nproperty float x\nend_header\n");
  expect_refused([&] { read_scene(folder / "a.ply", {}, context); }, {"a.ply", "no range grid"});
  write_bytes(folder / "empty", "");
  expect_refused([&] { read_scene(folder / "empty", {}, context); }, {"empty", "unknown kind"});
  EXPECT_THROW(read_scene(folder / "none", {}, context), IoError);
}

TEST(Recognition, RedKitchenOpens) {
  const std::filesystem::path data = data_folder();
  if (data.empty()) GTEST_SKIP() << "no real scans: set LAPSEAM_DATA";
  Context context(1);
  const Scene scene = read_scene(data / "redkitchen", {}, context);
  ASSERT_EQ(scene.views.size(), 100u);
  const View view = load_view(scene.views[50]);
  EXPECT_EQ(view.range.width, 640);
  EXPECT_EQ(load_color(scene.views[50]).size(), view.range.size());
  for (const float r : view.range.pixels) EXPECT_LT(r, 20.0f);  // 65.535 m is no sample
}

}  // namespace
}  // namespace lapseam::test
