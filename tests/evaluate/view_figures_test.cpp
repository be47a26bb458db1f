// What views add: which part of the truth was seen, and where their rays go.

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <vector>

#include "evaluate/surfaces.h"
#include "lapseam/context.h"
#include "lapseam/evaluate.h"
#include "lapseam/sensor.h"
#include "spatial/ray_scene.h"

namespace lapseam {
namespace {

using test::append;
using test::flip;
using test::sheet;
using test::sphere;
using test::view_down_on_floor;

Evaluation evaluate_meshes(const Mesh& result, const Mesh& truth, const std::vector<View>& views,
                           EvaluateOptions options = {.samples = 200'000}) {
  Context context;
  return evaluate(result, truth, truth_views(views), options, context);
}

/// Fills the range image with what the sensor sees of the mesh from its pose.
View scan(const Mesh& mesh, Sensor sensor, const Eigen::Isometry3d& T_world_view) {
  Context context;
  const RayScene scene(mesh.positions_m, mesh.triangles, context);
  View view{"scan", "sensor", std::move(sensor), {}, T_world_view};
  view.range = RangeImage(width(view.sensor), height(view.sensor));
  for (int v = 0; v < view.range.height; ++v) {
    for (int u = 0; u < view.range.width; ++u) {
      const Eigen::Vector3d start = T_world_view * unproject(view.sensor, u, v, 0);
      const Eigen::Vector3d direction = T_world_view.linear() * ray_direction(view.sensor, u, v);
      const RayHit hit = scene.cast(start.cast<float>(), direction.cast<float>());
      if (!hit) continue;
      const Eigen::Vector3d point = T_world_view.inverse() * (start + double(hit.t) * direction);
      view.range.at(u, v) = float(project(view.sensor, point)->r);
    }
  }
  return view;
}

// The floor is 4 × 4 m; the view covers 1 × 0.75 m of it: 100 × 75 pixels of 1 cm.
const View kView = view_down_on_floor(2, 2, 2, 100, 75, 200);
const Mesh kFloor = sheet(4, 4, 16, 16, 0);

TEST(Seen, is_what_the_image_covers) {
  const Evaluation e = evaluate_meshes(kFloor, kFloor, {kView});
  EXPECT_TRUE(e.has_views);
  // 200,000 stratified samples: the share of a rectangle is good to 1e-3 of it.
  EXPECT_NEAR(e.completeness.seen_share, 0.75 / 16, 1e-4);
  EXPECT_EQ(e.completeness.two_view_samples, 0u);
}

TEST(Seen, completeness_ignores_what_no_view_saw) {
  Mesh result = sheet(2, 2, 4, 4, 0);
  test::move(result, {1, 1, 0});
  const Evaluation e = evaluate_meshes(result, kFloor, {kView});
  EXPECT_EQ(e.distances[0].completeness, 1);
  EXPECT_LT(evaluate_meshes(result, kFloor, {}).distances[0].completeness, 0.3);
}

TEST(Seen, two_views_overlap_where_both_look) {
  View other = kView;
  other.T_world_view.translation().x() += 0.75;  // a quarter of the image in common
  const Evaluation e = evaluate_meshes(kFloor, kFloor, {kView, other});
  EXPECT_NEAR(e.completeness.seen_share, 1.75 * 0.75 / 16, 2e-4);
  EXPECT_NEAR(double(e.completeness.two_view_samples) / double(e.completeness.samples), 0.25 / 1.75, 2e-3);
  EXPECT_EQ(e.distances[0].completeness_two_views, 1);
}

TEST(Seen, invalid_pixels_and_hidden_surfaces_are_not_seen) {
  View half = kView;
  for (int v = 0; v < 75; ++v)
    for (int u = 0; u < 50; ++u) half.range.at(u, v) = kInvalidRange;
  EXPECT_NEAR(evaluate_meshes(kFloor, kFloor, {half}).completeness.seen_share, 0.375 / 16, 1e-4);

  // A cellar 10 cm under the floor, and a ceiling seen from behind: neither adds anything seen.
  Mesh truth = kFloor;
  append(truth, sheet(4, 4, 16, 16, -0.1f));
  Mesh back = sheet(4, 4, 16, 16, 0);
  flip(back);
  append(truth, back);
  EXPECT_NEAR(evaluate_meshes(truth, truth, {kView}).completeness.seen_share, 0.75 / 48, 1e-4);
}

TEST(Seen, slanted_surface_is_seen_all_over) {
  // 80° off the ray: the range changes by nearly six pixel widths from one pixel to the next.
  const double slant = 80 * std::numbers::pi / 180;
  Mesh wall = sheet(0.08f, 1, 4, 40, 0);
  for (Eigen::Vector3f& p : wall.positions_m) p = {1.96f + p.x(), 1.5f + p.y(), float(std::tan(slant)) * p.x()};
  const View view = scan(wall, kView.sensor, kView.T_world_view);
  const Evaluation e = evaluate_meshes(wall, wall, {view});
  // All of the strip but its rim, half a pixel wide: 5 mm of 1 m in y, 5 mm of 8 cm in x; the image ends 75 cm in y.
  EXPECT_GT(e.completeness.seen_share, 0.75 * (1 - 0.01 / 0.08) * 0.98);
  EXPECT_LT(e.completeness.seen_share, 0.76 * 1.25);
}

TEST(Seen, grazing_surface_is_not_seen) {
  // Looked at from 2 m above and 20 m aside: cosine 0.1.
  View view = kView;
  view.T_world_view.translation().x() = -18;
  view.T_world_view.linear() *= Eigen::AngleAxisd(std::atan(10.0), Eigen::Vector3d::UnitY()).toRotationMatrix();
  view = scan(kFloor, PinholeSensor{100, 75, 2000, 2000, 49.5, 37, {}}, view.T_world_view);
  EvaluateOptions options{.samples = 200'000, .grazing_cosine = 0.05};
  const double seen = evaluate_meshes(kFloor, kFloor, {view}, options).completeness.seen_share;
  EXPECT_GT(seen, 0.1);
  options.grazing_cosine = 0.15;
  EXPECT_EQ(evaluate_meshes(kFloor, kFloor, {view}, options).completeness.seen_share, 0);
}

TEST(Seen, spherical_scanner_sees_the_whole_ball_around_it) {
  Mesh ball = sphere(2, 90, 180);
  flip(ball);  // seen from within
  const SphericalSensor sensor = SphericalSensor::from_limits(240, 120, -std::numbers::pi, std::numbers::pi,
                                                              std::numbers::pi / 2, -std::numbers::pi / 2);
  Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
  pose.linear() = Eigen::AngleAxisd(0.3, Eigen::Vector3d(1, 2, 3).normalized()).toRotationMatrix();
  pose.translation() = Eigen::Vector3d(0.3, -0.2, 0.1);
  const Evaluation e = evaluate_meshes(ball, ball, {scan(ball, sensor, pose)});
  EXPECT_GT(e.completeness.seen_share, 0.999);
  EXPECT_EQ(e.rays.close, e.rays.rays);
  EXPECT_EQ(e.rays.double_layers, 0u);
}

TEST(Rays, all_pixels_are_used_when_there_are_few_and_some_when_there_are_many) {
  EXPECT_EQ(evaluate_meshes(kFloor, kFloor, {kView}).rays.rays, 7500u);
  const Evaluation e = evaluate_meshes(kFloor, kFloor, {kView, kView}, {.samples = 1000, .rays_per_view = 2000});
  EXPECT_EQ(e.rays.rays, 4000u);
  EXPECT_EQ(e.rays_by_view.size(), 2u);
  EXPECT_EQ(e.rays_by_view[1].rays, 2000u);
}

TEST(Rays, hole_is_missed_by_its_share_of_pixels) {
  // Without the strip x > 2.25: the last quarter of the columns.
  const Mesh result = sheet(2.25f, 4, 9, 16, 0);
  const Evaluation e = evaluate_meshes(result, kFloor, {kView});
  EXPECT_EQ(e.rays.misses(), 7500u / 4);
  EXPECT_EQ(e.rays.close, 7500u * 3 / 4);
  EXPECT_EQ(e.rays.floating + e.rays.behind, 0u);
}

TEST(Rays, none_slips_through_at_the_vertices_that_lie_on_rays) {
  constexpr int kWidth = 200, kHeight = 150;
  View view{"v", "sensor", PinholeSensor{kWidth, kHeight, 175, 175, 99.5, 74.5, {}}, RangeImage(kWidth, kHeight), {}};
  view.T_world_view =
      Eigen::Translation3d(0.3, -0.2, 1.7) * Eigen::AngleAxisd(2.1, Eigen::Vector3d(1, 2, -1).normalized());
  Mesh mesh;
  for (int v = 0; v < kHeight; ++v)
    for (int u = 0; u < kWidth; ++u) {
      view.range.at(u, v) = float(2 + 0.002 * std::sin(12.9898 * u + 78.233 * v));
      mesh.positions_m.push_back(
          (view.T_world_view * unproject(view.sensor, u, v, double(view.range.at(u, v)))).cast<float>());
    }
  for (std::uint32_t v = 0; v + 1 < kHeight; ++v)
    for (std::uint32_t u = 0; u + 1 < kWidth; ++u) {
      const std::uint32_t a = v * kWidth + u, b = a + 1, c = a + kWidth, d = c + 1;
      mesh.triangles.push_back({a, c, b});
      mesh.triangles.push_back({b, c, d});
    }
  // Rays along the outline may miss.
  for (int v = 0; v < kHeight; ++v)
    for (int u = 0; u < kWidth; ++u)
      if (u == 0 || v == 0 || u + 1 == kWidth || v + 1 == kHeight) view.range.at(u, v) = kInvalidRange;
  const Evaluation e = evaluate_meshes(mesh, mesh, {view}, {.samples = 1000, .rays_per_view = kWidth * kHeight});
  EXPECT_EQ(e.rays.rays, std::uint64_t(kWidth - 2) * (kHeight - 2));
  EXPECT_EQ(e.rays.misses(), 0u);
}

TEST(Rays, patch_in_front_floats_by_its_solid_share) {
  // 0.25 × 0.245 m at half the height looks like 0.5 × 0.49 m: 50 × 49 pixels, no edge on a pixel centre.
  Mesh result = kFloor;
  Mesh patch = sheet(0.25f, 0.245f, 3, 3, 1);
  test::move(patch, {1.875f, 1.8775f, 0});
  append(result, patch);
  const Evaluation e = evaluate_meshes(result, kFloor, {kView});
  EXPECT_EQ(e.rays.floating, 50u * 49);
  EXPECT_EQ(e.rays.close, 7500u - 50 * 49);
  EXPECT_EQ(e.rays.double_layers, 0u) << "the floor is a metre behind";
  EXPECT_EQ(e.rays.misses(), 0u);
}

TEST(Rays, thresholds_lie_at_1_and_2_centimetres) {
  for (const auto& [height_m, close, floating, behind] :
       {std::tuple{0.009f, 1, 0, 0}, {0.011f, 0, 0, 0}, {0.0195f, 0, 0, 0}, {0.0215f, 0, 1, 0}, {-0.0215f, 0, 0, 1}}) {
    // The orthographic sensor measures the height itself, the same for every pixel.
    View view = kView;
    view.sensor = OrthographicSensor{100, 75, 0.01, 0.01, 49.5, 37};
    const Evaluation e = evaluate_meshes(sheet(4, 4, 16, 16, height_m), kFloor, {view});
    EXPECT_EQ(e.rays.close, 7500u * unsigned(close)) << height_m;
    EXPECT_EQ(e.rays.floating, 7500u * unsigned(floating)) << height_m;
    EXPECT_EQ(e.rays.behind, 7500u * unsigned(behind)) << height_m;
  }
}

TEST(Rays, double_layer_is_a_second_front_closely_behind) {
  const auto double_layers_with = [](const Mesh& second) {
    Mesh result = kFloor;
    append(result, second);
    return evaluate_meshes(result, kFloor, {kView}).rays;
  };
  // Over the half x > 2.
  const auto half_sheet = [](float z_m, bool is_flipped) {
    Mesh mesh = sheet(2, 4, 8, 16, z_m);
    test::move(mesh, {2, 0, 0});
    if (is_flipped) flip(mesh);
    return mesh;
  };
  EXPECT_EQ(double_layers_with(half_sheet(-0.005f, false)).double_layers, 7500u / 2);
  EXPECT_EQ(double_layers_with(half_sheet(-0.005f, false)).truth_double_layers, 0u);
  EXPECT_EQ(double_layers_with(half_sheet(0.02f, false)).double_layers, 7500u / 2) << "in front of the floor";
  // 3 cm along a slanted ray come sooner than 3 cm in height.
  EXPECT_EQ(double_layers_with(half_sheet(-0.04f, false)).double_layers, 0u) << "too far behind";
  EXPECT_EQ(double_layers_with(half_sheet(-0.005f, true)).double_layers, 0u) << "a back: a thin sheet has two sides";
  const RayFigures back_first = double_layers_with(half_sheet(0.005f, true));
  EXPECT_EQ(back_first.double_layers, 0u);
  EXPECT_EQ(back_first.front_facing, 7500u / 2);
}

}  // namespace
}  // namespace lapseam
