#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "lapseam/error.h"
#include "support.h"

namespace lapseam {
namespace {

using Eigen::Vector3d;
using test::look_down_from;
using test::make_wall;
using test::no_effects;

SimulatedView simulate_one(const SimulatedScene& scene, const ViewSource& view, const SensorEffects& effects,
                           std::uint64_t seed = 1, int threads = 0) {
  Context context(threads);
  return std::move(simulate_views(scene, {view}, effects, seed, context).front());
}

// ---- truth

TEST(Truth, PlaneBeforeEverySensor) {
  const SimulatedScene wall = make_wall();
  const Vector3d eye(0.3, -0.2, 2.5);
  for (const SensorRig& rig : {make_rgbd_rig(160, 120), make_ortho_rig(160, 120, 1.0), make_laser_rig(160, 80)}) {
    ViewSource view = look_down_from(rig, eye);
    // A tilted sensor; the laser as well, so that its rays below the horizon meet the wall.
    view.T_world_view.linear() =
        view.T_world_view.linear() * Eigen::AngleAxisd(0.4, Vector3d(1, 1, 0).normalized()).toRotationMatrix();
    const SimulatedView out = simulate_one(wall, view, no_effects());
    std::size_t checked = 0;
    for (int v = 0; v < out.true_range.height; ++v)
      for (int u = 0; u < out.true_range.width; ++u) {
        const float r = out.true_range.at(u, v);
        if (!(r > 0)) continue;
        const Vector3d p = out.T_world_view_true * unproject(rig.sensor, u, v, double(r));
        // A float range is exact to 6e-8 of itself.
        EXPECT_NEAR(p.z(), 0, 1e-6 + 2e-7 * double(r)) << rig.id;
        EXPECT_EQ(out.view.range.at(u, v), r);
        ++checked;
      }
    EXPECT_GT(checked, 2000u) << rig.id;
  }
}

TEST(Truth, SphereFromSixSides) {
  Context context;
  const double radius = 0.5;
  const SimulatedScene scene = make_sphere_scene(radius);
  SensorRig rig = make_rgbd_rig(200, 160);
  rig.color.reset();
  const auto plan = make_trajectory(scene, rig, {.kind = Trajectory::kAxes, .views = 6}, context);
  ASSERT_EQ(plan.size(), 6u);
  for (const SimulatedView& out : simulate_views(scene, plan, no_effects(), 1, context)) {
    std::size_t checked = 0;
    for (int v = 0; v < out.true_range.height; ++v)
      for (int u = 0; u < out.true_range.width; ++u) {
        const float z = out.true_range.at(u, v);
        if (!(z > 0)) continue;
        const Vector3d p = out.T_world_view_true * unproject(out.view.sensor, u, v, double(z));
        EXPECT_NEAR(p.norm(), radius, 1e-5);
        const Vector3d origin = out.T_world_view_true.translation(), ray = (p - origin).normalized();
        const double middle = -origin.dot(ray), squared = radius * radius - (origin + middle * ray).squaredNorm();
        if (squared < 0.04 * radius * radius) continue;  // towards the rim the ray runs along the surface
        EXPECT_NEAR((p - origin).norm(), middle - std::sqrt(squared), 4e-5);
        ++checked;
      }
    EXPECT_GT(checked, 5000u);
  }
}

TEST(Truth, FollowsAnOffsetMesh) {
  SimulatedScene near = make_wall(5), far = near;
  const Vector3d origin(4e5, -7e5, 300);
  far.mesh.origin_m = origin;
  const SensorRig rig = make_rgbd_rig(64, 48);
  const auto a = simulate_one(near, look_down_from(rig, {0, 0, 2}), no_effects());
  const auto b = simulate_one(far, look_down_from(rig, origin + Vector3d(0, 0, 2)), no_effects());
  for (std::size_t i = 0; i < a.true_range.size(); ++i)
    EXPECT_NEAR(double(a.true_range.pixels[i]), double(b.true_range.pixels[i]), 1e-6);
}

TEST(Truth, BacksAreSeenOnlyWhenAsked) {
  SimulatedScene wall = make_wall();
  ViewSource view = look_down_from(make_rgbd_rig(32, 24), {0, 0, -2});
  view.T_world_view.linear().setIdentity();
  EXPECT_EQ(test::count_samples(simulate_one(wall, view, no_effects()).true_range), 0u);
  wall.is_two_sided = true;
  EXPECT_EQ(test::count_samples(simulate_one(wall, view, no_effects()).true_range), 32u * 24u);
}

TEST(Truth, RangeLimitsHold) {
  SensorEffects effects;
  effects.min_range_m = 0.4, effects.max_range_m = 2.2;
  const SimulatedScene wall = make_wall();
  const SensorRig rig = make_laser_rig(64, 64, 1.5, -1.5);
  ViewSource view = look_down_from(rig, {0, 0, 2});
  view.T_world_view.linear().setIdentity();
  const auto out = simulate_one(wall, view, effects);
  for (const float r : out.true_range.pixels) EXPECT_TRUE(r == 0.0f || (r >= 1.99f && r <= 2.2f)) << r;
  EXPECT_GT(test::count_samples(out.true_range), 100u);
}

// ---- noise

struct Moments {
  double mean = 0, sigma = 0;
  std::size_t count = 0;
};

Moments residuals(const SimulatedView& view) {
  double sum = 0, squares = 0;
  Moments out;
  for (std::size_t i = 0; i < view.true_range.size(); ++i) {
    const float truth = view.true_range.pixels[i], measured = view.view.range.pixels[i];
    if (!(truth > 0 && measured > 0)) continue;
    const double d = double(measured) - double(truth);
    sum += d, squares += d * d, ++out.count;
  }
  out.mean = sum / double(out.count);
  out.sigma = std::sqrt(squares / double(out.count) - out.mean * out.mean);
  return out;
}

TEST(Noise, KinectModelOverRange) {
  const SimulatedScene wall = make_wall();
  const SensorRig rig = make_rgbd_rig(320, 240);
  for (const double z : {0.5, 1.0, 2.0, 4.0}) {
    const auto out = simulate_one(wall, look_down_from(rig, {0, 0, z}), rig.effects);
    const Moments m = residuals(out);
    const double expected = 0.0012 + 0.0019 * (z - 0.4) * (z - 0.4);
    ASSERT_EQ(m.count, out.true_range.size());
    // The relative spread of a sample deviation is 1/√(2n) = 0.26 %.
    EXPECT_NEAR(m.sigma / expected, 1, 0.01) << z;
    EXPECT_NEAR(m.mean / expected, 0, 4 / std::sqrt(double(m.count))) << z;
  }
}

TEST(Noise, IsNormal) {
  const SensorRig rig = make_rgbd_rig(320, 240);
  SensorEffects effects;
  effects.noise = {0.01, 0, 0, 0};
  const auto out = simulate_one(make_wall(), look_down_from(rig, {0, 0, 2}), effects);
  std::array<int, 4> within{};
  for (std::size_t i = 0; i < out.true_range.size(); ++i) {
    const double d = std::abs(double(out.view.range.pixels[i]) - double(out.true_range.pixels[i])) / 0.01;
    for (std::size_t k = 1; k < 4; ++k) within[k] += d < double(k) ? 1 : 0;
  }
  const double n = double(out.true_range.size());
  EXPECT_NEAR(within[1] / n, 0.6827, 0.006);
  EXPECT_NEAR(within[2] / n, 0.9545, 0.003);
  EXPECT_NEAR(within[3] / n, 0.9973, 0.001);
}

TEST(Noise, NeighboursAreIndependent) {
  SensorEffects effects;
  effects.noise = {0.01, 0, 0, 0};
  const auto out = simulate_one(make_wall(), look_down_from(make_rgbd_rig(320, 240), {0, 0, 2}), effects);
  const auto residual = [&](int u, int v) { return double(out.view.range.at(u, v)) - double(out.true_range.at(u, v)); };
  double across = 0, down = 0;
  for (int v = 0; v + 1 < 240; ++v)
    for (int u = 0; u + 1 < 320; ++u) {
      across += residual(u, v) * residual(u + 1, v);
      down += residual(u, v) * residual(u, v + 1);
    }
  const double n = 319.0 * 239.0, four_sigma = 4 / std::sqrt(n);
  EXPECT_NEAR(across / n / 1e-4, 0, four_sigma);
  EXPECT_NEAR(down / n / 1e-4, 0, four_sigma);
}

// Parallel rays on a wall turned by 60°: one angle everywhere.
ViewSource look_aslant() {
  ViewSource view = look_down_from(make_ortho_rig(300, 300, 1.0), {0, 0, 3});
  view.T_world_view.linear() =
      view.T_world_view.linear() * Eigen::AngleAxisd(std::numbers::pi / 3, Vector3d::UnitX()).toRotationMatrix();
  return view;
}

TEST(Noise, GrowsWithIncidence) {
  SensorEffects effects;
  effects.noise = {0.002, 0, 0, 0};
  effects.incidence_1 = 0.5, effects.incidence_2 = 2;
  const Moments m = residuals(simulate_one(make_wall(), look_aslant(), effects));
  ASSERT_EQ(m.count, 90000u);
  const double angle = std::numbers::pi / 3;
  EXPECT_NEAR(m.sigma / (0.002 * (1 + 0.5 * angle + 2 * angle * angle)), 1, 0.01);
}

TEST(Noise, OfPointingGrowsWithTheTangent) {
  SensorEffects effects;
  effects.noise = {.s0_m = 0.002, .pointing_rad = 0.0002};
  const SimulatedView seen = simulate_one(make_wall(), look_aslant(), effects);
  const double range = double(seen.true_range.at(150, 150));
  EXPECT_NEAR(residuals(seen).sigma / std::hypot(0.002, 0.0002 * range * std::sqrt(3.0)), 1, 0.02);
}

TEST(Noise, ScalesAndStops) {
  const SensorEffects defaults = make_rgbd_rig().effects;
  EXPECT_DOUBLE_EQ(scaled(defaults, 2).noise.sigma(3.0), 2 * defaults.noise.sigma(3.0));
  const auto out = simulate_one(make_wall(), look_down_from(make_rgbd_rig(64, 48), {0, 0, 2}), scaled(defaults, 0));
  EXPECT_TRUE(test::have_same_bytes(out.view.range, out.true_range));
  EXPECT_THROW(scaled(defaults, -1), InvalidInput);
}

TEST(Quantization, RoundsToSteps) {
  SensorEffects effects;
  effects.quantization_m = 0.001, effects.quantization_2_per_m = 0.003;
  effects.noise = {0.02, 0, 0, 0};
  const auto out = simulate_one(make_wall(), look_down_from(make_rgbd_rig(64, 48), {0, 0, 2}), effects);
  std::size_t distinct = 0;
  for (const float r : out.view.range.pixels) {
    const double truth = double(r);
    // The step belongs to the unrounded range, which is within half a step.
    const double step = 0.001 + 0.003 * truth * truth;
    EXPECT_GT(r, 0);
    EXPECT_LT(std::abs(truth - 2), 0.02 * 5 + step);
    distinct += std::abs(truth - 2) > 1e-6 ? 1 : 0;
  }
  EXPECT_GT(distinct, 1000u);
  effects.quantization_2_per_m = 0;
  const auto even = simulate_one(make_wall(), look_down_from(make_rgbd_rig(64, 48), {0, 0, 2}), effects);
  for (const float r : even.view.range.pixels)
    EXPECT_NEAR(double(r) * 1000, std::round(double(r) * 1000), 2e-4);  // float rounding of 2 m
}

// ---- dropouts

TEST(Dropout, GrazingWithItsProbability) {
  const SensorRig rig = make_ortho_rig(300, 300, 1.0);
  ViewSource view = look_down_from(rig, {0, 0, 3});
  const double angle = 80 * std::numbers::pi / 180;  // cosine 0.174
  view.T_world_view.linear() =
      view.T_world_view.linear() * Eigen::AngleAxisd(angle, Vector3d::UnitX()).toRotationMatrix();
  SensorEffects effects;
  effects.grazing_cosine = 0.17, effects.grazing_dropout = 0.3;
  const SimulatedScene wall = make_wall();
  EXPECT_EQ(test::count_samples(simulate_one(wall, view, effects).view.range), 90000u);
  effects.grazing_cosine = 0.18;
  const auto out = simulate_one(wall, view, effects);
  EXPECT_EQ(test::count_samples(out.true_range), 90000u);
  // The deviation of the share is √(0.3·0.7/90000) = 0.0015.
  EXPECT_NEAR(double(test::count_samples(out.view.range)) / 90000, 0.7, 0.006);
  effects.grazing_dropout = 1;
  EXPECT_EQ(test::count_samples(simulate_one(wall, view, effects).view.range), 0u);
}

TEST(Dropout, DarkAndSpecular) {
  SimulatedScene wall = make_wall();
  wall.materials = {Material{}, Material{}};
  wall.materials[0].color_a.setConstant(0.01f);
  wall.materials[1].is_specular = true;
  // Lower right triangle black, upper left shiny; the wall is turned 45° to the rays.
  wall.triangle_material = {0, 1};
  const SensorRig rig = make_ortho_rig(200, 200, 1.0);
  ViewSource view = look_down_from(rig, {0, 0, 3});
  view.T_world_view.translation() = Vector3d(3 * std::sin(std::numbers::pi / 4), 0, 3 * std::cos(std::numbers::pi / 4));
  view.T_world_view.linear() =
      Eigen::AngleAxisd(std::numbers::pi / 4, Vector3d::UnitY()).toRotationMatrix() * view.T_world_view.linear();
  SensorEffects effects;
  effects.dark_dropout = 1;
  const auto dark = simulate_one(wall, view, effects);
  effects.dark_dropout = 0, effects.specular_dropout = 1;
  const auto shiny = simulate_one(wall, view, effects);
  std::size_t dark_left = 0, shiny_left = 0;
  for (std::size_t i = 0; i < dark.true_range.size(); ++i) {
    ASSERT_GT(dark.true_range.pixels[i], 0);
    // Every pixel is lost by exactly one of the two.
    EXPECT_NE(dark.view.range.pixels[i] > 0, shiny.view.range.pixels[i] > 0);
    dark_left += dark.view.range.pixels[i] > 0, shiny_left += shiny.view.range.pixels[i] > 0;
  }
  EXPECT_GT(dark_left, 15000u);
  EXPECT_GT(shiny_left, 15000u);
  // Straight on, a mirror returns the light.
  effects.specular_dropout = 1;
  EXPECT_EQ(test::count_samples(simulate_one(wall, look_down_from(rig, {0, 0, 3}), effects).view.range), 40000u);
}

// ---- mixed pixels

/// A plate of 1 × 1 m half a metre before a wall.
SimulatedScene make_plate_before_wall() {
  SimulatedScene scene = make_wall();
  auto& mesh = scene.mesh;
  for (const auto& [x, y] : {std::pair{-0.5f, -0.5f}, {0.5f, -0.5f}, {0.5f, 0.5f}, {-0.5f, 0.5f}})
    mesh.positions_m.emplace_back(x, y, 0.5f);
  mesh.triangles.push_back({4, 5, 6});
  mesh.triangles.push_back({4, 6, 7});
  return scene;
}

TEST(MixedPixels, OnlyAtDepthEdges) {
  const SimulatedScene scene = make_plate_before_wall();
  const SensorRig rig = make_rgbd_rig(321, 241);
  ViewSource view = look_down_from(rig, {0.0013, 0.0017, 2.5});
  // Turned, so that the outline crosses pixels everywhere.
  view.T_world_view.linear() =
      view.T_world_view.linear() * Eigen::AngleAxisd(0.13, Vector3d::UnitZ()).toRotationMatrix();
  SensorEffects effects;
  const auto clean = simulate_one(scene, view, effects);
  effects.has_mixed_pixels = true;
  const auto mixed = simulate_one(scene, view, effects);
  EXPECT_TRUE(test::have_same_bytes(clean.true_range, mixed.true_range));
  std::size_t flying = 0, at_edge = 0;
  const auto& truth = clean.true_range;
  for (int v = 1; v + 1 < truth.height; ++v)
    for (int u = 1; u + 1 < truth.width; ++u) {
      bool is_edge = false;
      for (int dv = -1; dv <= 1; ++dv)
        for (int du = -1; du <= 1; ++du) is_edge |= std::abs(truth.at(u + du, v + dv) - truth.at(u, v)) > 0.1f;
      at_edge += is_edge;
      const float r = mixed.view.range.at(u, v);
      if (!is_edge) {
        EXPECT_EQ(r, truth.at(u, v));
      } else {
        EXPECT_GE(r, 2.0f - 1e-5f);
        EXPECT_LE(r, 2.5f + 1e-5f);
        flying += r > 2.01f && r < 2.49f;
      }
    }
  // The outline runs within ±1/3 pixel of the middles of 2/3 of the line of pixels that it crosses; with the neighbours
  // that see a jump beside them, the line is two to three pixels wide.
  EXPECT_GT(double(flying) / double(at_edge), 0.2);
  EXPECT_LT(double(flying) / double(at_edge), 0.5);
}

TEST(MixedPixels, SmoothSurfacesHaveNone) {
  Context context;
  const SimulatedScene sphere = make_sphere_scene(0.5);
  SensorRig rig = make_ortho_rig(200, 200, 1.02);
  rig.color.reset();
  rig.effects = {};
  rig.effects.has_mixed_pixels = true;
  const auto plan = make_trajectory(sphere, rig, {.kind = Trajectory::kAxes, .views = 1}, context);
  const auto out = simulate_one(sphere, plan[0], rig.effects);
  for (int v = 0; v < 200; ++v)
    for (int u = 0; u < 200; ++u) {
      const double x = (u - 99.5) * 0.0051, y = (v - 99.5) * 0.0051;
      // Off the rim, where a pixel is 1 % of the radius wide.
      if (std::hypot(x, y) > 0.45) continue;
      EXPECT_EQ(out.view.range.at(u, v), out.true_range.at(u, v));
    }
}

// ---- pose and exposure

TEST(PoseError, HasItsMagnitudes) {
  Context context;
  const SimulatedScene wall = make_wall();
  SensorRig rig = make_rgbd_rig(4, 4);
  rig.color.reset();
  SensorEffects effects;
  effects.pose_sigma_m = 0.005, effects.pose_sigma_rad = 0.02;
  const std::vector<ViewSource> plan(2000, look_down_from(rig, {0, 0, 2}));
  double shift = 0, turn = 0;
  for (const SimulatedView& out : simulate_views(wall, plan, effects, 9, context)) {
    EXPECT_TRUE(out.T_world_view_true.isApprox(plan[0].T_world_view, 1e-15));
    shift += (out.view.T_world_view.translation() - plan[0].T_world_view.translation()).squaredNorm();
    const Eigen::AngleAxisd error(plan[0].T_world_view.linear().transpose() * out.view.T_world_view.linear());
    turn += error.angle() * error.angle();
    // The measurement itself is made from the true pose.
    EXPECT_FLOAT_EQ(out.view.range.at(1, 1), 2.0f);
  }
  // 6000 draws: the deviation of the rms is 1/√12000 = 0.9 %.
  EXPECT_NEAR(std::sqrt(shift / 6000) / 0.005, 1, 0.03);
  EXPECT_NEAR(std::sqrt(turn / 6000) / 0.02, 1, 0.03);
}

TEST(Exposure, ScalesLinearLight) {
  Context context;
  SimulatedScene wall = make_wall();
  const SensorRig rig = make_rgbd_rig(8, 8);
  SensorEffects effects;
  effects.exposure_sigma = 0.2;
  const std::vector<ViewSource> plan(400, look_down_from(rig, {0, 0, 2}));
  const auto linear = [](std::uint8_t s) { return std::pow((s / 255.0 + 0.055) / 1.055, 2.4); };
  const auto plain = simulate_views(wall, {plan[0]}, {}, 3, context);
  const double base = linear(plain[0].color.at(4, 4).g);
  double squares = 0;
  for (const SimulatedView& out : simulate_views(wall, plan, effects, 3, context)) {
    squares += std::log(out.exposure_gain) * std::log(out.exposure_gain);
    const double expected = std::min(1.0, base * out.exposure_gain);
    EXPECT_NEAR(linear(out.color.at(4, 4).g), expected, 0.02 * expected);  // 8-bit steps
  }
  EXPECT_NEAR(std::sqrt(squares / 400) / 0.2, 1, 0.12);  // 3.5 times 1/√800
}

// ---- colour

TEST(Color, OwnCameraSeesTheSamePoints) {
  SimulatedScene wall = make_wall();
  Material checker;
  checker.pattern = Pattern::kChecker;
  checker.scale_m = 0.25f;
  checker.color_a.setConstant(0.9f), checker.color_b.setConstant(0.05f);
  wall.materials = {checker};
  wall.triangle_material = {0, 0};
  SensorRig rig = make_rgbd_rig(160, 120);
  PinholeSensor camera = std::get<PinholeSensor>(rig.sensor);
  camera.width = 400, camera.height = 300, camera.fx = camera.fy = 330, camera.cx = 199.5, camera.cy = 149.5;
  rig.color->camera = camera;
  rig.color->T_view_color.translation() = Vector3d(0.05, -0.02, 0.01);
  const ViewSource view = look_down_from(rig, {0.11, 0.07, 1.5});
  const auto out = simulate_one(wall, view, no_effects());
  ASSERT_EQ(out.color.width, 400);
  std::size_t checked = 0;
  for (int v = 0; v < 120; ++v)
    for (int u = 0; u < 160; ++u) {
      const Vector3d p = unproject(rig.sensor, u, v, double(out.true_range.at(u, v)));
      const Vector3d world = view.T_world_view * p;
      const auto away = [](double x) { return std::abs(x / 0.25 - std::round(x / 0.25)); };
      // Two colour pixels off a checker's edge.
      if (away(world.x()) < 0.04 || away(world.y()) < 0.04) continue;
      const auto at = project(rig.color->camera, rig.color->T_view_color.inverse() * p);
      ASSERT_TRUE(at);
      const int cu = int(std::lround(at->u)), cv = int(std::lround(at->v));
      if (cu < 0 || cv < 0 || cu >= 400 || cv >= 300) continue;
      const bool is_odd = (int(std::floor(world.x() / 0.25)) + int(std::floor(world.y() / 0.25))) & 1;
      EXPECT_EQ(out.color.at(cu, cv).g > 110, is_odd) << world.transpose();
      ++checked;
    }
  EXPECT_GT(checked, 8000u);
}

TEST(Color, AgreesBetweenViews) {
  Context context;
  const SimulatedScene room = make_partition_scene();
  const SensorRig rig = make_rgbd_rig(240, 180);
  const auto plan = make_trajectory(room, rig, {.kind = Trajectory::kWalk, .views = 6}, context);
  const auto views = simulate_views(room, plan, no_effects(), 1, context);
  std::size_t compared = 0, far_off = 0;
  for (const SimulatedView& a : views)
    for (const SimulatedView& b : views) {
      if (&a == &b) continue;
      for (int v = 2; v < 178; v += 3)
        for (int u = 2; u < 238; u += 3) {
          const Vector3d p = a.T_world_view_true * unproject(a.view.sensor, u, v, double(a.true_range.at(u, v)));
          const auto at = project(b.view.sensor, b.T_world_view_true.inverse() * p);
          if (!at || at->u < 0 || at->v < 0 || at->u > 239 || at->v > 179) continue;
          const int bu = int(std::lround(at->u)), bv = int(std::lround(at->v));
          if (std::abs(double(b.true_range.at(bu, bv)) - at->r) > 0.01) continue;
          const Rgb8 x = a.color.at(u, v), y = b.color.at(bu, bv);
          ++compared;
          far_off += std::abs(int(x.r) - int(y.r)) + std::abs(int(x.g) - int(y.g)) + std::abs(int(x.b) - int(y.b)) > 60;
        }
    }
  ASSERT_GT(compared, 1000u);
  // Half a pixel's shift matters at the edges of patterns only.
  EXPECT_LT(double(far_off) / double(compared), 0.06);
}

TEST(Color, ComesFromVertexColorsAndTexture) {
  SimulatedScene wall = make_wall(1);
  wall.mesh.colors = {{200, 0, 0}, {200, 0, 0}, {200, 0, 0}, {200, 0, 0}};
  const SensorRig rig = make_rgbd_rig(16, 12);
  const ViewSource view = look_down_from(rig, {0.2, -0.3, 1});
  Rgb8 c = simulate_one(wall, view, no_effects()).color.at(8, 6);
  EXPECT_GT(int(c.r), 80);
  EXPECT_EQ(c.g, 0);
  // Texture goes before vertex colours: left half green, right half blue; y points up in the world, down on the page.
  wall.mesh.pages = {ColorImage(64, 64, {0, 220, 0})};
  for (int v = 0; v < 64; ++v)
    for (int u = 32; u < 64; ++u) wall.mesh.pages[0].at(u, v) = {0, 0, 220};
  const Eigen::Vector2f t[4] = {{0, 1}, {1, 1}, {1, 0}, {0, 0}};
  wall.mesh.texcoords = {{t[0], t[1], t[2]}, {t[0], t[2], t[3]}};
  wall.mesh.triangle_page = {0, 0};
  c = simulate_one(wall, look_down_from(rig, {0.6, 0, 0.3}), no_effects()).color.at(8, 6);
  EXPECT_GT(int(c.b), 80);
  EXPECT_EQ(c.g, 0);
  c = simulate_one(wall, look_down_from(rig, {-0.6, 0, 0.3}), no_effects()).color.at(8, 6);
  EXPECT_GT(int(c.g), 80);
  EXPECT_EQ(c.b, 0);
}

// ---- reproducibility

TEST(Reproducibility, SameBytesForAnyNumberOfThreads) {
  SensorRig rig = make_rgbd_rig(100, 75);
  rig.effects.has_mixed_pixels = true;
  rig.effects.dark_dropout = rig.effects.specular_dropout = 0.5;
  rig.effects.grazing_dropout = 0.5;
  rig.effects.exposure_sigma = 0.1, rig.effects.pose_sigma_m = 0.003, rig.effects.pose_sigma_rad = 0.01;
  std::vector<SimulatedView> first;
  allow_threads(8);  // or threads beyond the processors would not be made
  for (const int threads : {1, 2, 3, 8}) {
    Context context(threads);
    const SimulatedScene room = make_room({.seed = 5});
    const auto plan = make_trajectory(room, rig, {.kind = Trajectory::kWalk, .views = 3, .seed = 5}, context);
    const auto views = simulate_views(room, plan, rig.effects, 5, context);
    if (first.empty()) {
      first = views;
      continue;
    }
    for (std::size_t i = 0; i < views.size(); ++i) {
      EXPECT_EQ(views[i].view.T_world_view.matrix(), first[i].view.T_world_view.matrix()) << threads;
      EXPECT_TRUE(test::have_same_bytes(views[i].view.range, first[i].view.range)) << threads;
      EXPECT_TRUE(test::have_same_bytes(views[i].true_range, first[i].true_range)) << threads;
      EXPECT_TRUE(test::have_same_bytes(views[i].color, first[i].color)) << threads;
      EXPECT_EQ(views[i].exposure_gain, first[i].exposure_gain) << threads;
    }
  }
}

TEST(Reproducibility, SeedAndViewMakeTheNoise) {
  Context context;
  const SimulatedScene wall = make_wall();
  const SensorRig rig = make_rgbd_rig(40, 30);
  const ViewSource view = look_down_from(rig, {0, 0, 2});
  const auto views = simulate_views(wall, {view, view}, rig.effects, 1, context);
  const auto again = simulate_views(wall, {view, view}, rig.effects, 1, context);
  const auto other = simulate_views(wall, {view, view}, rig.effects, 2, context);
  EXPECT_TRUE(test::have_same_bytes(views[0].view.range, again[0].view.range));
  EXPECT_FALSE(test::have_same_bytes(views[0].view.range, views[1].view.range));
  EXPECT_FALSE(test::have_same_bytes(views[0].view.range, other[0].view.range));
  EXPECT_TRUE(test::have_same_bytes(views[0].true_range, other[1].true_range));
  EXPECT_TRUE(test::have_same_bytes(views[0].view.range,
                                    Simulator(wall, 1, context).simulate_serially(view, 0, rig.effects).view.range));
}

TEST(Simulator, RefusesWhatItCannotDo) {
  Context context;
  SimulatedScene wall = make_wall();
  ViewSource view = look_down_from(make_rgbd_rig(8, 8), {0, 0, 2});
  view.sensor.reset();
  EXPECT_THROW(simulate_views(wall, {view}, {}, 1, context), InvalidInput);
  view.sensor = MeasuredGridSensor{};
  EXPECT_THROW(simulate_views(wall, {view}, {}, 1, context), InvalidInput);
  wall.triangle_material = {0, 7};
  EXPECT_THROW(Simulator(wall, 1, context), InvalidInput);
  EXPECT_THROW(Simulator({}, 1, context), InvalidInput);
  wall.triangle_material.clear();
  const ViewSource colored = look_down_from(make_rgbd_rig(8, 8), {0, 0, 2});
  EXPECT_THROW(Simulator(wall, 1, context, false).simulate(colored, 0, {}, context), InvalidInput);
  EXPECT_THROW(make_rgbd_rig(0, 480), InvalidInput);
  EXPECT_THROW(make_laser_rig(100, 50, -1, 1), InvalidInput);
  EXPECT_THROW(make_ortho_rig(100, 100, 0), InvalidInput);
}

}  // namespace
}  // namespace lapseam
