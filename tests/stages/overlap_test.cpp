// One layer where all views together show a surface: which view is best there, what is kept of the others, what is seen
// through; and the mesh that comes of it.

#include <gtest/gtest.h>

#include <random>

#include "lapseam/context.h"
#include "lapseam/health.h"
#include "support/analytic_views.h"
#include "support/expect_valid_mesh.h"
#include "support/joined.h"

namespace lapseam {
namespace {

constexpr NoiseModel kNoise{0.002, 0, 0, 0};

test::Joined join(const std::vector<View>& views, int threads = 2, const OverlapOptions& options = {}) {
  Context context(threads);
  return test::join(views, kNoise, context, options);
}

View look(const std::string& name, const Eigen::Vector3d& eye, const Eigen::Vector3d& target,
          const test::Shape& shape) {
  return test::make_view(name, test::small_camera(), test::look_at(eye, target), shape);
}

// How many triangles a ray from `eye` through `target` meets, by brute force (Möller–Trumbore).
int layers_at(const Mesh& mesh, const Eigen::Vector3d& eye, const Eigen::Vector3d& target) {
  int layers = 0;
  const Eigen::Vector3d d = target - eye;
  for (const Triangle& t : mesh.triangles) {
    std::array<Eigen::Vector3d, 3> p;
    for (std::size_t k = 0; k < 3; ++k) p[k] = mesh.origin_m + mesh.positions_m[t[k]].cast<double>();
    const Eigen::Vector3d e1 = p[1] - p[0], e2 = p[2] - p[0], q = d.cross(e2);
    const double det = e1.dot(q);
    if (std::abs(det) < 1e-15) continue;
    const Eigen::Vector3d s = eye - p[0], r = s.cross(e1);
    const double u = s.dot(q) / det, v = d.dot(r) / det;
    layers += u >= 0 && v >= 0 && u + v <= 1 && e2.dot(r) / det > 0;
  }
  return layers;
}

TEST(Overlap, OneLayerAndNoGapOfTwoViewsOfAPlane) {
  const test::Shape wall = test::plane({0, 0, 0}, {0, 0, 1});
  const test::Joined joined =
      join({look("a", {0, 0, 2}, {0, 0, 0}, wall), look("b", {0.5, 0.2, 2.2}, {0.4, 0, 0}, wall)});
  expect_valid_mesh(joined.mesh);
  std::mt19937 random(5);
  std::uniform_real_distribution<double> u(-0.5, 0.8);
  for (int i = 0; i < 300; ++i) EXPECT_EQ(layers_at(joined.mesh, {0, 0, 3}, {u(random), u(random) * 0.6, 0}), 1);
  EXPECT_GT(joined.counts[0].best, 1000u);
  EXPECT_GT(joined.counts[1].best, 1000u);
  EXPECT_GT(joined.report.seam_triangles, 20u);
  Context context(1);
  const MeshHealth health = check_health(joined.mesh, {}, context);
  EXPECT_EQ(health.boundary_loops, 1u);  // the outline of what was seen, no crack
  EXPECT_EQ(health.self_intersecting_triangles, 0u);
}

TEST(Overlap, TheLastSamplesOfASurfaceAreClaimedWhereverTheyLie) {
  // Views are asked in tiles of 32 × 32; here the last row or column of samples is the first of a tile.
  const View whole = look("a", {0, 0, 2}, {0, 0, 0}, test::plane({0, 0, 0}, {0, 0, 1}));
  for (const bool is_row : {true, false}) {
    View part = whole;
    for (int v = 0; v < part.range.height; ++v)
      for (int u = 0; u < part.range.width; ++u)
        if ((is_row ? v : u) > 64) part.range.at(u, v) = kInvalidRange;
    const test::Joined joined = join({part});
    EXPECT_EQ(joined.counts[0].best, 65u * 120u) << is_row;
  }
}

TEST(Overlap, SameViewTwiceAddsNothing) {
  const test::Shape ball = test::sphere({0, 0, 0}, 0.5);
  const View view = look("a", {0, -2, 0.3}, {0, 0, 0}, ball);
  const test::Joined once = join({view}), twice = join({view, view});
  EXPECT_EQ(twice.counts[1].best, 0u);
  EXPECT_EQ(twice.mesh.triangle_count(), once.mesh.triangle_count());
}

TEST(Overlap, NearerViewWinsWhereBothSee) {
  const test::Shape wall = test::plane({0, 0, 0}, {0, 0, 1});
  for (const bool near_first : {true, false}) {
    const View near = look("near", {0, 0, 1}, {0, 0, 0}, wall), far = look("far", {0, 0, 3}, {0, 0, 0}, wall);
    const test::Joined joined = near_first ? join({near, far}) : join({far, near});
    // All but the rim, where confidence falls off.
    EXPECT_GT(double(joined.counts[near_first ? 0 : 1].best), 0.8 * 120 * 120) << near_first;
    EXPECT_GT(joined.counts[near_first ? 1 : 0].best, 1000u) << near_first;
    for (int i = -5; i <= 5; ++i)
      EXPECT_EQ(layers_at(joined.mesh, {0, 0, 3}, {0.1 * i + 0.001, 0.07 * i + 0.002, 0}), 1) << near_first;
  }
}

TEST(Overlap, BothSidesOfAThinSheetSurvive) {
  // A sheet thinner than the noise, seen from both sides.
  const test::Shape sheet =
      test::nearest({test::rectangle(0.001, -0.4, 0.4, -0.4, 0.4), test::rectangle(-0.001, -0.4, 0.4, -0.4, 0.4)});
  const View front = look("front", {0, 0.1, 1.5}, {0, 0, 0}, sheet),
             back = look("back", {0.1, 0, -1.5}, {0, 0, 0}, sheet);
  const test::Joined joined = join({front, back});
  EXPECT_EQ(joined.counts[0].yields + joined.counts[1].yields, 0u);
  EXPECT_EQ(joined.report.seam_triangles, 0u);
  for (int i = -5; i <= 5; ++i) EXPECT_EQ(layers_at(joined.mesh, {0, 0, 3}, {0.05 * i + 0.001, 0.03 * i, 0}), 2);
}

TEST(Overlap, WhatAnotherViewSeesThroughGoes) {
  const test::Shape wall = test::plane({0, 0, 0}, {0, 0, 1});
  const test::Shape with_guest = test::nearest({wall, test::rectangle(0.8, -0.15, 0.15, -0.15, 0.15)});
  const View guest = look("guest", {0, 0, 2}, {0, 0, 0}, with_guest),
             empty = look("empty", {0.2, 0, 2}, {0, 0, 0}, wall);
  for (const bool guest_first : {true, false}) {
    const test::Joined joined = guest_first ? join({guest, empty}) : join({empty, guest});
    EXPECT_GT(joined.phantoms(), 100u);
    for (const Eigen::Vector3f& p : joined.mesh.positions_m) EXPECT_LT(p.z(), 0.5f);
  }
  EXPECT_EQ(join({guest, empty}, 2, {.remove_seen_through = false}).phantoms(), 0u);
}

TEST(Overlap, OneViewOfManyDoesNotMakeAPhantom) {
  // Where a step is out of place by the error of a pose, one view looks past what the others agree about.
  const test::Shape wall = test::plane({0, 0, 0}, {0, 0, 1});
  const test::Shape with_board = test::nearest({wall, test::rectangle(0.8, -0.15, 0.15, -0.15, 0.15)});
  std::vector<View> views = {look("a", {0, 0, 2}, {0, 0, 0}, with_board),
                             look("b", {-0.2, 0, 2}, {0, 0, 0}, with_board),
                             look("c", {0, 0.2, 2}, {0, 0, 0}, with_board), look("d", {0.2, 0, 2}, {0, 0, 0}, wall)};
  const std::uint64_t of_three = join(views).phantoms();  // along the rim, where each is alone
  std::swap(views[1], views[3]);
  views.resize(2);
  const std::uint64_t of_one = join(views).phantoms();
  EXPECT_GT(of_one, 300u);
  EXPECT_LT(of_three, of_one / 10);
}

TEST(Overlap, ConsensusReachesAsFarAsPosesMayBeOff) {
  // Five views, each with the wall elsewhere by its pose: far beyond their noise.
  std::vector<View> views;
  const std::array<double, 5> off_m = {-0.02, -0.01, 0.002, 0.011, 0.017};
  for (std::size_t i = 0; i < off_m.size(); ++i) {
    const double x = 0.05 * double(i) - 0.1;
    views.push_back(look("v", {x, 0, 2}, {x, 0, 0}, test::plane({0, 0, off_m[i]}, {0, 0, 1})));
  }
  const auto heights = [&](double registration_error_m) {
    const test::Joined joined = join(views, 2, {.registration_error_m = registration_error_m});
    std::array<double, 5> out;
    for (std::size_t i = 0; i < views.size(); ++i) out[i] = 2 - double(joined.patches[i].view.range.at(60, 60));
    return out;
  };
  for (const double height : heights(0.015)) EXPECT_NEAR(height, 0, 0.0005);
  // Without such an error they are told apart, and keep where they are.
  EXPECT_LT(heights(0)[0], -0.018);
  EXPECT_GT(heights(0)[4], 0.016);
}

TEST(Overlap, WhatIsOnlyHiddenStays) {
  // A wall behind an obstacle that the new view sees: the obstacle hides the wall, it does not contradict it.
  const test::Shape wall = test::plane({0, 0, 0}, {0, 0, 1});
  const test::Shape obstacle = test::nearest({wall, test::rectangle(1.0, -5, 0, -5, 5)});
  const View open = look("open", {0, 0, 0.9}, {0, 0, 0}, obstacle);  // in front of the obstacle's plane
  const View blocked = look("blocked", {0, 0, 2}, {0, 0, 0}, obstacle);
  const test::Joined joined = join({open, blocked});
  for (int i = 1; i <= 10; ++i) EXPECT_EQ(layers_at(joined.mesh, {0, 0, 0.9}, {-0.03 * i, 0.01, 0}), 1);
}

TEST(Overlap, ConsensusAveragesTheNoiseOfAllViews) {
  const test::Shape wall = test::plane({0, 0, 0}, {0, 0, 1});
  std::vector<View> views;
  for (int i = 0; i < 9; ++i)
    views.push_back(test::make_view("v", test::small_camera(), test::look_at({0.05 * i - 0.2, 0, 2}, {0, 0, 0}), wall,
                                    0.0004, unsigned(i)));
  const auto rms = [&](bool consensus) {
    const test::Joined joined = join(views, 2, {.consensus = consensus});
    double sum = 0;
    std::size_t count = 0;
    for (std::size_t k = 0; k < views.size(); ++k)
      // Where all views are asked; in between, what they say is interpolated, for images that were smoothed.
      for (int v = 40; v < 80; v += 4)
        for (int u = 40; u < 80; u += 4) {
          const Patch& patch = joined.patches[k];
          const std::size_t i = patch.confidence.index(u, v);
          if (joined.claims[k].pixels[i] != std::uint8_t(Claim::kBest)) continue;  // what yields is not moved
          ++count;
          const double z = (patch.view.T_world_view * patch.point_in_view(i).cast<double>()).z();
          sum += z * z;
        }
    return std::sqrt(sum / double(count));
  };
  const double before = rms(false), after = rms(true);
  EXPECT_NEAR(before, 0.0004, 0.00004);
  // Nine views; interpolation between the others' samples averages a little more.
  EXPECT_LT(after, before / 2.5);
}

TEST(Overlap, PanoramaAgainstCameraAcrossTheSeam) {
  const test::Shape room = test::box_room({-2, -2, -1.5}, {2, 2, 1.5});
  const View pano = test::make_view("pano", SphericalSensor::from_limits(360, 120, -M_PI, M_PI, 1.0, -1.0),
                                    Eigen::Isometry3d::Identity(), room);
  // The camera is nearer to the wall at −x, where the panorama's first and last columns meet.
  const View camera = look("camera", {-1, 0.1, 0}, {-2, 0, 0}, room);
  const test::Joined joined = join({pano, camera});
  expect_valid_mesh(joined.mesh);
  EXPECT_GT(double(joined.counts[1].best), 0.8 * 120 * 120);
  for (int i = -8; i <= 8; ++i) EXPECT_EQ(layers_at(joined.mesh, {0, 0, 0}, {-2, 0.05 * i + 0.003, 0.011}), 1);
}

TEST(Overlap, PanoramaAloneIsClosedAtItsCut) {
  const test::Shape room = test::box_room({-2, -2, -1.5}, {2, 2, 1.5});
  const View pano = test::make_view("pano", SphericalSensor::from_limits(360, 120, -M_PI, M_PI, 1.0, -1.0),
                                    Eigen::Isometry3d::Identity(), room);
  const test::Joined joined = join({pano});
  for (int i = -8; i <= 8; ++i) EXPECT_EQ(layers_at(joined.mesh, {0, 0, 0}, {-2, 0.007 * i + 0.003, 0.011}), 1);
}

TEST(Overlap, SameForAnyThreads) {
  allow_threads(8);  // or threads beyond the processors would not be made
  const test::Shape shape = test::nearest({test::plane({0, 0, 0}, {0, 0, 1}), test::sphere({0, 0, 0.2}, 0.3)});
  std::vector<View> views;
  for (int i = 0; i < 5; ++i)
    views.push_back(test::make_view("v", test::small_camera(),
                                    test::look_at({std::cos(i), std::sin(i), 1.6}, {0, 0, 0}), shape, 0.002,
                                    unsigned(i)));
  const test::Joined reference = join(views, 1);
  for (const int threads : {2, 3, 8}) {
    const test::Joined joined = join(views, threads);
    for (std::size_t i = 0; i < views.size(); ++i) EXPECT_EQ(joined.claims[i].pixels, reference.claims[i].pixels);
    EXPECT_EQ(joined.mesh.triangles, reference.mesh.triangles);
    EXPECT_EQ(joined.mesh.positions_m, reference.mesh.positions_m);
  }
}

}  // namespace
}  // namespace lapseam
