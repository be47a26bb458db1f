#include "lapseam/fill_holes.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "lapseam/context.h"
#include "lapseam/error.h"
#include "lapseam/health.h"
#include "sew_meshes/cuts.h"
#include "sew_meshes/shapes.h"
#include "support/expect_valid_mesh.h"

namespace lapseam {
namespace {

using namespace test;

Mesh sphere_with_hole(int n, float cap_radius) {
  return cut_out(sphere(n),
                 [=](const Eigen::Vector3f& p) { return p.z() < 0 || std::hypot(p.x(), p.y()) > cap_radius; });
}

MeshHealth health_of(const Mesh& mesh) {
  Context context(2);
  return check_health(mesh, {}, context);
}

TEST(FillHoles, SmallHoleIsClosed) {
  Context context(2);
  Mesh mesh = sphere_with_hole(24, 0.3f);
  const Mesh before = mesh;
  const std::uint64_t edges = health_of(mesh).boundary_edges;
  const FillHolesReport report = fill_holes(mesh, {.largest_m = 1}, context);
  EXPECT_EQ(report.holes_filled, 1u);
  EXPECT_EQ(report.triangles, edges - 2);
  expect_valid_mesh(mesh);
  const MeshHealth health = health_of(mesh);
  EXPECT_EQ(health.boundary_edges, 0u);
  EXPECT_EQ(health.self_intersecting_pairs, 0u);
  EXPECT_EQ(mesh.positions_m, before.positions_m);
  for (std::size_t i = 0; i < mesh.triangle_count(); ++i)
    EXPECT_EQ(mesh.triangle_tag[i], i < before.triangle_count() ? TriangleTag::kMeasured : TriangleTag::kFilled);
}

TEST(FillHoles, HoleOfManyEdgesIsClosed) {
  Context context(2);
  Mesh mesh = sphere_with_hole(120, 0.9f);
  ASSERT_GT(health_of(mesh).boundary_edges, 300u);  // beyond what is solved as a whole
  const FillHolesReport report = fill_holes(mesh, {.largest_m = 3}, context);
  EXPECT_EQ(report.holes_filled, 1u);
  expect_valid_mesh(mesh);
  const MeshHealth health = health_of(mesh);
  EXPECT_EQ(health.boundary_edges, 0u);
  EXPECT_EQ(health.self_intersecting_pairs, 0u);
  // The missing cap is 2π(1 − √0.19) = 3.5; a flat lid over it is π·0.81 = 2.5.
  const double missing = 4 * std::numbers::pi - area_of(sphere_with_hole(120, 0.9f));
  EXPECT_LT(area_of(mesh), 4 * std::numbers::pi - missing + 3.6);
}

TEST(FillHoles, WiderHolesStay) {
  Context context(1);
  Mesh mesh = sphere_with_hole(24, 0.3f);
  const std::size_t triangles = mesh.triangle_count();
  const FillHolesReport report = fill_holes(mesh, {.largest_m = 0.5}, context);
  EXPECT_EQ(report.holes, 1u);
  EXPECT_EQ(report.holes_in_size, 0u);
  EXPECT_EQ(mesh.triangle_count(), triangles);
}

TEST(FillHoles, RimOfASheetIsNoHole) {
  Context context(1);
  Mesh mesh = cut_out(grid(12, 12, 0.1f, {0, 0, 0}),
                      [](const Eigen::Vector3f& p) { return std::hypot(p.x() - 0.6f, p.y() - 0.6f) > 0.25f; });
  const FillHolesReport report = fill_holes(mesh, {.largest_m = 100}, context);
  EXPECT_EQ(report.holes, 1u);
  EXPECT_EQ(report.holes_filled, 1u);
  const MeshHealth health = health_of(mesh);
  EXPECT_EQ(health.boundary_loops, 1u);
  EXPECT_NEAR(health.area_m2, 1.44, 1e-4);
}

TEST(FillHoles, HoleUnderAFoldIsAHole) {
  Context context(1);
  Mesh mesh = grid(8, 8, 0.1f, {0, 0, 0});
  // The neighbours of a missing triangle are turned back over it: their normals say "rim".
  const std::size_t missing = 2 * (4 * 8 + 4);
  const Triangle gone = mesh.triangles[missing];
  std::vector<std::uint8_t> keep(mesh.triangle_count(), 1);
  keep[missing] = 0;
  mesh = compact(mesh, keep);
  mesh.positions_m[gone[0]] += Eigen::Vector3f(0.17f, 0.12f, 0.02f);
  const FillHolesReport report = fill_holes(mesh, {.largest_m = 0.5}, context);
  EXPECT_EQ(report.holes, 1u);
}

TEST(FillHoles, WhatStandsInTheHoleIsNotRunThrough) {
  Context context(1);
  const Mesh plate = cut_out(grid(12, 12, 0.1f, {0, 0, 0}),
                             [](const Eigen::Vector3f& p) { return std::hypot(p.x() - 0.6f, p.y() - 0.6f) > 0.25f; });
  Mesh mesh = plate;
  // A pole through the middle of the hole; any lid would meet it.
  const auto first = std::uint32_t(mesh.vertex_count());
  for (const Eigen::Vector3f& p :
       {Eigen::Vector3f(0.5f, 0.61f, -1), Eigen::Vector3f(0.7f, 0.6f, -1), Eigen::Vector3f(0.6f, 0.62f, 1)})
    mesh.positions_m.push_back(p);
  mesh.triangles.push_back({first, first + 1, first + 2});
  const FillHolesReport report = fill_holes(mesh, {.largest_m = 0.9}, context);
  EXPECT_EQ(report.holes_filled, 0u);
  EXPECT_EQ(mesh.triangle_count(), plate.triangle_count() + 1);
  EXPECT_EQ(context.warnings().size(), 1u);
}

TEST(FillHoles, HolesThatTouchInAVertexAreTwo) {
  Context context(1);
  Mesh mesh = grid(8, 8, 0.1f, {0, 0, 0});
  // Two squares that have a corner in common: vertex (4, 4).
  std::vector<std::uint8_t> keep(mesh.triangle_count(), 1);
  for (const int square : {3 * 8 + 3, 4 * 8 + 4}) keep[std::size_t(2 * square)] = keep[std::size_t(2 * square + 1)] = 0;
  mesh = compact(mesh, keep);
  const FillHolesReport report = fill_holes(mesh, {.largest_m = 0.5}, context);
  EXPECT_EQ(report.holes_filled, 2u);
  const MeshHealth health = health_of(mesh);
  EXPECT_EQ(health.pinched_vertices, 0u);
  EXPECT_EQ(health.boundary_loops, 1u);
  EXPECT_EQ(health.self_intersecting_pairs, 0u);
}

TEST(FillHoles, ArraysKeepTheirLengths) {
  Context context(1);
  Mesh mesh = sphere_with_hole(12, 0.5f);
  mesh.triangle_view.assign(mesh.triangle_count(), 0);
  mesh.vertex_view.assign(mesh.vertex_count(), 0);
  mesh.texcoords.resize(mesh.triangle_count(), {Eigen::Vector2f(0, 0), Eigen::Vector2f(0, 0), Eigen::Vector2f(0, 0)});
  mesh.triangle_page.assign(mesh.triangle_count(), 0);
  fill_holes(mesh, {.largest_m = 2}, context);
  EXPECT_NO_THROW(check_mesh(mesh));
  EXPECT_EQ(mesh.triangle_page.back(), kInvalidIndex);
}

TEST(FillHoles, MisorientedInputIsRefused) {
  Context context(1);
  Mesh mesh = grid(3, 3, 1, {0, 0, 0});
  std::swap(mesh.triangles[4][0], mesh.triangles[4][1]);
  EXPECT_THROW(fill_holes(mesh, {.largest_m = 1}, context), InvalidInput);
}

}  // namespace
}  // namespace lapseam
