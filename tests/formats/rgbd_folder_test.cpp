// TUM, Redwood and nerfstudio folders.

#include "room_scene.h"

namespace lapseam::test {
namespace {

TEST(RgbdFolders, RoundTrips) {
  // Depth is rounded to the format's step; at the border of the image that is 1.2 times as much along the ray.
  expect_round_trip(room_scene(lens_camera(), 3), SceneFormat::kTum, "tum", 0.6 / 5000 * 1.3);
  expect_round_trip(room_scene(lens_camera(), 3), SceneFormat::kRedwood, "redwood", 0.6 / 1000 * 1.3);
  expect_round_trip(room_scene(lens_camera(), 3), SceneFormat::kNerfstudio, "nerf", 0.6 / 1000 * 1.3);
  expect_round_trip(room_scene(lens_camera(), 2, false), SceneFormat::kTum, "tum", 0.6 / 5000 * 1.3);
}

TEST(RgbdFolders, TheManifestFolderIsBitwise) {
  const TempFolder folder;
  Context context(2);
  expect_round_trip(room_scene(lens_camera(), 3), SceneFormat::kManifest, "scene", 0);
  expect_round_trip(room_scene(small_scanner(), 2), SceneFormat::kManifest, "scene", 1e-12);
}

TEST(RgbdFolders, NerfstudioKeepsTheLens) {
  PinholeSensor camera = lens_camera();
  camera.distortion = {0.1, -0.02, 0.001, -0.002, 0.003};
  expect_round_trip(room_scene(camera, 2), SceneFormat::kNerfstudio, "nerf", 0.6 / 1000 * 1.3);
  const TempFolder folder;
  Context context(1);
  expect_refused([&] { convert_scene(room_scene(camera, 1), folder / "tum", {.format = SceneFormat::kTum}, context); },
                 {"'view0'", "distortion", "TUM"});
}

class Tum : public testing::Test {
 protected:
  void SetUp() override {
    convert_scene(room_scene(lens_camera(), 3), folder_ / "tum", {.format = SceneFormat::kTum}, context_);
  }
  void replace(const std::string& file, const std::string& from, const std::string& to) {
    std::string text = read_bytes(folder_ / "tum" / file);
    const std::size_t at = text.find(from);
    ASSERT_NE(at, std::string::npos);
    write_bytes(folder_ / "tum" / file, text.replace(at, from.size(), to));
  }
  Scene read() { return read_scene(folder_ / "tum", {}, context_); }

  TempFolder folder_;
  Context context_{1};
};

TEST_F(Tum, PosesAreInterpolatedInTime) {
  write_bytes(folder_ / "tum/groundtruth.txt", "1.98 0 0 0 0 0 0 1\n2.02 1 2 3 0 0 1 0\n");
  replace("depth.txt", "2.000000", "2.010000");
  const Scene scene = read();
  ASSERT_EQ(scene.views.size(), 1u);
  EXPECT_TRUE(scene.views[0].T_world_view.translation().isApprox(Eigen::Vector3d(0.75, 1.5, 2.25), 1e-9));
  EXPECT_NEAR(Eigen::AngleAxisd(scene.views[0].T_world_view.linear()).angle(), 0.75 * 3.14159265358979, 1e-6);
}

TEST_F(Tum, FramesWithoutPoseAreLeftOutAndColourMayLag) {
  replace("depth.txt", "2.000000", "2.400000");
  replace("rgb.txt", "3.000000", "3.015000");
  const Scene scene = read();
  ASSERT_EQ(scene.views.size(), 2u);
  EXPECT_TRUE(scene.views[0].color);
  EXPECT_TRUE(scene.views[1].color);
  ASSERT_EQ(context_.warnings().size(), 1u);
  EXPECT_NE(context_.warnings()[0].find("1 depth images have no pose"), std::string::npos);
}

TEST_F(Tum, MistakesHaveALine) {
  replace("groundtruth.txt", "2.000000", "0.500000");
  expect_refused([&] { read(); }, {"groundtruth.txt", "line 3", "rise"});
  write_bytes(folder_ / "tum/groundtruth.txt", "1 0 0 0 0 0 0 2\n");
  expect_refused([&] { read(); }, {"groundtruth.txt", "line 1", "quaternion"});
  write_bytes(folder_ / "tum/groundtruth.txt", "1 0 0 0 0 nan 0 1\n");
  expect_refused([&] { read(); }, {"groundtruth.txt", "line 1", "finite"});
  write_bytes(folder_ / "tum/groundtruth.txt", "1 0 0 0 0 0 0 1\n");
  replace("depth.txt", "depth/view0.png", "depth/gone.png");
  expect_refused([&] { read(); }, {"gone.png", "'gone'", "no such file"});
  write_bytes(folder_ / "tum/calibration.txt", "500 0 320 240");
  expect_refused([&] { read(); }, {"calibration.txt", "fx fy cx cy"});
}

TEST(Redwood, MistakesAreNamed) {
  const TempFolder folder;
  Context context(1);
  convert_scene(room_scene(lens_camera(), 2), folder / "red", {.format = SceneFormat::kRedwood}, context);
  const std::string log = read_bytes(folder / "red/trajectory.log");
  const auto expect_bad = [&](const std::string& text, std::initializer_list<std::string> words) {
    write_bytes(folder / "red/trajectory.log", text);
    expect_refused([&] { read_scene(folder / "red", {}, context); }, words);
  };
  expect_bad(log.substr(0, log.size() - 30), {"trajectory.log", "pose"});
  expect_bad("0 0 1\n1 0 0 0\n0 1 0 0\n0 0 -1 0\n0 0 0 1\n", {"trajectory.log", "pose 1", "reflection"});
  expect_bad("7 7 8\n1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n", {"trajectory.log", "frame 7", "2 depth images"});
  write_bytes(folder / "red/trajectory.log", log);
  write_bytes(folder / "red/camera_intrinsic.json", R"({"width":64,"height":48,"intrinsic_matrix":[50,0,0]})");
  expect_refused([&] { read_scene(folder / "red", {}, context); }, {"camera_intrinsic.json", "intrinsic_matrix"});
}

TEST(RgbdNames, OfAnyLengthAreRefusedInOneLine) {
  // Found by the fuzzer: the system does not even look for a name of so many letters, and says so in its own way.
  const TempFolder folder;
  Context context(1);
  const std::string name(5000, 'x');
  write_bytes(folder / "depth.txt", "1.0 " + name + "\n");
  write_bytes(folder / "groundtruth.txt", "1.0 0 0 0 0 0 0 1\n");
  expect_refused([&] { read_scene(folder / "", {}, context); }, {"no such file"});
  write_bytes(folder / "transforms.json",
              R"({"fl_x": 8, "cx": 2, "cy": 1.5, "w": 4, "h": 3, "frames": [{"depth_file_path": ")" + name +
                  R"(", "transform_matrix": [[1,0,0,0],[0,1,0,0],[0,0,1,0]]}]})");
  expect_refused([&] { read_scene(folder / "transforms.json", {}, context); }, {"no such file"});
}

