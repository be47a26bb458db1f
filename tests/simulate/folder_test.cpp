#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <iterator>
#include <map>

#include "lapseam/error.h"
#include "lapseam/io.h"
#include "support.h"

namespace lapseam {
namespace {

namespace fs = std::filesystem;

class Folder : public testing::Test {
 protected:
  void SetUp() override {
    folder_ = fs::path(testing::TempDir()) /
              (std::string("lapseam_simulate_") + testing::UnitTest::GetInstance()->current_test_info()->name() + "_" +
               test::process_id());
    fs::remove_all(folder_);
  }
  void TearDown() override { fs::remove_all(folder_); }

  static std::map<std::string, std::string> contents(const fs::path& folder) {
    std::map<std::string, std::string> out;
    for (const auto& entry : fs::recursive_directory_iterator(folder)) {
      if (!entry.is_regular_file()) continue;
      std::ifstream in(entry.path(), std::ios::binary);
      out[fs::relative(entry.path(), folder).string()] = {std::istreambuf_iterator<char>(in), {}};
    }
    return out;
  }

  fs::path folder_;
};

TEST_F(Folder, ComesBackAsItWasMeasured) {
  Context context;
  const SimulatedScene scene = make_partition_scene();
  SensorRig rig = make_rgbd_rig(160, 120);
  rig.effects.pose_sigma_m = 0.01, rig.effects.pose_sigma_rad = 0.01, rig.effects.exposure_sigma = 0.1;
  const auto plan = make_trajectory(scene, rig, {.kind = Trajectory::kWalk, .views = 5}, context);
  const auto views = simulate_views(scene, plan, rig.effects, 4, context);
  for (const RangeFormat format : {RangeFormat::kExr, RangeFormat::kPng16}) {
    const auto folder = folder_ / (format == RangeFormat::kExr ? "exr" : "png");
    const auto report =
        simulate_to_folder(scene, plan, rig.effects, folder, {.range_format = format, .seed = 4}, context);
    EXPECT_EQ(report.views, 5u);
    const Scene measured = read_scene(folder / "scene.json", {}, context);
    const Scene truth = read_scene(folder / "truth" / "scene.json", {}, context);
    ASSERT_EQ(measured.views.size(), 5u);
    ASSERT_EQ(truth.views.size(), 5u);
    std::size_t samples = 0;
    for (std::size_t i = 0; i < 5; ++i) {
      const View view = load_view(measured.views[i]), exact = load_view(truth.views[i]);
      EXPECT_EQ(view.name, views[i].view.name);
      EXPECT_TRUE(view.T_world_view.isApprox(views[i].view.T_world_view, 1e-12));
      EXPECT_TRUE(exact.T_world_view.isApprox(views[i].T_world_view_true, 1e-12));
      EXPECT_FALSE(exact.T_world_view.isApprox(view.T_world_view, 1e-5));
      EXPECT_TRUE(test::have_same_bytes(exact.range, views[i].true_range));
      // PNG holds 4.5 m in steps of 0.1 mm.
      const double tolerance = format == RangeFormat::kExr ? 0 : 0.51e-4;
      for (std::size_t k = 0; k < view.range.size(); ++k)
        ASSERT_NEAR(double(view.range.pixels[k]), double(views[i].view.range.pixels[k]), tolerance);
      EXPECT_TRUE(test::have_same_bytes(load_color(measured.views[i]), views[i].color));
      EXPECT_FALSE(measured.views[i].noise);
      samples += test::count_samples(view.range);
    }
    EXPECT_EQ(report.samples, samples);
    const Mesh mesh = read_mesh(folder / "truth" / "mesh.ply");
    EXPECT_EQ(mesh.triangles, scene.mesh.triangles);
    EXPECT_EQ(mesh.positions_m, scene.mesh.positions_m);
    EXPECT_EQ(mesh.colors, scene.mesh.colors);
  }
}

TEST_F(Folder, HasTheSameBytesForAnyNumberOfThreads) {
  const SimulatedScene scene = make_partition_scene();
  const SensorRig rig = make_laser_rig(160, 80);
  std::map<std::string, std::string> first;
  allow_threads(8);  // or threads beyond the processors would not be made
  for (const int threads : {1, 2, 3, 8}) {
    Context context(threads);
    const auto plan = make_trajectory(scene, rig, {.kind = Trajectory::kStations, .views = 4}, context);
    const fs::path folder = folder_ / std::to_string(threads);
    simulate_to_folder(scene, plan, rig.effects, folder, {}, context);
    const auto files = contents(folder);
    if (first.empty()) first = files;
    EXPECT_EQ(files.size(), 4u * 3 + 4);
    EXPECT_EQ(files, first) << threads;
  }
}

TEST_F(Folder, LeavesOutEmptyViewsAndOptionalParts) {
  Context context;
  const SimulatedScene wall = test::make_wall();
  const SensorRig rig = make_rgbd_rig(40, 30);
  std::vector<ViewSource> plan(3, test::look_down_from(rig, {0, 0, 2}));
  plan[1].T_world_view.translation().z() = 50;  // out of range
  for (std::size_t i = 0; i < 3; ++i) plan[i].name = "v" + std::to_string(i);
  const auto report =
      simulate_to_folder(wall, plan, rig.effects, folder_, {.has_color = false, .declares_noise = true}, context);
  EXPECT_EQ(report.views, 2u);
  EXPECT_EQ(report.empty_views, 1u);
  EXPECT_EQ(context.warnings().size(), 1u);
  EXPECT_FALSE(fs::exists(folder_ / "color"));
  const Scene scene = read_scene(folder_, {}, context);
  ASSERT_EQ(scene.views.size(), 2u);
  EXPECT_EQ(scene.views[1].name, "v2");
  EXPECT_FALSE(scene.views[0].color);
  ASSERT_TRUE(scene.views[0].noise);
  EXPECT_DOUBLE_EQ(scene.views[0].noise->sigma(3.0), rig.effects.noise.sigma(3.0));

  plan = {plan[1]};
  EXPECT_THROW(simulate_to_folder(wall, plan, rig.effects, folder_, {}, context), InvalidInput);
  EXPECT_THROW(simulate_to_folder(wall, {}, rig.effects, folder_, {}, context), InvalidInput);
  plan[0].T_world_view.translation().z() = 2;
  EXPECT_THROW(simulate_to_folder(wall, plan, rig.effects, "/proc/no/such/place", {}, context), IoError);
}

TEST_F(Folder, StopsWhenCancelled) {
  Context context;
  const SimulatedScene wall = test::make_wall();
  const SensorRig rig = make_rgbd_rig(40, 30);
  const std::vector<ViewSource> plan(50, test::look_down_from(rig, {0, 0, 2}));
  context.set_progress_sink([&](const Progress& progress) {
    if (progress.stage == "simulate") context.cancel();
  });
  EXPECT_THROW(simulate_to_folder(wall, plan, rig.effects, folder_, {}, context), Cancelled);
  EXPECT_FALSE(fs::exists(folder_ / "scene.json"));
}

}  // namespace
}  // namespace lapseam
