#include <gtest/gtest.h>

#include <algorithm>
#include <set>

#include "health/self_intersection.h"
#include "lapseam/context.h"
#include "lapseam/health.h"
#include "mend/extend_outlines.h"
#include "mend/seen_through.h"
#include "mend/untangle.h"
#include "support/analytic_views.h"
#include "support/expect_valid_mesh.h"
#include "support/joined.h"

namespace lapseam {
namespace {

constexpr NoiseModel kNoise{0.002, 0, 0, 0};

// A strip of eight triangles in the plane z = 0, and one triangle that stands in it.
Mesh pierced_strip() {
  Mesh mesh;
  for (int i = 0; i < 5; ++i) {
    mesh.positions_m.emplace_back(float(i), 0.0f, 0.0f);
    mesh.positions_m.emplace_back(float(i), 1.0f, 0.0f);
  }
  for (std::uint32_t i = 0; i < 4; ++i) {
    mesh.triangles.push_back({2 * i, 2 * i + 2, 2 * i + 1});
    mesh.triangles.push_back({2 * i + 1, 2 * i + 2, 2 * i + 3});
  }
  mesh.positions_m.emplace_back(0.2f, 0.5f, -0.5f);
  mesh.positions_m.emplace_back(3.8f, 0.5f, -0.5f);
  mesh.positions_m.emplace_back(2.0f, 0.5f, 1.0f);
  mesh.triangles.push_back({10, 11, 12});
  mesh.triangle_tag.assign(mesh.triangle_count(), TriangleTag::kMeasured);
  mesh.triangle_view.assign(mesh.triangle_count(), 0);
  return mesh;
}

TEST(RemoveSelfIntersections, TakesTheOneThatMeetsMost) {
  Context context(2);
  Mesh mesh = pierced_strip();
  const std::vector<float> errors(mesh.vertex_count(), 0.001f);
  EXPECT_EQ(remove_self_intersections(mesh, errors, context), 1u);
  EXPECT_EQ(mesh.triangle_count(), 8u);
  EXPECT_EQ(find_self_intersections(mesh.positions_m, mesh.triangles, context).triangles, 0u);
}

TEST(RemoveSelfIntersections, SeamsGoFirst) {
  Context context(2);
  Mesh mesh = pierced_strip();
  for (std::size_t t = 0; t < 8; ++t) mesh.triangle_tag[t] = TriangleTag::kSeam;
  const std::vector<float> errors(mesh.vertex_count(), 0.001f);
  EXPECT_GT(remove_self_intersections(mesh, errors, context), 1u);
  EXPECT_EQ(mesh.triangle_tag.back(), TriangleTag::kMeasured);
  EXPECT_EQ(find_self_intersections(mesh.positions_m, mesh.triangles, context).triangles, 0u);
}

TEST(RemoveSelfIntersections, WhatMeetsNothingStays) {
  Context context(2);
  Mesh mesh = pierced_strip();
  mesh.triangles.pop_back();
  mesh.triangle_tag.pop_back();
  mesh.triangle_view.pop_back();
  const std::vector<float> errors(mesh.vertex_count(), 0.001f);
  EXPECT_EQ(remove_self_intersections(mesh, errors, context), 0u);
  EXPECT_EQ(mesh.triangle_count(), 8u);
}

// How wide what lies above or below half a metre is, along x.
float width_of(const Mesh& mesh, bool is_above) {
  float low = 9, high = -9;
  for (const Eigen::Vector3f& p : mesh.positions_m)
    if ((p.z() > 0.5f) == is_above) low = std::min(low, p.x()), high = std::max(high, p.x());
  return high - low;
}

// A plate of 0.4 m, 0.6 m over a floor, seen from 2 m above it.
test::Joined see_plate(Context& context) {
  const test::Shape scene =
      test::nearest({test::plane({0, 0, 0}, {0, 0, 1}), test::rectangle(0.6, -0.2, 0.2, -0.2, 0.2)});
  const View view = test::make_view("v", test::small_camera(), test::look_at({0.01, 0.02, 2}, {0.01, 0.02, 0}), scene);
  return test::join({view}, kNoise, context);
}

TEST(ExtendOutlines, APlateIsAsWideAsItWasAndSoIsTheFloor) {
  Context context(2);
  test::Joined joined = see_plate(context);
  const float angle = (joined.patches[0].rays->directions[1] - joined.patches[0].rays->directions[0]).norm();
  const float plate_pitch = 1.4f * angle, floor_pitch = 2 * angle;
  const float plate = width_of(joined.mesh, true), floor = width_of(joined.mesh, false);
  EXPECT_LT(plate, 0.4f);
  EXPECT_NEAR(floor, 119 * floor_pitch, 0.1f * floor_pitch);
  EXPECT_GT(extend_outlines(joined.mesh, joined.patches, {}, 0, context), 20u);
  EXPECT_NEAR(width_of(joined.mesh, true), plate + plate_pitch, 0.1f * plate_pitch);
  EXPECT_NEAR(width_of(joined.mesh, true), 0.4f, plate_pitch);
  EXPECT_NEAR(width_of(joined.mesh, false), floor + floor_pitch, 0.1f * floor_pitch);
  for (const Eigen::Vector3f& p : joined.mesh.positions_m) EXPECT_NEAR(p.z(), p.z() < 0.5f ? 0.0f : 0.6f, 1e-4f);
  expect_valid_mesh(joined.mesh);
}

TEST(ExtendOutlines, AFloorGoesOnHalfASampleUnderThePlate) {
  Context context(2);
  test::Joined joined = see_plate(context);
  const float angle = (joined.patches[0].rays->directions[1] - joined.patches[0].rays->directions[0]).norm();
  const auto hole = [&] {
    float nearest = 9;
    for (const Eigen::Vector3f& p : joined.mesh.positions_m)
      if (p.z() < 0.5f && std::abs(p.y() - 0.02f) < 0.1f && p.x() > 0.01f) nearest = std::min(nearest, p.x());
    return nearest;
  };
  const float before = hole();
  extend_outlines(joined.mesh, joined.patches, {}, 0, context);
  EXPECT_NEAR(hole(), before - 0.5f * 2 * angle, 0.1f * angle);
}

TEST(ExtendOutlines, WhereTheSurfaceGoesOnNothingMoves) {
  Context context(2);
  test::Joined joined = see_plate(context);
  // A hole in the floor, which its view saw whole.
  std::set<std::uint32_t> around;
  std::erase_if(joined.mesh.triangles, [&](const Triangle& t) {
    const Eigen::Vector3f& p = joined.mesh.positions_m[t[0]];
    const bool is_in_hole = p.z() < 0.5f && (p - Eigen::Vector3f(-0.6f, 0, 0)).norm() < 0.1f;
    if (is_in_hole) around.insert(t.begin(), t.end());
    return is_in_hole;
  });
  joined.mesh.triangle_tag.resize(joined.mesh.triangle_count());
  joined.mesh.triangle_view.resize(joined.mesh.triangle_count());
  EXPECT_GE(around.size(), 3u);
  const std::vector<Eigen::Vector3f> before = joined.mesh.positions_m;
  EXPECT_GT(extend_outlines(joined.mesh, joined.patches, {}, 0, context), 0u);
  for (const std::uint32_t v : around) EXPECT_EQ(joined.mesh.positions_m[v], before[v]);
}

// A plate over a floor as five views see it; the first one's pose is 80 mm off, and its mesh with it.
class RemoveSeenThrough : public testing::Test {
 protected:
  void see(double half_width_m) {
    const test::Shape scene = test::nearest(
        {test::plane({0, 0, 0}, {0, 0, 1}), test::rectangle(0.6, -half_width_m, half_width_m, -0.3, 0.3)});
    std::vector<View> views;
    for (const double y : {0.0, -0.2, -0.1, 0.1, 0.2})
      views.push_back(test::make_view("v", test::small_camera(), test::look_at({0.01, y, 2}, {0.01, 0.02, 0}), scene));
    views[0].T_world_view.pretranslate(Eigen::Vector3d(kOff_m, 0, 0));
    mesh_ = test::join({views[0]}, kNoise, context_).mesh;
    for (const View& view : views) patches_.push_back(test::make_patch(view, kNoise, context_));
    pitch_m_ = 1.4f * (patches_[0].rays->directions[1] - patches_[0].rays->directions[0]).norm();
  }

