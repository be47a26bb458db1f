#include "lapseam/overlap.h"

#include <gtest/gtest.h>

#include "lapseam/context.h"
#include "support/analytic_views.h"
#include "support/patches.h"

namespace lapseam {
namespace {

constexpr NoiseModel kNoise{0.002, 0, 0, 0};

// Adds views one after another; returns the patches with their alive bits as the model has them.
std::vector<Patch> add_all(const std::vector<View>& views, int threads = 2, OverlapCounts* sum = nullptr,
                           const OverlapOptions& options = {}) {
  Context context(threads);
  std::vector<Patch> patches;
  OverlapRemoval removal(options);
  patches.reserve(views.size());
  for (const View& view : views) {
    patches.push_back(test::make_patch(view, kNoise, context));
    const OverlapCounts counts = removal.add(patches, context);
    if (sum) {
      sum->removed_old += counts.removed_old;
      sum->removed_new += counts.removed_new;
      sum->removed_seen_through += counts.removed_seen_through;
    }
  }
  return patches;
}

View look(const std::string& name, const Eigen::Vector3d& eye, const Eigen::Vector3d& target,
          const test::Shape& shape) {
  return test::make_view(name, test::small_camera(), test::look_at(eye, target), shape);
}

// How many alive triangles of all patches a ray from `eye` through each of a grid of targets passes within `near_m` of:
// the number of layers, by brute force over triangles (Möller–Trumbore).
int layers_at(const std::vector<Patch>& patches, const Eigen::Vector3d& eye, const Eigen::Vector3d& target) {
  int layers = 0;
  const Eigen::Vector3d d = target - eye;
  for (const Patch& patch : patches)
    for (std::size_t cell = 0; cell < patch.grid.cells.size(); ++cell)
      for (int slot = 0; slot < 2; ++slot) {
        if (!patch.grid.is_alive(cell, slot)) continue;
        std::array<Eigen::Vector3d, 3> p;
        const auto corners = patch.grid.corners(cell, slot);
        for (std::size_t k = 0; k < 3; ++k)
          p[k] = patch.view.T_world_view * patch.point_in_view(corners[k]).cast<double>();
        const Eigen::Vector3d e1 = p[1] - p[0], e2 = p[2] - p[0], q = d.cross(e2);
        const double det = e1.dot(q);
        if (std::abs(det) < 1e-15) continue;
        const Eigen::Vector3d s = eye - p[0], r = s.cross(e1);
        const double u = s.dot(q) / det, v = d.dot(r) / det;
        layers += u >= 0 && v >= 0 && u + v <= 1 && e2.dot(r) / det > 0;
      }
  return layers;
}

TEST(Overlap, OneLayerIsLeftOfTwoViewsOfAPlane) {
  const test::Shape wall = test::plane({0, 0, 0}, {0, 0, 1});
  const auto patches = add_all({look("a", {0, 0, 2}, {0, 0, 0}, wall), look("b", {0.5, 0.2, 2.2}, {0.4, 0, 0}, wall)});
  int single = 0, gaps = 0;
  std::mt19937 random(5);
  std::uniform_real_distribution<double> u(-0.5, 0.8);
  for (int i = 0; i < 300; ++i) {
    const int layers = layers_at(patches, {0, 0, 3}, {u(random), u(random) * 0.6, 0});
    EXPECT_LE(layers, 1);
    single += layers == 1;
    gaps += layers == 0;
  }
  EXPECT_GT(patches[0].grid.alive_count(), 1000u);
  EXPECT_GT(patches[1].grid.alive_count(), 1000u);
  // The gap along the cut is about two triangles wide; it must not eat more than that.
  EXPECT_LT(gaps, 40);
  EXPECT_GT(single, 250);
}

TEST(Overlap, SameViewTwiceAddsNothing) {
  const test::Shape ball = test::sphere({0, 0, 0}, 0.5);
  const View view = look("a", {0, -2, 0.3}, {0, 0, 0}, ball);
  const auto patches = add_all({view, view});
  EXPECT_EQ(patches[1].grid.alive_count(), 0u);
  Context context(1);
  EXPECT_EQ(patches[0].grid.alive_count(), test::make_patch(view, kNoise, context).grid.alive_count());
}

TEST(Overlap, NearerViewWinsWhereBothSee) {
  const test::Shape wall = test::plane({0, 0, 0}, {0, 0, 1});
  for (const bool near_first : {true, false}) {
    const View near = look("near", {0, 0, 1}, {0, 0, 0}, wall), far = look("far", {0, 0, 3}, {0, 0, 0}, wall);
    const auto patches = near_first ? add_all({near, far}) : add_all({far, near});
    const Patch& near_patch = patches[near_first ? 0 : 1];
    const Patch& far_patch = patches[near_first ? 1 : 0];
    // All but the rim, where confidence falls off.
    EXPECT_GT(double(near_patch.grid.alive_count()), 0.8 * 119 * 119 * 2) << near_first;
    EXPECT_GT(far_patch.grid.alive_count(), 1000u) << near_first;
    EXPECT_LT(far_patch.grid.alive_count(), 119u * 119u * 2u) << near_first;
  }
}

TEST(Overlap, BothSidesOfAThinSheetSurvive) {
  // A sheet thinner than the noise, seen from both sides.
  const test::Shape sheet =
      test::nearest({test::rectangle(0.001, -0.4, 0.4, -0.4, 0.4), test::rectangle(-0.001, -0.4, 0.4, -0.4, 0.4)});
  const View front = look("front", {0, 0.1, 1.5}, {0, 0, 0}, sheet),
             back = look("back", {0.1, 0, -1.5}, {0, 0, 0}, sheet);
  Context context(1);
  const auto patches = add_all({front, back});
  EXPECT_EQ(patches[0].grid.alive_count(), test::make_patch(front, kNoise, context).grid.alive_count());
  EXPECT_EQ(patches[1].grid.alive_count(), test::make_patch(back, kNoise, context).grid.alive_count());
}

TEST(Overlap, WhatAnotherViewSeesThroughGoes) {
  const test::Shape wall = test::plane({0, 0, 0}, {0, 0, 1});
  const test::Shape with_guest = test::nearest({wall, test::rectangle(0.8, -0.15, 0.15, -0.15, 0.15)});
  const View guest = look("guest", {0, 0, 2}, {0, 0, 0}, with_guest),
             empty = look("empty", {0.2, 0, 2}, {0, 0, 0}, wall);
  for (const bool guest_first : {true, false}) {
    OverlapCounts counts;
    const auto patches = guest_first ? add_all({guest, empty}, 2, &counts) : add_all({empty, guest}, 2, &counts);
    EXPECT_GT(counts.removed_seen_through, 100u);
    const Patch& patch = patches[guest_first ? 0 : 1];
    for (std::size_t cell = 0; cell < patch.grid.cells.size(); ++cell)
      for (int slot = 0; slot < 2; ++slot)
        if (patch.grid.is_alive(cell, slot)) {
          EXPECT_GT(patch.view.range.pixels[patch.grid.corners(cell, slot)[0]], 1.5f);
        }
  }
  OverlapCounts kept;
  add_all({guest, empty}, 2, &kept, {.remove_seen_through = false});
  EXPECT_EQ(kept.removed_seen_through, 0u);
}

TEST(Overlap, WhatIsOnlyHiddenStays) {
  // A wall behind an obstacle that the new view sees: the obstacle hides the wall, it does not contradict it.
  const test::Shape wall = test::plane({0, 0, 0}, {0, 0, 1});
  const test::Shape obstacle = test::nearest({wall, test::rectangle(1.0, -5, 0, -5, 5)});
  const View open = look("open", {0, 0, 0.9}, {0, 0, 0}, obstacle);  // in front of the obstacle's plane
  const View blocked = look("blocked", {0, 0, 2}, {0, 0, 0}, obstacle);
  const auto patches = add_all({open, blocked});
  for (int i = 1; i <= 10; ++i) EXPECT_EQ(layers_at(patches, {0, 0, 0.9}, {-0.03 * i, 0.01, 0}), 1);
}

TEST(Overlap, PanoramaAgainstCameraAcrossTheSeam) {
  const test::Shape room = test::box_room({-2, -2, -1.5}, {2, 2, 1.5});
  const View pano = test::make_view("pano", SphericalSensor::from_limits(360, 120, -M_PI, M_PI, 1.0, -1.0),
                                    Eigen::Isometry3d::Identity(), room);
  // The camera is nearer to the wall at −x, where the panorama's first and last columns meet.
  const View camera = look("camera", {-1, 0.1, 0}, {-2, 0, 0}, room);
  const auto patches = add_all({pano, camera});
  EXPECT_GT(double(patches[1].grid.alive_count()), 0.8 * 119 * 119 * 2);
  for (int i = -8; i <= 8; ++i) EXPECT_LE(layers_at(patches, {0, 0, 0}, {-2, 0.05 * i + 0.003, 0.011}), 1);
}

TEST(Overlap, SameForAnyThreads) {
  allow_threads(8);  // or threads beyond the processors would not be made
  const test::Shape shape = test::nearest({test::plane({0, 0, 0}, {0, 0, 1}), test::sphere({0, 0, 0.2}, 0.3)});
  std::vector<View> views;
  for (int i = 0; i < 5; ++i)
    views.push_back(test::make_view("v", test::small_camera(),
                                    test::look_at({std::cos(i), std::sin(i), 1.6}, {0, 0, 0}), shape, 0.002,
                                    unsigned(i)));
  const auto reference = add_all(views, 1);
  for (const int threads : {2, 3, 8}) {
    const auto patches = add_all(views, threads);
    for (std::size_t i = 0; i < patches.size(); ++i) EXPECT_EQ(patches[i].grid.cells, reference[i].grid.cells);
  }
}

}  // namespace
}  // namespace lapseam
