#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <numbers>

#include "lapseam/error.h"
#include "simulate/coverage.h"
#include "simulate/free_space.h"
#include "support.h"

namespace lapseam {
namespace {

using Eigen::Vector3d;
using Eigen::Vector3f;

Vector3d forward_of(const ViewSource& view) { return view.T_world_view.linear().col(2); }

/// Share of the surface that can be seen from free space at all which some view measures.
double seen_share(const SimulatedScene& scene, const std::vector<SimulatedView>& views, Context& context) {
  const RayScene rays(scene.mesh.positions_m, scene.mesh.triangles, context);
  const auto samples = simulation::sample_surface(scene.mesh, 20000, 77);
  Eigen::AlignedBox3f box;
  for (const Vector3f& p : scene.mesh.positions_m) box.extend(p);
  box.min() += Vector3f(0.2f, 0.2f, 0.45f), box.max() -= Vector3f(0.2f, 0.2f, 0.6f);
  const simulation::FreeSpace space(rays, box, 0.25f, context);
  std::vector<int> can_be_seen(samples.points.size(), 0), is_seen(samples.points.size(), 0);
  for (std::size_t i = 0; i < space.cells().size(); i += space.cells().size() / 250) {
    // At least 10° above the surface; nearer views of what lies farther are free to come.
    const simulation::SightLimits limits{0.4f, 4.5f, 0.17f};
    for (const auto s : simulation::find_visible(samples, rays, space.center(space.cells()[i]), limits))
      can_be_seen[s] = 1;
  }
  for (const SimulatedView& out : views) {
    const Eigen::Isometry3d T_view_world = out.T_world_view_true.inverse();
    for (std::size_t s = 0; s < samples.points.size(); ++s) {
      const Vector3d p = samples.points[s].cast<double>();
      const auto at = project(out.view.sensor, T_view_world * p);
      if (!at) continue;
      const int u = int(std::lround(at->u)), v = int(std::lround(at->v));
      if (u < 0 || v < 0 || u >= out.true_range.width || v >= out.true_range.height) continue;
      const Vector3d to_eye = (out.T_world_view_true.translation() - p).normalized();
      const double cosine = to_eye.dot(samples.normals[s].cast<double>());
      // Within a pixel, range changes by the pixel's width over the slope.
      const double tolerance = 0.003 + at->r * 0.003 / std::max(cosine, 0.05);
      if (cosine > 0.05 && std::abs(double(out.true_range.at(u, v)) - at->r) < tolerance) is_seen[s] = 1;
    }
  }
  double can = 0, both = 0;
  for (std::size_t s = 0; s < can_be_seen.size(); ++s) can += can_be_seen[s], both += can_be_seen[s] && is_seen[s];
  return both / can;
}

class Walk : public testing::TestWithParam<std::uint64_t> {};

TEST_P(Walk, StaysInFreeSpaceTurnsGentlyAndSeesTheRoom) {
  Context context;
  const SimulatedScene room = make_room({.seed = GetParam()});
  SensorRig rig = make_rgbd_rig(320, 240);
  rig.color.reset();
  const auto plan = make_trajectory(room, rig, {.kind = Trajectory::kWalk, .views = 100, .seed = GetParam()}, context);
  ASSERT_EQ(plan.size(), 100u);
  const RayScene rays(room.mesh.positions_m, room.mesh.triangles, context);
  for (std::size_t i = 0; i < plan.size(); ++i) {
    const Vector3d eye = plan[i].T_world_view.translation();
    // 25 cm on the 10 cm grid; between its points half a diagonal may be lost.
    EXPECT_GT(rays.closest(eye.cast<float>()).distance, 0.25f - 0.0867f) << i;
    EXPECT_TRUE(eye.x() > 0 && eye.x() < 6 && eye.y() > 0 && eye.y() < 5 && eye.z() > 0.4 && eye.z() < 2.3);
    EXPECT_NEAR(plan[i].T_world_view.linear().determinant(), 1, 1e-12);
    if (i == 0) continue;
    const double step = (eye - plan[i - 1].T_world_view.translation()).norm();
    const double turn = std::acos(std::clamp(forward_of(plan[i]).dot(forward_of(plan[i - 1])), -1.0, 1.0));
    EXPECT_LT(step, 1.0) << i;
    // What a brisk hand does on that way, and three deviations of its tremor.
    EXPECT_LT(turn, (25 + 70 * step) * std::numbers::pi / 180 + 0.12) << i;
  }
  const auto views = simulate_views(room, plan, scaled(rig.effects, 0), 1, context);
  double filled = 0;
  for (const SimulatedView& out : views) {
    const double share = double(test::count_samples(out.view.range)) / double(out.view.range.size());
    // A view down the length of the room may lose what lies beyond 4.5 m.
    EXPECT_GT(share, 0.35);
    filled += share / double(views.size());
  }
  EXPECT_GT(filled, 0.85);
  const double share = seen_share(room, views, context);
  RecordProperty("seen_share", std::to_string(share));
  EXPECT_GT(share, 0.95);
}

INSTANTIATE_TEST_SUITE_P(Seeds, Walk, testing::Values(1, 2));

TEST(Walk, AnyNumberOfViews) {
  Context context;
  const SimulatedScene room = make_room({.width_m = 9, .depth_m = 7, .height_m = 3, .seed = 6});
  for (const int views : {1, 2, 7})
    EXPECT_EQ(make_trajectory(room, make_rgbd_rig(64, 48), {.kind = Trajectory::kWalk, .views = views}, context).size(),
              std::size_t(views));
}

TEST(Walk, RefusesWhereNoOneCanWalk) {
  Context context;
  const SimulatedScene box = make_box_scene({0.2, 0.2, 0.2});
  EXPECT_THROW(make_trajectory(box, make_rgbd_rig(64, 48), {.kind = Trajectory::kWalk}, context), InvalidInput);
  // There is room within a closed sphere, but all that it shows there is its back.
  const SimulatedScene sphere = make_sphere_scene(2);
  for (const Trajectory kind : {Trajectory::kWalk, Trajectory::kStations})
    EXPECT_THROW(make_trajectory(sphere, make_rgbd_rig(64, 48), {.kind = kind, .views = 3}, context), InvalidInput);
  EXPECT_THROW(make_trajectory(make_room(), make_ortho_rig(64, 48, 1), {.kind = Trajectory::kWalk}, context),
               InvalidInput);
}

TEST(Stations, StandUprightApartAndSeeMost) {
  Context context;
  const SimulatedScene room = make_room();
  SensorRig rig = make_laser_rig(600, 300);
  rig.color.reset();
  const auto plan = make_trajectory(room, rig, {.kind = Trajectory::kStations, .views = 4}, context);
  ASSERT_EQ(plan.size(), 4u);
  const RayScene rays(room.mesh.positions_m, room.mesh.triangles, context);
  for (std::size_t i = 0; i < 4; ++i) {
    const Vector3d eye = plan[i].T_world_view.translation();
    EXPECT_GT(rays.closest(eye.cast<float>()).distance, 0.5f - 1e-4f);
    EXPECT_TRUE(eye.z() >= 1.29 && eye.z() <= 1.61);
    EXPECT_NEAR(plan[i].T_world_view.linear()(2, 2), 1, 1e-12);
    for (std::size_t j = 0; j < i; ++j) EXPECT_GT((eye - plan[j].T_world_view.translation()).norm(), 0.8);
  }
  EXPECT_GT(seen_share(room, simulate_views(room, plan, scaled(rig.effects, 0), 1, context), context), 0.75);
}

TEST(Orbit, RingsLookAtTheMiddleAndHoldTheObject) {
  Context context;
  const SimulatedScene sphere = make_sphere_scene(0.3);
  SensorRig rig = make_rgbd_rig(200, 150);
  rig.color.reset();
  for (const auto& [views, rings] : {std::pair{12, 1}, {11, 3}, {5, 5}, {40, 4}}) {
    const auto plan =
        make_trajectory(sphere, rig, {.kind = Trajectory::kOrbit, .views = views, .rings = rings}, context);
    ASSERT_EQ(plan.size(), std::size_t(views));
    std::vector<int> heights;
    for (const ViewSource& view : plan) {
      const Vector3d eye = view.T_world_view.translation();
      EXPECT_NEAR(forward_of(view).dot(-eye.normalized()), 1, 1e-12);
      heights.push_back(int(std::lround(eye.z() * 1e6)));
    }
    std::sort(heights.begin(), heights.end());
    EXPECT_EQ(std::unique(heights.begin(), heights.end()) - heights.begin(), rings);
    const auto out = simulate_views(sphere, {plan[0]}, {}, 1, context);
    const auto& range = out[0].true_range;
    // The border is empty: the whole sphere is in the picture.
    for (int u = 0; u < range.width; ++u) EXPECT_EQ(range.at(u, 0) + range.at(u, range.height - 1), 0);
    EXPECT_GT(test::count_samples(range), 200u * 150u / 4);
  }
  EXPECT_THROW(make_trajectory(sphere, rig, {.kind = Trajectory::kOrbit, .views = 3, .rings = 4}, context),
               InvalidInput);
}

TEST(Axes, FacesThenCornersThenEdges) {
  Context context;
  const SimulatedScene box = make_box_scene();
  const auto plan = make_trajectory(box, make_ortho_rig(64, 48, 1), {.kind = Trajectory::kAxes, .views = 26}, context);
  for (std::size_t i = 0; i < 26; ++i) {
    const Vector3d d = plan[i].T_world_view.translation().normalized();
    const double expected = i < 6 ? 1 : i < 14 ? 1 / std::sqrt(3.0) : 1 / std::sqrt(2.0);
    EXPECT_NEAR(d.cwiseAbs().maxCoeff(), expected, 1e-9) << i;
    for (std::size_t j = 0; j < i; ++j) EXPECT_LT(d.dot(plan[j].T_world_view.translation().normalized()), 0.9);
  }
  EXPECT_THROW(make_trajectory(box, make_ortho_rig(64, 48, 1), {.kind = Trajectory::kAxes, .views = 27}, context),
               InvalidInput);
}

class PoseFile : public testing::Test {
 protected:
  void write(const std::string& text) { std::ofstream(file_) << text; }
  void TearDown() override { std::filesystem::remove(file_); }
  std::filesystem::path file_ =
      std::filesystem::path(testing::TempDir()) / ("lapseam_poses_" + test::process_id() + ".txt");
};

TEST_F(PoseFile, ReadsQuaternionsAndMatrices) {
  write(
      "# two poses\n1 2 3 0 0 0.70710678118654752 0.70710678118654752\n\n0 -1 0 1  1 0 0 2  0 0 1 3  0 0 0 1 # same\n");
  const auto plan = read_trajectory(file_, make_rgbd_rig(64, 48));
  ASSERT_EQ(plan.size(), 2u);
  EXPECT_TRUE(plan[0].T_world_view.isApprox(plan[1].T_world_view, 1e-12));
  EXPECT_TRUE((plan[0].T_world_view * Vector3d(1, 0, 0)).isApprox(Vector3d(1, 3, 3), 1e-12));
  EXPECT_EQ(plan[1].name, "001");
}

TEST_F(PoseFile, NamesFileAndLineOfWhatIsWrong) {
  const SensorRig rig = make_rgbd_rig(64, 48);
  for (const char* text : {"1 2 3\n", "1 2 3 0 0 0 0.5\n", "1 2 x 0 0 0 1\n", "nan 2 3 0 0 0 1\n",
                           "2 0 0 0  0 1 0 0  0 0 1 0  0 0 0 1\n", "-1 0 0 0  0 1 0 0  0 0 1 0  0 0 0 1\n"}) {
    write(text);
    try {
      read_trajectory(file_, rig);
      ADD_FAILURE() << text;
    } catch (const InvalidInput& error) {
      EXPECT_NE(std::string(error.what()).find("line 1"), std::string::npos) << error.what();
      EXPECT_NE(std::string(error.what()).find("lapseam_poses_"), std::string::npos) << error.what();
    }
  }
  write("# nothing\n");
  EXPECT_THROW(read_trajectory(file_, rig), InvalidInput);
  EXPECT_THROW(read_trajectory("no such file", rig), IoError);
}

}  // namespace
}  // namespace lapseam
