#include "io/pcd.h"

#include <cstring>

#include "room_scene.h"

namespace lapseam::test {
namespace {

std::string header(const std::string& data, const std::string& size = "WIDTH 6\nHEIGHT 5\n") {
  return "# .PCD v.7\nVERSION .7\nFIELDS x y z rgb\nSIZE 4 4 4 4\nTYPE F F F U\nCOUNT 1 1 1 1\n" + size +
         "VIEWPOINT 0 0 0 1 0 0 0\nPOINTS 30\nDATA " + data + "\n";
}

Eigen::Vector3f point(int i) {
  const int u = i % 6, v = i / 6;
  const float z = 1.0f + 0.03125f * float((u * 3 + v) % 4);
  return {float(u - 2.5) / 8 * z, float(v - 2) / 8 * z, z};
}

std::string columns() {
  std::string x, y, z, rgb;
  const auto append = [](std::string& out, const auto& value) {
    out.append(reinterpret_cast<const char*>(&value), sizeof value);
  };
  for (int i = 0; i < 30; ++i) {
    append(x, point(i).x());
    append(y, point(i).y());
    append(z, point(i).z());
    append(rgb, std::uint32_t(0x0A141E));
  }
  return x + y + z + rgb;
}

void expect_grid(const std::filesystem::path& file) {
  Context context(1);
  const Scene scene = read_scene(file, {}, context);
  ASSERT_EQ(scene.views.size(), 1u);
  const View view = load_view(scene.views[0]);
  EXPECT_NEAR(std::get<PinholeSensor>(view.sensor).fx, 8, 1e-6);
  for (int i = 0; i < 30; ++i) EXPECT_EQ(view.range.pixels[std::size_t(i)], point(i).z());
  EXPECT_EQ(load_color(scene.views[0]).at(2, 2), (Rgb8{10, 20, 30}));
}

TEST(Pcd, TextBinaryAndCompressed) {
  const TempFolder folder;
  std::string text = header("ascii"), binary = header("binary");
  for (int i = 0; i < 30; ++i) {
    char line[96];
    std::snprintf(line, sizeof line, "%.9g %.9g %.9g 660510\n", double(point(i).x()), double(point(i).y()),
                  double(point(i).z()));
    text += line;
    const std::uint32_t rgb = 0x0A141E;
    binary.append(reinterpret_cast<const char*>(point(i).data()), 12);
    binary.append(reinterpret_cast<const char*>(&rgb), 4);
  }
  write_bytes(folder / "a.pcd", text);
  expect_grid(folder / "a.pcd");
  write_bytes(folder / "a.pcd", binary);
  expect_grid(folder / "a.pcd");

  // LZF by hand: literals in runs of 32, and at the end the colours as one copy of four bytes back and on.
  const std::string body = columns();
  std::string packed;
  const std::size_t literal = 3 * 30 * 4 + 4;
  for (std::size_t at = 0; at < literal; at += 32) {
    const std::size_t count = std::min<std::size_t>(32, literal - at);
    packed += char(count - 1);
    packed += body.substr(at, count);
  }
  const std::size_t copied = body.size() - literal;  // 116 bytes: 7 + 107 + 2
  packed += char(7 << 5 | 0);
  packed += char(copied - 9);
  packed += char(3);
  const std::uint32_t sizes[2] = {std::uint32_t(packed.size()), std::uint32_t(body.size())};
  write_bytes(folder / "a.pcd",
              header("binary_compressed") + std::string(reinterpret_cast<const char*>(sizes), 8) + packed);
  expect_grid(folder / "a.pcd");
}

TEST(Pcd, RoundTrip) {
  // Single precision in the world, whose origin is a few metres away.
  expect_round_trip(room_scene(lens_camera(), 3), SceneFormat::kPcd, "clouds", 1e-6);
  expect_round_trip(room_scene(small_scanner(), 2), SceneFormat::kPcd, "clouds", 1e-6);
}

TEST(Pcd, HostileFiles) {
  const TempFolder folder;
  Context context(1);
  const auto expect_bad = [&](const std::string& text, std::initializer_list<std::string> words) {
    write_bytes(folder / "b.pcd", text);
    expect_refused([&] { load_view(read_scene(folder / "b.pcd", {}, context).views.at(0)); }, words);
  };
  expect_bad(header("binary") + std::string(100, 'x'), {"b.pcd", "DATA", "fewer points"});
  expect_bad(header("binary", "WIDTH 1073741824\nHEIGHT 1073741824\n"), {"b.pcd", "WIDTH"});
  expect_bad(header("binary", "WIDTH 99999999999999\nHEIGHT 5\n"), {"b.pcd", "WIDTH"});
  // The number of bytes would be 2^64, that is none.
  expect_bad(
      "VERSION .7\nFIELDS x y z rgb\nSIZE 4 4 4 4\nTYPE F F F U\nCOUNT 1 1 1 1\nWIDTH 1073741824\nHEIGHT "
      "1073741824\nDATA "
      "binary_compressed\n" +
          std::string(8, '\0'),
      {"b.pcd", "WIDTH", "2^30"});
  expect_bad(header("lzma"), {"b.pcd", "DATA", "ascii"});
  expect_bad(header("ascii") + "1 2 x", {"b.pcd", "DATA"});
  const std::uint32_t sizes[2] = {4, 480};
  const std::string start = header("binary_compressed") + std::string(reinterpret_cast<const char*>(sizes), 8);
  expect_bad(start + "\x20\x05\x20\x05", {"b.pcd", "DATA"});
  expect_bad(start.substr(0, start.size() - 3), {"b.pcd", "DATA"});
  expect_bad("VERSION .7\nFIELDS x y\n", {"b.pcd", "DATA", "missing"});
  expect_bad("VERSION .7\nFIELDS x y\nWIDTH 1\nHEIGHT 1\nDATA ascii\n1 2\n", {"b.pcd", "FIELDS"});
}

}  // namespace
}  // namespace lapseam::test
