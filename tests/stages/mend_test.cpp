#include <gtest/gtest.h>

#include "health/self_intersection.h"
#include "lapseam/context.h"
#include "lapseam/health.h"
#include "mend/silhouettes.h"
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

// A plate of 0.4 m over a floor, seen from above.
TEST(ExtendSilhouettes, APlateIsAsWideAsItWas) {
  Context context(2);
  const test::Shape scene =
      test::nearest({test::plane({0, 0, 0}, {0, 0, 1}), test::rectangle(0.6, -0.2, 0.2, -0.2, 0.2)});
  const View view = test::make_view("v", test::small_camera(), test::look_at({0.01, 0.02, 2}, {0.01, 0.02, 0}), scene);
  test::Joined joined = test::join({view}, kNoise, context);
  const auto width = [&] {
    float low = 9, high = -9;
    for (const Eigen::Vector3f& p : joined.mesh.positions_m)
      if (p.z() > 0.5f) low = std::min(low, p.x()), high = std::max(high, p.x());
    return high - low;
  };
  const float pitch = 1.4f * (joined.patches[0].rays->directions[1] - joined.patches[0].rays->directions[0]).norm();
  const float before = width();
  EXPECT_LT(before, 0.4f);
  const std::uint64_t moved = extend_silhouettes(joined.mesh, joined.patches, {}, 0, context);
  EXPECT_GT(moved, 20u);
  EXPECT_NEAR(width(), before + pitch, 0.1f * pitch);
  EXPECT_NEAR(width(), 0.4f, pitch);
  // The floor goes on in the plate's shadow, and at the image's border nothing is known.
  for (const Eigen::Vector3f& p : joined.mesh.positions_m) EXPECT_NEAR(p.z(), p.z() < 0.5f ? 0.0f : 0.6f, 1e-4f);
  expect_valid_mesh(joined.mesh);
}

}  // namespace
}  // namespace lapseam