template <typename Stored>
std::string npy(const std::string& header, const std::vector<Stored>& values) {
  std::string bytes = "\x93NUMPY\x01";
  bytes += '\0';
  bytes += char(header.size());
  bytes += '\0';
  bytes += header;
  return bytes.append(reinterpret_cast<const char*>(values.data()), values.size() * sizeof(Stored));
}

TEST(Nerfstudio, DepthOfNumPy) {
  const TempFolder folder;
  Context context(1);
  write_bytes(folder / "transforms.json",
              R"({"fl_x": 8, "cx": 2, "cy": 1.5, "w": 4, "h": 3, "depth_unit_scale_factor": 0.5, "frames": [
 {"depth_file_path": "d.npy", "transform_matrix": [[1,0,0,0],[0,1,0,0],[0,0,1,0]]}]})");
  const auto expect_read = [&](const std::string& bytes, Pixels<float> expected) {
    write_bytes(folder / "d.npy", bytes);
    const View view = load_view(read_scene(folder / "transforms.json", {}, context).views[0]);
    EXPECT_EQ(view.range.pixels, expected);
  };
  const std::vector<float> f4{1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 0, -1};
  const Pixels<float> half{0.5f, 1, 1.5f, 2, 2.5f, 3, 3.5f, 4, 4.5f, 5, 0, 0};
  expect_read(npy("{'descr': '<f4', 'fortran_order': False, 'shape': (3, 4), }\n", f4), half);
  expect_read(
      npy("{'descr': '<f8', 'fortran_order': False, 'shape': (3, 4, 1)}", std::vector<double>(f4.begin(), f4.end())),
      half);
  expect_read(npy("{'shape': (3, 4), 'fortran_order': True, 'descr': '<u2'}",
                  std::vector<std::uint16_t>{1, 5, 9, 2, 6, 10, 3, 7, 0, 4, 8, 0}),
              half);
  const auto expect_bad = [&](const std::string& bytes, const char* problem) {
    write_bytes(folder / "d.npy", bytes);
    expect_refused([&] { read_scene(folder / "transforms.json", {}, context); }, {"d.npy", "'d'", problem});
  };
  expect_bad(npy("{'descr': '>f4', 'fortran_order': False, 'shape': (3, 4)}", f4), "'>f4'");
  expect_bad(npy("{'descr': '<f4', 'fortran_order': False, 'shape': (12,)}", f4), "(height, width)");
  expect_bad(npy("{'descr': '<f4', 'fortran_order': False, 'shape': (3, 5)}", f4), "length");
  expect_bad(npy("{'descr': '<f4', 'fortran_order': False, 'shape': (3, 99999999)}", f4), "claims");
  expect_bad(npy("{'descr': '<f4', 'fortran_order': False}", f4), "shape");
  expect_bad(std::string("\x93NUMPY\x01\0\xFF\xFF{}", 12), "truncated");
}

TEST(Nerfstudio, MistakesAreNamed) {
  const TempFolder folder;
  Context context(1);
  convert_scene(room_scene(lens_camera(), 2), folder / "nerf", {.format = SceneFormat::kNerfstudio}, context);
  const std::string good = read_bytes(folder / "nerf/transforms.json");
  const auto expect_bad = [&](const std::string& from, const std::string& to,
                              std::initializer_list<std::string> words) {
    std::string text = good;
    const std::size_t at = text.find(from);
    ASSERT_NE(at, std::string::npos) << from;
    write_bytes(folder / "nerf/transforms.json", text.replace(at, from.size(), to));
    expect_refused([&] { read_scene(folder / "nerf", {}, context); }, words);
  };
  expect_bad("\"OPENCV\"", "\"OPENCV_FISHEYE\"", {"transforms.json", "frames[0]", "fisheye"});
  expect_bad("\"fl_x\"", "\"flx\"", {"transforms.json", "frames[0]", "fl_x", "missing"});
  expect_bad("\"depth_file_path\"", "\"depth\"", {"frames[0]", "depth_file_path"});
  expect_bad("\"transform_matrix\"", "\"matrix\"", {"frames[0]", "transform_matrix"});
  expect_bad("\"w\": 64", "\"w\": -3", {"frames[0]", "w", "pixels"});
}

}  // namespace
}  // namespace lapseam::test
