#include "lapseam/close_cracks.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>

#include "lapseam/context.h"
#include "lapseam/error.h"
#include "lapseam/health.h"
#include "lapseam/sensor.h"
#include "support/analytic_views.h"
#include "support/expect_valid_mesh.h"
#include "support/joined.h"

namespace lapseam {
namespace {

constexpr NoiseModel kNoise{0.002, 0, 0, 0};

View view_of(const test::Shape& shape, double x) {
  return test::make_view("v", test::small_camera(), test::look_at({x, 0.02, 2}, {2 * x, 0, 0}), shape);
}

test::Joined plane_from_two_views(Context& context) {
  const test::Shape plane = test::plane({0, 0, 0}, {0, 0, 1});
  return test::join({view_of(plane, -0.1), view_of(plane, 0.15)}, kNoise, context);
}

Eigen::Vector3f middle_of(const Mesh& mesh, std::size_t t) {
  const Triangle& c = mesh.triangles[t];
  return (mesh.positions_m[c[0]] + mesh.positions_m[c[1]] + mesh.positions_m[c[2]]) / 3;
}

/// Takes away the triangles around a point; how many went.
std::size_t punch(Mesh& mesh, const Eigen::Vector3f& at, float radius_m) {
  std::vector<std::uint8_t> keep(mesh.triangle_count(), 1);
  std::size_t removed = 0;
  for (std::size_t t = 0; t < keep.size(); ++t)
    if ((middle_of(mesh, t) - at).norm() < radius_m) keep[t] = 0, ++removed;
  mesh = compact(mesh, keep);
  return removed;
}

double area_of(const Mesh& mesh) {
  double area = 0;
  for (const Triangle& t : mesh.triangles) {
    const auto& p = mesh.positions_m;
    area += 0.5 * double((p[t[1]] - p[t[0]]).cross(p[t[2]] - p[t[0]]).norm());
  }
  return area;
}

TEST(CloseCracks, ClosesWhatViewsMeasured) {
  Context context(2);
  test::Joined joined = plane_from_two_views(context);
  const double before = area_of(joined.mesh);
  const std::uint64_t loops = check_health(joined.mesh, {}, context).boundary_loops;
  ASSERT_GT(punch(joined.mesh, {0.05f, 0.02f, 0}, 0.15f), 2u);
  ASSERT_LT(area_of(joined.mesh), before);
  ASSERT_EQ(check_health(joined.mesh, {}, context).boundary_loops, loops + 1);
  const CloseCracksReport report = close_cracks(joined.mesh, joined.patches, {}, context);
  EXPECT_EQ(report.loops_closed, 1u);
  expect_valid_mesh(joined.mesh);
  EXPECT_EQ(check_health(joined.mesh, {}, context).boundary_loops, loops);
  // The plane is flat: whatever the triangulation, its area is that of the hole.
  EXPECT_NEAR(area_of(joined.mesh), before, 1e-4 * before);
}

TEST(CloseCracks, WhatIsFoldedIntoAHoleIsReplaced) {
  Context context(2);
  test::Joined joined = plane_from_two_views(context);
  Mesh& mesh = joined.mesh;
  const double before = area_of(mesh);
  const std::uint64_t loops = check_health(mesh, {}, context).boundary_loops;
  const Eigen::Vector3f middle(0.05f, 0.02f, 0);
  ASSERT_GT(punch(mesh, middle, 0.12f), 2u);
  // The rim's vertex nearest to the middle goes over to the other side: its triangles cover the hole, upside down.
  Eigen::Vector3f& nearest = *std::min_element(
      mesh.positions_m.begin(), mesh.positions_m.end(),
      [&](const Eigen::Vector3f& a, const Eigen::Vector3f& b) { return (a - middle).norm() < (b - middle).norm(); });
  nearest += 4 * (middle - nearest);
  const CloseCracksReport report = close_cracks(mesh, joined.patches, {}, context);
  EXPECT_GT(report.triangles_replaced, 0u);
  expect_valid_mesh(mesh);
  const MeshHealth health = check_health(mesh, {.self_intersections = true}, context);
  EXPECT_EQ(health.boundary_loops, loops);
  EXPECT_EQ(health.self_intersecting_triangles, 0u);
  EXPECT_NEAR(area_of(mesh), before, 1e-4 * before);
}

TEST(CloseCracks, CornersOfLongOutlinesAreFilled) {
  Context context(2);
  test::Joined joined = plane_from_two_views(context);
  // A slot across the surface, open at both ends: its outline is that of the mesh, and no hole.
  std::vector<std::uint8_t> keep(joined.mesh.triangle_count(), 1);
  for (std::size_t t = 0; t < keep.size(); ++t) keep[t] = std::abs(middle_of(joined.mesh, t).y() - 0.02f) > 0.06f;
  joined.mesh = compact(joined.mesh, keep);
  const double before = area_of(joined.mesh);
  const CloseCracksReport report = close_cracks(joined.mesh, joined.patches, {}, context);
  EXPECT_EQ(report.loops_closed, 0u);
  EXPECT_GT(report.corners_filled, 0u);
  EXPECT_GT(area_of(joined.mesh), before);
  expect_valid_mesh(joined.mesh);
}

TEST(CloseCracks, SlitBetweenLargeTrianglesIsClosedThoughNothingGoesOnFarBeyondIt) {
  Context context(2);
  View view = test::make_view("v", test::small_camera(), test::look_at({0, 0, 2}, {0, 0, 0}),
                              test::plane({0, 0, 0}, {0, 0, 1}));
  // Half a side of the large triangles beyond the slit nothing is measured.
  for (int v = 0; v < view.range.height; ++v)
    for (int u = 0; u < view.range.width; ++u)
      if (v <= 32 || v >= 88) view.range.at(u, v) = kInvalidRange;
  const std::vector<Patch> patches = {test::make_patch(view, kNoise, context)};
  Mesh mesh;
  const std::array<std::array<int, 2>, 8> pixels = {
      {{20, 34}, {100, 34}, {100, 86}, {20, 86}, {30, 59}, {90, 59}, {90, 61}, {30, 61}}};
  for (const auto& [u, v] : pixels) {
    const Eigen::Vector3d p = view.T_world_view * unproject(view.sensor, u, v, double(view.range.at(u, v)));
    mesh.positions_m.push_back(p.cast<float>());
    mesh.vertex_view.push_back(0);
    mesh.vertex_pixel.push_back(std::uint32_t(v * view.range.width + u));
  }
  for (std::uint32_t i = 0; i < 4; ++i) {
    const std::uint32_t j = (i + 1) % 4;
    mesh.triangles.push_back({j, i, 4 + i});
    mesh.triangles.push_back({j, 4 + i, 4 + j});
  }
  mesh.triangle_view.assign(mesh.triangle_count(), 0);
  mesh.triangle_tag.assign(mesh.triangle_count(), TriangleTag::kMeasured);
  ASSERT_EQ(check_health(mesh, {}, context).boundary_loops, 2u);
  const CloseCracksReport report = close_cracks(mesh, patches, {}, context);
  EXPECT_EQ(report.crack_loops, 0u);
  EXPECT_EQ(report.loops_closed, 1u);
  EXPECT_EQ(check_health(mesh, {}, context).boundary_loops, 1u);
  expect_valid_mesh(mesh);
}

TEST(CloseCracks, WhatNobodyMeasuredStaysOpen) {
  Context context(2);
  const test::Shape plane = test::plane({0, 0, 0}, {0, 0, 1});
  std::vector<View> views = {view_of(plane, -0.1), view_of(plane, 0.15)};
  // A hole in the measurements of both views around one spot.
  for (View& view : views)
    for (int v = 0; v < view.range.height; ++v)
      for (int u = 0; u < view.range.width; ++u) {
        const Eigen::Vector3d p = view.T_world_view * unproject(view.sensor, u, v, double(view.range.at(u, v)));
        if ((p - Eigen::Vector3d(0.05, 0.02, 0)).norm() < 0.08) view.range.at(u, v) = kInvalidRange;
      }
  test::Joined joined = test::join(views, kNoise, context);
  const std::uint64_t loops = check_health(joined.mesh, {}, context).boundary_loops;
  ASSERT_GE(loops, 2u);
  EXPECT_EQ(close_cracks(joined.mesh, joined.patches, {}, context).loops_closed, 0u);
  EXPECT_EQ(check_health(joined.mesh, {}, context).boundary_loops, loops);
}

/// A copy of some triangles above them: a flap that sewing would have left. How many.
std::size_t add_flap(Mesh& mesh, float height_m) {
  std::vector<std::uint32_t> copy(mesh.vertex_count(), kInvalidIndex);
  std::size_t flap = 0;
  for (std::size_t t = 0, end = mesh.triangle_count(); t < end; ++t) {
    if ((middle_of(mesh, t) - Eigen::Vector3f(0.05f, 0.02f, 0)).norm() > 0.15f) continue;
    Triangle c = mesh.triangles[t];
    for (std::uint32_t& v : c) {
      if (copy[v] == kInvalidIndex) {
        copy[v] = std::uint32_t(mesh.vertex_count());
        mesh.positions_m.push_back(mesh.positions_m[v] + Eigen::Vector3f(0.001f, 0.001f, height_m));
        mesh.vertex_view.push_back(mesh.vertex_view[v]);
        mesh.vertex_pixel.push_back(mesh.vertex_pixel[v]);
      }
      v = copy[v];
    }
    mesh.triangles.push_back(c);
    mesh.triangle_view.push_back(mesh.triangle_view[t]);
    mesh.triangle_tag.push_back(TriangleTag::kSeam);
    ++flap;
  }
  return flap;
}

TEST(CloseCracks, OneOfTwoLayersGoesAtTheBorder) {
  Context context(2);
  test::Joined joined = plane_from_two_views(context);
  const std::size_t flap = add_flap(joined.mesh, 0.0004f);  // a fifth of the noise
  ASSERT_GT(flap, 4u);
  const CloseCracksReport report = close_cracks(joined.mesh, joined.patches, {}, context);
  EXPECT_EQ(report.covered_triangles_removed, flap);
  for (const Eigen::Vector3f& p : joined.mesh.positions_m) EXPECT_LT(std::abs(p.z()), 1e-5f);
}

TEST(CloseCracks, LayersThatNoViewCouldTellApartAreOne) {
  Context context(2);
  const test::Joined joined = plane_from_two_views(context);
  const Sensor& sensor = joined.patches[0].view.sensor;
  const auto spacing = float(sample_spacing(sensor, 0.5 * width(sensor), 0.5 * height(sensor), 2.0));
  ASSERT_GT(spacing, 4 * kNoise.s0_m);  // noise is not the reason
  for (const float spacings : {1.5f, 4.0f}) {
    Mesh mesh = joined.mesh;
    const std::size_t flap = add_flap(mesh, spacings * spacing);
    const CloseCracksReport report = close_cracks(mesh, joined.patches, {}, context);
    EXPECT_EQ(report.covered_triangles_removed, spacings < 2 ? flap : 0) << spacings;
  }
}

TEST(CloseCracks, TwoSidesOfASheetBothStay) {
  // Half a millimetre thick, seen from above and from below.
  Context context(2);
  const test::Shape top = test::plane({0, 0, 0.0005}, {0, 0, 1}), bottom = test::plane({0, 0, 0}, {0, 0, -1});
  std::vector<View> views = {view_of(top, 0)};
  views.push_back(test::make_view("below", test::small_camera(), test::look_at({0, 0.02, -2}, {0, 0, 0}), bottom));
  test::Joined joined = test::join(views, kNoise, context);
  const std::size_t triangles = joined.mesh.triangle_count();
  EXPECT_EQ(close_cracks(joined.mesh, joined.patches, {}, context).covered_triangles_removed, 0u);
  EXPECT_EQ(joined.mesh.triangle_count(), triangles);
}

/// Adds a needle to the mesh's rim, half a metre long: on along the surface, or along the sensor's ray.
void add_needle(Mesh& mesh, const Eigen::Vector3f& sensor, bool along_ray, TriangleTag tag) {
  std::vector<std::array<std::uint32_t, 2>> edges;
  for (const Triangle& t : mesh.triangles)
    for (std::size_t k = 0; k < 3; ++k) edges.push_back({t[k], t[(k + 1) % 3]});
  std::sort(edges.begin(), edges.end());
  const auto middle = [&](const auto& e) { return 0.5f * (mesh.positions_m[e[0]] + mesh.positions_m[e[1]]); };
  std::array<std::uint32_t, 2> rim = edges.front();
  for (const auto& e : edges)
    if (!std::binary_search(edges.begin(), edges.end(), std::array{e[1], e[0]}) && middle(e).x() < middle(rim).x())
      rim = e;
  const Eigen::Vector3f way = along_ray ? (middle(rim) - sensor).normalized() : Eigen::Vector3f(-1, 0, 0);
  mesh.triangles.push_back({rim[1], rim[0], std::uint32_t(mesh.vertex_count())});
  mesh.triangle_view.push_back(0);
  mesh.triangle_tag.push_back(tag);
  mesh.positions_m.push_back(middle(rim) + 0.5f * way);
  mesh.vertex_view.push_back(0);
  mesh.vertex_pixel.push_back(mesh.vertex_pixel[rim[0]]);
}

TEST(CloseCracks, NeedlesAlongTheRaysAndOfSeamsGo) {
  Context context(2);
  const View view = view_of(test::plane({0, 0, 0}, {0, 0, 1}), 0);
  const test::Joined joined = test::join({view}, kNoise, context);
  Mesh untouched = joined.mesh;
  close_cracks(untouched, joined.patches, {}, context);
  for (const TriangleTag tag : {TriangleTag::kMeasured, TriangleTag::kSeam})
    for (const bool along_ray : {false, true}) {
      Mesh mesh = joined.mesh;
      add_needle(mesh, view.T_world_view.translation().cast<float>(), along_ray, tag);
      const CloseCracksReport report = close_cracks(mesh, joined.patches, {}, context);
      const bool goes = along_ray || tag == TriangleTag::kSeam;
      EXPECT_EQ(report.outline_slivers_removed, goes ? 1u : 0u);
      EXPECT_EQ(mesh.triangle_count(), untouched.triangle_count() + (goes ? 0 : 1));
      expect_valid_mesh(mesh);
    }
}

TEST(CloseCracks, AFloorThatIsHardlySeenStays) {
  Context context(2);
  const test::Shape floor = test::plane({0, 0, 0}, {0, 0, 1});
  // 8° above it: 82° from its normal.
  const View view = test::make_view("v", test::small_camera(), test::look_at({-2, 0.02, 0.28}, {0, 0.02, 0}), floor);
  test::Joined joined = test::join({view}, kNoise, context);
  const double before = area_of(joined.mesh);
  close_cracks(joined.mesh, joined.patches, {}, context);
  EXPECT_GT(area_of(joined.mesh), 0.97 * before);
}

TEST(CloseCracks, SameForAnyThreads) {
  Context first_context(1);
  test::Joined joined = plane_from_two_views(first_context);
  punch(joined.mesh, {0.05f, 0.02f, 0}, 0.1f);
  punch(joined.mesh, {-0.2f, 0.15f, 0}, 0.08f);
  Mesh expected = joined.mesh;
  close_cracks(expected, joined.patches, {}, first_context);
  for (const int threads : {2, 3, 8}) {
    Context context(threads);
    Mesh mesh = joined.mesh;
    close_cracks(mesh, joined.patches, {}, context);
    EXPECT_EQ(mesh.triangles, expected.triangles) << threads;
    EXPECT_EQ(mesh.positions_m, expected.positions_m) << threads;
  }
}

TEST(CloseCracks, CancelStops) {
  Context context(2);
  test::Joined joined = plane_from_two_views(context);
  context.cancel();
  EXPECT_THROW(close_cracks(joined.mesh, joined.patches, {}, context), Cancelled);
}

TEST(CloseCracks, EmptyMeshStaysEmpty) {
  Context context(1);
  Mesh mesh;
  EXPECT_EQ(close_cracks(mesh, {}, {}, context).loops_closed, 0u);
  EXPECT_TRUE(mesh.triangles.empty());
}

}  // namespace
}  // namespace lapseam