  std::uint64_t remove(double registration_error_m) {
    const OverlapOptions options{.registration_error_m = registration_error_m};
    const std::vector<float> errors(mesh_.vertex_count(), 0.002f);
    LiveMesh live(mesh_);
    const TriangleCheck check(live, {}, context_);
    const Witnesses witnesses(patches_, mesh_.origin_m, options);
    const std::uint64_t removed = remove_seen_through(live, check, witnesses, errors, options, context_);
    mesh_ = compact(mesh_, live.alive());
    return removed;
  }

  // Of the plate, along x.
  float end() const {
    float farthest = -9;
    for (const Triangle& t : mesh_.triangles)
      for (const std::uint32_t v : t)
        if (mesh_.positions_m[v].z() > 0.5f) farthest = std::max(farthest, mesh_.positions_m[v].x());
    return farthest;
  }

  static constexpr double kOff_m = 0.08;
  Context context_{2};
  Mesh mesh_;
  std::vector<Patch> patches_;
  float pitch_m_ = 0;
};

TEST_F(RemoveSeenThrough, ARimEndsWhereItDoesForMostViews) {
  see(0.2);
  ASSERT_NEAR(end(), 0.28f, pitch_m_);
  EXPECT_GT(remove(0.04), 10u);
  EXPECT_NEAR(end(), 0.2f, 2 * pitch_m_);
  expect_valid_mesh(mesh_);
  EXPECT_EQ(remove(0.04), 0u);
}

TEST_F(RemoveSeenThrough, AThingThinnerThanPosesAreOffStays) {
  see(0.02);
  const auto count = [&] {
    return std::count_if(mesh_.triangles.begin(), mesh_.triangles.end(),
                         [&](const Triangle& t) { return mesh_.positions_m[t[0]].z() > 0.5f; });
  };
  const auto before = count();
  ASSERT_GT(before, 20);
  remove(0.02);
  EXPECT_EQ(count(), before);
}

TEST_F(RemoveSeenThrough, WithoutARegistrationErrorNothingGoes) {
  see(0.2);
  EXPECT_EQ(remove(0), 0u);
}

}  // namespace
}  // namespace lapseam
