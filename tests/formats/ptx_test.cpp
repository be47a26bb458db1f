#include "io/ptx.h"

#include "room_scene.h"

namespace lapseam::test {
namespace {

constexpr const char* kIdentity = "0 0 0\n1 0 0\n0 1 0\n0 0 1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n";

/// columns × rows samples on a polar grid, as text.
std::string body(int columns, int rows, bool has_color) {
  std::string text;
  for (int u = 0; u < columns; ++u) {
    for (int v = 0; v < rows; ++v) {
      const double azimuth = 0.02 * u, elevation = -0.3 + 0.02 * v;
      char line[128];
      std::snprintf(line, sizeof line, "%.6f %.6f %.6f 0.25%s\n", 2 * std::cos(elevation) * std::cos(azimuth),
                    2 * std::cos(elevation) * std::sin(azimuth), 2 * std::sin(elevation), has_color ? " 10 20 30" : "");
      text += line;
    }
  }
  return text;
}

std::string scan(int columns, int rows, bool has_color = false) {
  return std::to_string(columns) + "\n" + std::to_string(rows) + "\n" + kIdentity + body(columns, rows, has_color);
}

TEST(Ptx, RoundTripOfScannersAndCameras) {
  // Coordinates have six digits: half a micrometre each, and what the table of angles makes of it.
  expect_round_trip(room_scene(small_scanner(), 3), SceneFormat::kPtx, "room.ptx", 2e-6, false);
  expect_round_trip(room_scene(lens_camera(), 2), SceneFormat::kPtx, "room.ptx", 2e-6, false);
}

TEST(Ptx, SeveralScansAndIntensityWithoutColour) {
  const TempFolder folder;
  Context context(1);
  write_bytes(folder / "a.txt", scan(12, 9) + "\n" + scan(8, 7, true));
  const Scene scene = read_scene(folder / "a.txt", {}, context);
  ASSERT_EQ(scene.views.size(), 2u);
  const View first = load_view(scene.views[0]), second = load_view(scene.views[1]);
  EXPECT_EQ(first.range.width, 12);
  EXPECT_EQ(second.range.height, 7);
  // Elevations rise along the file's columns, and fall down ours.
  EXPECT_GT(ray_direction(first.sensor, 0, 0).z(), ray_direction(first.sensor, 0, 8).z());
  EXPECT_EQ(load_color(scene.views[0]).at(0, 0), (Rgb8{64, 64, 64}));
  EXPECT_EQ(load_color(scene.views[1]).at(3, 3), (Rgb8{10, 20, 30}));
  // Beside colours as well as in their place.
  EXPECT_EQ(first.intensity.at(0, 0), 64);
  EXPECT_EQ(second.intensity.at(3, 3), 64);
}

TEST(Ptx, IntensitiesComeAlongIntoAFolder) {
  const TempFolder folder;
  Context context(1);
  write_bytes(folder / "a.ptx", scan(8, 7, true));
  const Scene scene = read_scene(folder / "a.ptx", {}, context);
  for (int times = 0; times < 2; ++times) convert_scene(scene, folder / "out", {}, context);
  const Scene back = read_scene(folder / "out", {}, context);
  EXPECT_EQ(load_view(back.views[0]).intensity.pixels, load_view(scene.views[0]).intensity.pixels);
}

TEST(Ptx, AManifestNamesAScanOfTheFile) {
  const TempFolder folder;
  Context context(1);
  write_bytes(folder / "a.ptx", scan(12, 9) + scan(8, 7, true));
  write_scene(read_scene(folder / "a.ptx", {}, context), folder / "scene.json");
  const Scene scene = read_scene(folder / "scene.json", {}, context);
  ASSERT_EQ(scene.views.size(), 2u);
  EXPECT_EQ(load_view(scene.views[1]).range.width, 8);
  EXPECT_EQ(load_color(scene.views[1]).at(3, 3), (Rgb8{10, 20, 30}));
  EXPECT_NE(read_bytes(folder / "scene.json").find("\"index\": 1"), std::string::npos);
}

TEST(Ptx, VoidsAreCounted) {
  const TempFolder folder;
  Context context(1);
  std::string text = scan(12, 9);
  const std::size_t at = text.find(body(12, 9, false));
  const std::size_t end = text.find('\n', at);
  text.replace(at, end - at, "0 0 0 0.5");
  write_bytes(folder / "a.ptx", text);
  const View view = load_view(read_scene(folder / "a.ptx", {}, context).views[0]);
  EXPECT_EQ(view.missing.zero, 1u);
  EXPECT_EQ(view.missing.absent, 0u);
  EXPECT_EQ(view.range.at(0, 8), 0.0f);
}

TEST(Ptx, HostileFiles) {
  const TempFolder folder;
  Context context(1);
  const auto expect_bad = [&](const std::string& text, std::initializer_list<std::string> words) {
    write_bytes(folder / "b.ptx", text);
    expect_refused([&] { read_scene(folder / "b.ptx", {}, context); }, words);
  };
  const std::string good = scan(12, 9);
  expect_bad("1000000\n1000\n" + std::string(kIdentity) + body(12, 9, false), {"b.ptx", "scan 1", "size"});
  expect_bad(good.substr(0, good.rfind('\n', good.size() / 2) + 1), {"b.ptx", "scan 1", "truncated"});
  expect_bad(good.substr(0, good.size() - 12), {"b.ptx", "scan 1", "sample 108"});
  expect_bad("12\n9\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n1 0 0\n", {"b.ptx", "four numbers"});
  expect_bad("12\n9\n0 0 0\n1 0 0\n0 1 0\n0 0 2\n1 0 0 0\n0 1 0 0\n0 0 2 0\n0 0 0 1\n" + body(12, 9, false),
             {"b.ptx", "matrix", "not 1"});
  std::string bad = good;
  bad.replace(bad.find("0.25"), 4, "zero");
  expect_bad(bad, {"b.ptx", "sample 1", "x y z intensity"});
  expect_bad(good + "7\nx\n", {"b.ptx", "rows"});
}

TEST(Ptx, SharedFiles) {
  const std::filesystem::path data = data_folder();
  if (data.empty()) GTEST_SKIP() << "no real scans: set LAPSEAM_DATA";
  Context context(1);
  const auto refused = [&](const char* name, std::initializer_list<std::string> words) {
    expect_refused([&] { read_scene(data / "ptx" / name, {}, context); }, words);
  };
  // Cut out of an airborne cloud: rows and columns are made up.
  refused("1.2-with-color.ptx", {"1.2-with-color.ptx", "neither a camera's nor a polar scanner's"});
  refused("complex-transform.ptx", {"complex-transform.ptx", "4 valid samples"});
  refused("multiple-and-transform.ptx", {"multiple-and-transform.ptx", "matrix"});
  refused("no-color.ptx", {"no-color.ptx", "15 valid samples"});
}

}  // namespace
}  // namespace lapseam::test
