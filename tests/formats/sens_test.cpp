#include "io/sens.h"

#include <zlib.h>

#include <limits>

#include "bytes.h"
#include "io/page_codec.h"
#include "room_scene.h"

namespace lapseam::test {
namespace {

void append_matrix(std::string& bytes, float fx, float cx, float cy) {
  for (const float value : {fx, 0.0f, cx, 0.0f, 0.0f, fx, cy, 0.0f, 0.0f, 0.0f, 1.0f, 0.0f, 0.0f, 0.0f, 0.0f, 1.0f})
    append(bytes, value);
}

constexpr int kWidth = 8, kHeight = 6;

/// Three frames, the second without tracking.
std::string recording(std::int32_t depth_compression) {
  std::string bytes;
  append(bytes, std::uint32_t(4));
  append(bytes, std::uint64_t(7));
  bytes += "Scanner";
  append_matrix(bytes, 20, 7.5, 5.5);
  append_matrix(bytes, 1, 0, 0);
  append_matrix(bytes, 10, 3.5, 2.5);
  append_matrix(bytes, 1, 0, 0);
  append(bytes, std::int32_t(2));
  append(bytes, depth_compression);
  for (const std::uint32_t size : {16u, 12u, unsigned(kWidth), unsigned(kHeight)}) append(bytes, size);
  append(bytes, 1000.0f);
  append(bytes, std::uint64_t(3));
  std::vector<std::uint16_t> depth(kWidth * kHeight, 1500);
  depth[3] = 0;
  depth[4] = 65535;
  const std::vector<char> jpeg = encode_jpeg(ColorImage(16, 12, Rgb8{90, 90, 90}), 95);
  std::string packed(reinterpret_cast<const char*>(depth.data()), depth.size() * 2);
  if (depth_compression == 1) {
    std::vector<Bytef> out(compressBound(packed.size()));
    uLongf size = out.size();
    compress(out.data(), &size, reinterpret_cast<const Bytef*>(packed.data()), packed.size());
    packed.assign(reinterpret_cast<const char*>(out.data()), size);
  }
  for (int i = 0; i < 3; ++i) {
    append_matrix(bytes, i == 1 ? -std::numeric_limits<float>::infinity() : 1, float(i), 0);
    bytes.replace(bytes.size() - 64 + 4 * 2, 4, 4, '\0');  // no shear: the principal point's place is not a pose's
    const auto x = float(i);
    bytes.replace(bytes.size() - 64 + 4 * 3, 4, std::string(reinterpret_cast<const char*>(&x), 4));
    append(bytes, std::uint64_t(0));
    append(bytes, std::uint64_t(0));
    append(bytes, std::uint64_t(jpeg.size()));
    append(bytes, std::uint64_t(packed.size()));
    bytes.append(jpeg.data(), jpeg.size());
    bytes += packed;
  }
  return bytes;
}

TEST(Sens, FramesWithRawAndPackedDepth) {
  for (const std::int32_t compression : {0, 1}) {
    const TempFolder folder;
    Context context(1);
    write_bytes(folder / "a.sens", recording(compression));
    const Scene scene = read_scene(folder / "a.sens", {}, context);
    ASSERT_EQ(scene.views.size(), 2u);
    EXPECT_EQ(scene.views[1].name, "frame-000002");
    EXPECT_EQ(scene.views[1].T_world_view.translation(), Eigen::Vector3d(2, 0, 0));
    ASSERT_EQ(context.warnings().size(), 1u);
    EXPECT_NE(context.warnings()[0].find("1 frames have an infinite pose"), std::string::npos);
    const View view = load_view(scene.views[1]);
    EXPECT_EQ(view.range.at(0, 0), 1.5f);
    EXPECT_EQ(view.missing.zero, 1u);
    EXPECT_EQ(view.missing.named, 1u);
    EXPECT_EQ(load_color(scene.views[1]).width, 16);
    EXPECT_EQ(std::get<PinholeSensor>(scene.views[1].color->camera).fx, 20);

    write_scene(scene, folder / "scene.json");
    const Scene again = read_scene(folder / "scene.json", {}, context);
    EXPECT_EQ(load_view(again.views[1]).range.pixels, view.range.pixels);
    EXPECT_EQ(load_color(again.views[1]).width, 16);
  }
}

TEST(Sens, HostileFiles) {
  const TempFolder folder;
  Context context(1);
  const std::string good = recording(1);
  const auto read_all = [&](const std::string& bytes) {
    write_bytes(folder / "b.sens", bytes);
    const Scene scene = read_scene(folder / "b.sens", {}, context);
    for (const ViewSource& view : scene.views) load_view(view), load_color(view);
  };
  for (std::size_t length = 12; length < good.size(); length += 41)
    expect_refused([&] { read_all(good.substr(0, length)); }, {"b.sens"});
  // Width, number of frames, and bytes of a frame, all far too large.
  const std::size_t sizes = 4 + 8 + 7 + 4 * 64 + 8;
  for (const std::size_t at : {sizes + 8 + 3, sizes + 16 + 4 + 7, sizes + 16 + 4 + 8 + 64 + 16 + 7}) {
    std::string bad = good;
    bad[at] = '\x7F';
    expect_refused([&] { read_all(bad); }, {"b.sens"});
  }
  std::string bad = good;
  bad[bad.size() - 5] = char(bad[bad.size() - 5] ^ 0x55);
  expect_refused([&] { read_all(bad); }, {"b.sens", "depth", "damaged"});
}

}  // namespace
}  // namespace lapseam::test
