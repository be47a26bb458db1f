#include "lapseam/sew.h"

#include <gtest/gtest.h>

#include <numbers>
#include <random>

#include "lapseam/close_cracks.h"
#include "lapseam/context.h"
#include "lapseam/health.h"
#include "lapseam/reduce.h"
#include "support/analytic_views.h"
#include "support/expect_valid_mesh.h"
#include "support/joined.h"

namespace lapseam {
namespace {

constexpr NoiseModel kNoise{0.002, 0, 0, 0};

std::vector<Patch> two_views_of(const test::Shape& shape, Context& context) {
  std::vector<Patch> patches;
  for (const double x : {-0.1, 0.15})
    patches.push_back(
        test::make_patch(test::make_view("v", test::small_camera(), test::look_at({x, 0.02, 2}, {2 * x, 0, 0}), shape),
                         kNoise, context));
  return patches;
}

Image<std::uint8_t> everything(const Patch& patch) {
  return Image<std::uint8_t>(patch.grid.width, patch.grid.height, 1);
}

Image<std::uint8_t> all_but_a_disk(const Patch& patch) {
  Image<std::uint8_t> wanted = everything(patch);
  for (int v = 0; v < wanted.height; ++v)
    for (int u = 0; u < wanted.width; ++u)
      if (std::hypot(u - 60, v - 60) < 9) wanted.at(u, v) = 0;
  return wanted;
}

void expect_one_sheet(const Mesh& mesh, Context& context) {
  expect_valid_mesh(mesh);
  const MeshHealth health = check_health(mesh, {}, context);
  EXPECT_EQ(health.boundary_loops, 1u);
  EXPECT_EQ(health.self_intersecting_triangles, 0u);
}

TEST(Zipper, WantedSamplesOnly) {
  Context context(2);
  const auto patches = two_views_of(test::plane({0, 0, 0}, {0, 0, 1}), context);
  Image<std::uint8_t> wanted(120, 120, 0);
  for (int v = 30; v < 70; ++v)
    for (int u = 20; u < 100; ++u) wanted.at(u, v) = 1;
  Zipper zipper(patches, {});
  zipper.add({0, wanted}, context);
  for (std::size_t i = 0; i < zipper.mesh().vertex_count(); ++i)
    EXPECT_TRUE(wanted.pixels[zipper.mesh().vertex_pixel[i]]);
  double area = 0;
  for (const Triangle& t : zipper.mesh().triangles) {
    const auto& p = zipper.mesh().positions_m;
    area += 0.5 * double((p[t[1]] - p[t[0]]).cross(p[t[2]] - p[t[0]]).norm());
  }
  const double pitch = double(2 * (patches[0].rays->directions[1] - patches[0].rays->directions[0]).norm());
  EXPECT_NEAR(area, 79 * 39 * pitch * pitch, 0.03 * area);
}

TEST(Zipper, StepsAndInvalidSamplesStayOpen) {
  // A table's edge over the floor: the views look past it, nothing may close the gap between.
  const test::Shape scene =
      test::nearest({test::plane({0, 0, 0}, {0, 0, 1}), test::rectangle(0.6, -0.2, 0.2, -0.2, 0.2)});
  Context context(2);
  const auto patches = two_views_of(scene, context);
  Zipper zipper(patches, {});
  for (const std::uint32_t i : {0u, 1u}) zipper.add({i, everything(patches[i])}, context);
  expect_valid_mesh(zipper.mesh());
  for (const Triangle& t : zipper.mesh().triangles) {
    float low = 9, high = -9;
    for (const std::uint32_t v : t) {
      low = std::min(low, zipper.mesh().positions_m[v].z());
      high = std::max(high, zipper.mesh().positions_m[v].z());
    }
    ASSERT_LT(high - low, 0.3f);
  }
}

TEST(Zipper, RevisitClosesWhatIsOpen) {
  Context context(2);
  const auto patches = two_views_of(test::plane({0, 0, 0}, {0, 0, 1}), context);
  // The first view leaves out a disk in the middle of what it sees; the second closes it.
  Zipper zipper(patches, {});
  zipper.add({0, all_but_a_disk(patches[0])}, context);
  EXPECT_EQ(check_health(zipper.mesh(), {}, context).boundary_loops, 2u);
  zipper.revisit({1, everything(patches[1])}, context);
  expect_one_sheet(zipper.mesh(), context);
}

TEST(Zipper, TurnsThatGetInEachOthersWay) {
  Context context(2);
  const auto patches = two_views_of(test::plane({0, 0, 0}, {0, 0, 1}), context);
  Zipper zipper(patches, {});
  zipper.add({0, all_but_a_disk(patches[0])}, context);
  // Both would close the same hole.
  const std::vector<ZipperTurn> turns = {{1, everything(patches[1])}, {0, everything(patches[0])}};
  zipper.revisit(turns, context);
  expect_one_sheet(zipper.mesh(), context);
}

TEST(Zipper, ViewsThatSeeNothingInCommonTakeTurnsTogether) {
  Context context(2);
  std::vector<Patch> patches;
  for (const double x : {0.0, 10.0})
    patches.push_back(test::make_patch(test::make_view("v", test::small_camera(), test::look_at({x, 0, 2}, {x, 0, 0}),
                                                       test::plane({0, 0, 0}, {0, 0, 1})),
                                       kNoise, context));
  const std::vector<ZipperTurn> turns = {{0, everything(patches[0])}, {1, everything(patches[1])}};
  Zipper together(patches, {}), apart(patches, {});
  together.add(turns, context);
  for (const ZipperTurn& turn : turns) apart.add(turn, context);
  expect_valid_mesh(together.mesh());
  EXPECT_GT(together.mesh().triangle_count(), 0u);
  EXPECT_EQ(together.mesh().triangles, apart.mesh().triangles);
  EXPECT_EQ(together.mesh().vertex_view, apart.mesh().vertex_view);
  EXPECT_EQ(together.mesh().positions_m, apart.mesh().positions_m);
  EXPECT_EQ(together.report().open_edges, apart.report().open_edges);
}

TEST(Zipper, LeavesNothingOpenAtAScannersPolesThatCannotBeClosed) {
  constexpr double kPi = std::numbers::pi;
  Context context(2);
  const auto sensor = SphericalSensor::from_limits(400, 200, -kPi, kPi, kPi / 2, -kPi / 2);
  View view = test::make_view("v", sensor, Eigen::Isometry3d::Identity(), test::box_room({-2, -2, -1}, {2, 2, 1}));
  std::mt19937 random(1);
  std::normal_distribution<float> noise(0, 0.002f);
  for (float& r : view.range.pixels) r += noise(random);
  test::Joined joined = test::join({view}, kNoise, context);
  expect_valid_mesh(joined.mesh);
  EXPECT_EQ(check_health(joined.mesh, {}, context).components, 1u);
  // Of 400 samples in the first row and in the last.
  EXPECT_LE(check_health(joined.mesh, {}, context).boundary_edges, 30u);
  close_cracks(joined.mesh, joined.patches, {}, context);
  expect_valid_mesh(joined.mesh);
  EXPECT_EQ(check_health(joined.mesh, {}, context).boundary_edges, 0u);
}

TEST(GroupTurns, ViewsThatOverlapAreApart) {
  using Groups = std::vector<std::vector<std::uint32_t>>;
  const std::vector<std::array<std::uint32_t, 2>> overlapping = {{0, 1}, {2, 1}, {3, 0}};
  EXPECT_EQ(group_turns(5, overlapping, 8), (Groups{{0, 2, 4}, {1, 3}}));
  EXPECT_EQ(group_turns(5, overlapping, 2), (Groups{{0, 2}, {1, 3}, {4}}));
  EXPECT_EQ(group_turns(3, {}, 1), (Groups{{0}, {1}, {2}}));
  EXPECT_TRUE(group_turns(0, {}, 8).empty());
}

TEST(Zipper, GoesOnWithAThinnerMesh) {
  Context context(2);
  const auto patches = two_views_of(test::plane({0, 0, 0}, {0, 0, 1}), context);
  Zipper zipper(patches, {});
  zipper.add({0, everything(patches[0])}, context);
  const Mesh mesh = zipper.take();
  EXPECT_TRUE(zipper.mesh().triangles.empty());
  Mesh thinner = reduce(mesh, expected_errors(mesh, patches), {.max_error_sigma = 0.3}, context).mesh;
  ASSERT_LT(thinner.triangle_count(), mesh.triangle_count());
  zipper.replace_mesh(std::move(thinner), context);
  zipper.add({1, everything(patches[1])}, context);
  expect_one_sheet(zipper.mesh(), context);
}

TEST(Zipper, NothingWantedNothingAdded) {
  Context context(1);
  const auto patches = two_views_of(test::plane({0, 0, 0}, {0, 0, 1}), context);
  Zipper zipper(patches, {});
  zipper.revisit({0, everything(patches[0])}, context);
  EXPECT_EQ(zipper.mesh().triangle_count(), 0u);
  zipper.add({0, Image<std::uint8_t>(120, 120, 0)}, context);
  EXPECT_EQ(zipper.mesh().triangle_count(), 0u);
}

TEST(Zipper, ViewsWithoutACellAddNothing) {
  Context context(1);
  const test::Shape wall = test::plane({0, 0, 0}, {0, 0, 1});
  auto patches = two_views_of(wall, context);
  PinholeSensor line = test::small_camera();
  line.width = 1;
  patches.push_back(
      test::make_patch(test::make_view("line", line, test::look_at({0, 0, 2}, {0, 0, 0}), wall), kNoise, context));
  Zipper zipper(patches, {});
  zipper.add({0, everything(patches[0])}, context);
  const std::size_t triangles = zipper.mesh().triangle_count();
  zipper.add({2, everything(patches[2])}, context);
  EXPECT_EQ(zipper.mesh().triangle_count(), triangles);
}

TEST(SplitPinchedVertices, TwoTrianglesThatTouchInAPoint) {
  Mesh mesh;
  mesh.positions_m = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {-1, 0, 0}, {0, -1, 0}};
  mesh.triangles = {{0, 1, 2}, {0, 3, 4}};
  mesh.vertex_view = {5, 6, 7, 8, 9};
  EXPECT_EQ(split_pinched_vertices(mesh), 1u);
  EXPECT_EQ(mesh.vertex_count(), 6u);
  EXPECT_EQ(mesh.vertex_view.back(), 5u);
  EXPECT_EQ(mesh.positions_m.back(), mesh.positions_m[0]);
  EXPECT_EQ(split_pinched_vertices(mesh), 0u);
}

// Three triangles at one edge, two of them on the same side of it.
TEST(RemoveNonmanifold, OfTwoOnOneSideOfAnEdgeTheFirstStays) {
  Mesh mesh;
  mesh.positions_m = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, -1, 0}, {0, 1, 1}};
  mesh.triangles = {{0, 1, 2}, {1, 0, 3}, {0, 1, 4}};
  EXPECT_EQ(remove_nonmanifold(mesh), 1u);
  EXPECT_EQ(mesh.triangles, (std::vector<Triangle>{{0, 1, 2}, {1, 0, 3}}));
  EXPECT_EQ(remove_nonmanifold(mesh), 0u);
}

TEST(RemoveSmallComponents, KeepsTheLargeOnes) {
  Mesh mesh;
  for (int j = 0; j < 3; ++j)
    for (int i = 0; i < 3; ++i) mesh.positions_m.push_back({float(i), float(j), 0});
  for (const std::uint32_t a : {0u, 1u, 3u, 4u}) {
    mesh.triangles.push_back({a, a + 1, a + 4});
    mesh.triangles.push_back({a, a + 4, a + 3});
  }
  mesh.positions_m.insert(mesh.positions_m.end(), {{9, 0, 0}, {9, 1, 0}, {8, 0, 0}});
  mesh.triangles.push_back({9, 10, 11});
  mesh.triangle_view.assign(mesh.triangle_count(), 0);
  EXPECT_EQ(remove_small_components(mesh, 3), 1u);
  EXPECT_EQ(mesh.triangle_count(), 8u);
  EXPECT_EQ(mesh.vertex_count(), 9u);
  EXPECT_EQ(mesh.triangle_view.size(), 8u);
}

}  // namespace
}  // namespace lapseam
