#include "io/colmap.h"

#include <cstring>

#include "bytes.h"
#include "room_scene.h"

namespace lapseam::test {
namespace {

std::string depth_map(int width, int height) {
  std::string bytes = std::to_string(width) + "&" + std::to_string(height) + "&1&";
  for (int i = 0; i < width * height; ++i) append(bytes, i % 5 ? 1.0f + float(i) : 0.0f);
  return bytes;
}

class Colmap : public testing::Test {
 protected:
  void SetUp() override {
    write_bytes(folder_ / "stereo/depth_maps/a.jpg.geometric.bin", depth_map(8, 6));
    write_bytes(folder_ / "stereo/depth_maps/b c.jpg.photometric.bin", depth_map(4, 3));
  }
  void write_text() {
    write_bytes(folder_ / "sparse/cameras.txt", "# cameras\n3 OPENCV 8 6 10 11 4.5 3.5 0.1 0.2 0.01 0.02\n");
    write_bytes(
        folder_ / "sparse/images.txt",
        "# images\n1 1 0 0 0 1 2 3 3 a.jpg\n10 20 -1\n2 0 0 0 1 1 2 3 3 b c.jpg\n\n3 1 0 0 0 0 0 0 3 lost.jpg\n\n");
  }
  void expect_scene() {
    const Scene scene = read_scene(folder_.path(), {}, context_);
    ASSERT_EQ(scene.views.size(), 2u);
    EXPECT_EQ(scene.views[1].name, "b c.jpg");
    // World to camera in the file; here turned round. A half turn about z: x' = 1 of −x + 1.
    EXPECT_TRUE(scene.views[0].T_world_view.translation().isApprox(Eigen::Vector3d(-1, -2, -3), 1e-12));
    EXPECT_TRUE(scene.views[1].T_world_view.translation().isApprox(Eigen::Vector3d(1, 2, -3), 1e-12));
    const auto& full = std::get<PinholeSensor>(*scene.views[0].sensor);
    EXPECT_EQ(full.cx, 4.0);  // centres are at 0.5 in the file
    EXPECT_EQ(full.distortion.p2, 0.02);
    const auto& half = std::get<PinholeSensor>(*scene.views[1].sensor);
    EXPECT_EQ(half.fx, 5.0);
    EXPECT_EQ(half.cx, 1.75);
    const View view = load_view(scene.views[0]);
    EXPECT_EQ(view.range.at(1, 2), 18.0f);
    EXPECT_EQ(view.missing.zero, 10u);
  }

  TempFolder folder_;
  Context context_{1};
};

TEST_F(Colmap, TextModel) {
  write_text();
  expect_scene();
  ASSERT_EQ(context_.warnings().size(), 1u);
  EXPECT_NE(context_.warnings()[0].find("1 images have no depth map"), std::string::npos);
}

TEST_F(Colmap, BinaryModel) {
  std::string cameras, images;
  append(cameras, std::uint64_t(1));
  append(cameras, std::uint32_t(3));
  append(cameras, std::uint32_t(4));
  append(cameras, std::uint64_t(8));
  append(cameras, std::uint64_t(6));
  for (const double value : {10.0, 11.0, 4.5, 3.5, 0.1, 0.2, 0.01, 0.02}) append(cameras, value);
  append(images, std::uint64_t(2));
  for (std::uint32_t i = 0; i < 2; ++i) {
    append(images, i + 1);
    for (const double value : {i ? 0.0 : 1.0, 0.0, 0.0, i ? 1.0 : 0.0, 1.0, 2.0, 3.0}) append(images, value);
    append(images, std::uint32_t(3));
    images += i ? std::string("b c.jpg") : std::string("a.jpg");
    images += '\0';
    append(images, std::uint64_t(1));
    images += std::string(24, 'x');
  }
  write_bytes(folder_ / "sparse/0/cameras.bin", cameras);
  write_bytes(folder_ / "sparse/0/images.bin", images);
  expect_scene();
  for (std::size_t length = 0; length + 1 < images.size(); length += 7) {
    write_bytes(folder_ / "sparse/0/images.bin", images.substr(0, length));
    expect_refused([&] { read_scene(folder_.path(), {}, context_); }, {"images.bin", "truncated"});
  }
  images[0] = '\xFF';
  write_bytes(folder_ / "sparse/0/images.bin", images);
  expect_refused([&] { read_scene(folder_.path(), {}, context_); }, {"images.bin", "truncated"});
}

TEST_F(Colmap, MistakesAreNamed) {
  const auto expect_bad = [&](const std::string& camera, std::initializer_list<std::string> words) {
    write_text();
    write_bytes(folder_ / "sparse/cameras.txt", camera);
    expect_refused([&] { read_scene(folder_.path(), {}, context_); }, words);
  };
  expect_bad("3 OPENCV_FISHEYE 8 6 10 11 4 3 0 0 0 0\n", {"cameras.txt", "line 1", "fisheye"});
  expect_bad("3 PINHOLE 8 6 10 11\n", {"cameras.txt", "line 1", "number"});
  expect_bad("3 PINHOLE 8 6 -10 11 4 3\n", {"cameras.txt", "focal length"});
  expect_bad("4 PINHOLE 8 6 10 11 4 3\n", {"'a.jpg'", "there is no camera 3"});
  write_text();
  write_bytes(folder_ / "stereo/depth_maps/a.jpg.geometric.bin", depth_map(8, 6).substr(0, 60));
  expect_refused([&] { read_scene(folder_.path(), {}, context_); }, {"a.jpg.geometric.bin", "size"});
}

}  // namespace
}  // namespace lapseam::test
