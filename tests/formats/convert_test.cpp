#include "lapseam/convert.h"

#include "io/output_folder.h"
#include "room_scene.h"

namespace lapseam::test {
namespace {

TEST(Convert, AFolderOfSomebodyElseIsLeftAlone) {
  const TempFolder folder;
  Context context(1);
  write_bytes(folder / "photos/mine.jpg", "x");
  EXPECT_THROW(convert_scene(room_scene(lens_camera(), 1), folder / "photos", {}, context), IoError);
  EXPECT_EQ(read_bytes(folder / "photos/mine.jpg"), "x");
  write_bytes(folder / "file", "x");
  EXPECT_THROW(convert_scene(room_scene(lens_camera(), 1), folder / "file", {}, context), IoError);
}

TEST(Convert, AFailedRunLeavesTheOldFolderWhole) {
  const TempFolder folder;
  Context context(1);
  convert_scene(room_scene(lens_camera(), 2), folder / "out", {}, context);
  const std::string before = read_bytes(folder / "out/scene.json");
  Scene bad = room_scene(lens_camera(), 3);
  bad.views[2].range.memory = std::make_shared<RangeImage>(64, 48);
  expect_refused([&] { convert_scene(bad, folder / "out", {}, context); }, {"'view2'", "no valid sample"});
  EXPECT_EQ(read_bytes(folder / "out/scene.json"), before);
  EXPECT_FALSE(std::filesystem::exists(folder / ".out.part"));
  // What is bad may be left out instead; then the folder is replaced.
  const ConvertReport report = convert_scene(bad, folder / "out", {.skip_bad_views = true}, context);
  EXPECT_EQ(report.views, 2u);
  EXPECT_EQ(context.warnings().size(), 1u);
}

TEST(Convert, WhatAKilledRunLeftIsInNobodysWay) {
  const TempFolder folder;
  Context context(1);
  write_bytes(folder / ".out.part/range/half.exr", "half");
  convert_scene(room_scene(lens_camera(), 1), (folder / "out").string() + "/", {}, context);
  EXPECT_EQ(read_scene(folder / "out", {}, context).views.size(), 1u);
  EXPECT_FALSE(std::filesystem::exists(folder / ".out.part"));
}

TEST(Convert, TheSameBytesForAnyNumberOfThreads) {
  const TempFolder folder;
  allow_threads(8);  // or threads beyond the processors would not be made
  for (const char* name : {"room.e57", "room.ptx"}) {
    std::string first;
    for (const int threads : {1, 2, 3, 8}) {
      Context context(threads);
      convert_scene(room_scene(small_scanner(), 5), folder / name, {.format = scene_format_of(name)}, context);
      const std::string bytes = read_bytes(folder / name);
      if (threads == 1) first = bytes;
      EXPECT_EQ(bytes, first) << name << ' ' << threads;
    }
  }
}

TEST(Convert, MeasuredGridsKeepTheirColoursInTheirOwnFiles) {
  const TempFolder folder;
  Context context(1);
  SphericalSensor jittered = small_scanner();
  auto warp = std::make_shared<std::vector<Eigen::Vector2f>>(90 * 40);
  for (std::size_t i = 0; i < warp->size(); ++i)
    (*warp)[i] = {0.2f * float(std::sin(0.7 * double(i))), 0.2f * float(std::cos(1.3 * double(i)))};
  jittered.warp = warp;
  expect_round_trip(room_scene(jittered, 2), SceneFormat::kManifest, "scene", 0);
}

TEST(Convert, MapCoordinatesSurvive) {
  // Seven digits before the point, as of a projected map: a float would be off by a quarter of a metre.
  const Eigen::Vector3d far_m(4567890.125, 5432109.5, 300.25);
  const Scene scanners = room_scene(small_scanner(), 2, true, far_m),
              cameras = room_scene(lens_camera(), 2, true, far_m);
  const auto expect_kept = [](const Scene& scene, SceneFormat format, const char* name, double quantum_m) {
    SCOPED_TRACE(name);
    // Names of scans are not kept by PTX.
    expect_round_trip(scene, format, name, quantum_m, format != SceneFormat::kPtx);
  };
  expect_kept(scanners, SceneFormat::kManifest, "scene", 1e-12);
  expect_kept(scanners, SceneFormat::kE57, "a.e57", 1e-12);
  expect_kept(scanners, SceneFormat::kPtx, "a.ptx", 2e-6);
  expect_kept(cameras, SceneFormat::kPcd, "pcd", 1e-4);
  expect_kept(cameras, SceneFormat::kTum, "tum", 0.6 / 5000 * 1.3);
  expect_kept(cameras, SceneFormat::kRedwood, "redwood", 0.6 / 1000 * 1.3);
  expect_kept(cameras, SceneFormat::kNerfstudio, "nerf", 0.6 / 1000 * 1.3);
}

TEST(Convert, FormatsByName) {
  EXPECT_EQ(scene_format_of("a.E57"), SceneFormat::kE57);
  EXPECT_EQ(scene_format_of("a/b"), SceneFormat::kManifest);
  for (const std::string_view name : scene_format_names()) EXPECT_NO_THROW(scene_format_named(name));
  expect_refused([] { scene_format_named("las"); }, {"las"});
}

}  // namespace
}  // namespace lapseam::test
