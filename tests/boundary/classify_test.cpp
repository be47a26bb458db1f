#include <gtest/gtest.h>

#include "lapseam/boundary.h"
#include "lapseam/context.h"
#include "support/analytic_views.h"
#include "support/patches.h"

namespace lapseam {
namespace {

using test::look_at;
using test::make_view;
using test::nearest;
using test::plane;
using test::rectangle;
using test::small_camera;

constexpr NoiseModel kNoise{0.002, 0, 0, 0.002};

View view_from(const Eigen::Vector3d& eye, const Eigen::Vector3d& target, const test::Shape& shape, unsigned seed = 1) {
  return make_view("v" + std::to_string(seed), small_camera(), look_at(eye, target), shape, kNoise.s0_m, seed);
}

Mesh mesh_of(const View& view) {
  Context context;
  return test::mesh_of_patch(test::make_patch(view, kNoise, context));
}

Eigen::Vector3d centroid(const Mesh& mesh, const Triangle& t) {
  return mesh.origin_m +
         ((mesh.positions_m[t[0]] + mesh.positions_m[t[1]] + mesh.positions_m[t[2]]) / 3).cast<double>();
}

/// Drops triangles whose centroid is in the box of x and y.
template <typename Predicate>
Mesh without(const Mesh& mesh, const Predicate& is_dropped) {
  std::vector<std::uint8_t> keep;
  for (const Triangle& t : mesh.triangles) keep.push_back(!is_dropped(centroid(mesh, t)));
  return compact(mesh, keep);
}

BoundaryReport classify(const Mesh& mesh, const std::vector<View>& views, int threads = 2) {
  Context context(threads);
  const MeasuredViews measured{views.size(), [&](std::size_t i) { return views[i]; },
                               [](std::size_t) { return kNoise; }};
  return classify_boundary(mesh, measured, {}, context);
}

/// Length of the pieces of a kind whose middle is where `is_there` says.
template <typename Predicate>
double length_where(const Mesh& mesh, const BoundaryReport& report, BoundaryKind kind, const Predicate& is_there) {
  double length = 0;
  for (const BoundaryPiece& piece : report.pieces) {
    const Eigen::Vector3d a = mesh.origin_m + mesh.positions_m[piece.a].cast<double>();
    const Eigen::Vector3d b = mesh.origin_m + mesh.positions_m[piece.b].cast<double>();
    if (piece.kind == kind && is_there(Eigen::Vector3d((a + b) / 2))) length += (a - b).norm();
  }
  return length;
}

const test::Shape kFloor = plane({0, 0, 0}, {0, 0, 1});
// A table top of 0.6 × 0.6 m, 0.5 m above a floor.
const test::Shape kTable = nearest({rectangle(0.5, -0.3, 0.3, -0.3, 0.3), kFloor});
bool is_on_table(const Eigen::Vector3d& p) { return p.z() > 0.4; }

TEST(Boundary, hole_punched_into_a_seen_plane_is_a_crack) {
  const View view = view_from({0, 0, 1.5}, {0, 0, 0}, kFloor);
  const auto is_in_hole = [](const Eigen::Vector3d& p) { return p.head<2>().norm() < 0.1; };
  const Mesh mesh = without(mesh_of(view), is_in_hole);
  const BoundaryReport report = classify(mesh, {view});
  EXPECT_EQ(report.figures.loops, 2u);
  EXPECT_EQ(report.figures.crack_loops, 1u);
  const auto is_near_hole = [](const Eigen::Vector3d& p) { return p.head<2>().norm() < 0.2; };
  const double hole = length_where(mesh, report, BoundaryKind::kCrack, is_near_hole);
  EXPECT_GT(hole, 0.99 * report.figures.crack_loop_length_m);
  EXPECT_DOUBLE_EQ(hole, report.figures.crack_length_m);  // nothing elsewhere
  EXPECT_GT(report.figures.unseen_length_m, 4);           // the frame of the image: 1.63 m a side
  EXPECT_EQ(report.figures.seen_end_length_m, 0);
}

TEST(Boundary, one_missing_triangle_is_a_crack) {
  const View view = view_from({0, 0, 1.5}, {0, 0, 0}, kFloor);
  Mesh mesh = mesh_of(view);
  std::vector<std::uint8_t> keep(mesh.triangle_count(), 1);
  keep[mesh.triangle_count() / 2] = 0;  // in the middle of the image
  mesh = compact(mesh, keep);
  EXPECT_EQ(classify(mesh, {view}).figures.crack_edges, 3u);
}

TEST(Boundary, natural_edge_of_a_table_is_an_end_and_its_shadow_unseen) {
  const std::vector<View> views = {view_from({0.3, 0.2, 1.6}, {0, 0, 0.3}, kTable, 1)};
  const Mesh mesh = mesh_of(views[0]);
  const BoundaryReport report = classify(mesh, views);
  EXPECT_EQ(report.figures.crack_edges, 0u);
  EXPECT_GT(length_where(mesh, report, BoundaryKind::kSeenEnd, is_on_table), 2.2);  // of 2.4 m and zigzags
  EXPECT_EQ(length_where(mesh, report, BoundaryKind::kUnseen, is_on_table), 0);
  EXPECT_EQ(
      length_where(mesh, report, BoundaryKind::kSeenEnd, [](const Eigen::Vector3d& p) { return !is_on_table(p); }), 0);
}

TEST(Boundary, table_stays_whole_when_other_views_look_at_it_aslant) {
  std::vector<View> views = {view_from({0, 0, 1.6}, {0, 0, 0.3}, kTable, 1)};
  unsigned seed = 2;
  for (const double x : {-1.0, 0.0, 1.0})
    for (const double y : {-1.0, 1.0}) views.push_back(view_from({x, y, 1.2}, {0, 0, 0.4}, kTable, seed++));
  const Mesh top = without(mesh_of(views[0]), [](const Eigen::Vector3d& p) { return !is_on_table(p); });
  const BoundaryReport report = classify(top, views);
  EXPECT_LT(report.figures.crack_share(), 0.02);  // noise turns single zigzags of an outline of 150 edges
  EXPECT_GT(report.figures.seen_end_length_m, 0.95 * report.figures.length_m);
  // The same table with a slit right through it.
  const Mesh slit = without(top, [](const Eigen::Vector3d& p) { return std::abs(p.x() - 0.05) < 0.01; });
  const BoundaryReport cracked = classify(slit, views);
  const auto is_at_slit = [](const Eigen::Vector3d& p) {
    return std::abs(p.x() - 0.05) < 0.04 && std::abs(p.y()) < 0.27;
  };
  const double crack = length_where(slit, cracked, BoundaryKind::kCrack, is_at_slit);
  EXPECT_GT(crack, 2 * 0.54);  // two sides, which zigzag
  EXPECT_LT(length_where(slit, cracked, BoundaryKind::kSeenEnd, is_at_slit), 0.02 * crack);
  EXPECT_LT(length_where(slit, cracked, BoundaryKind::kUnseen, is_at_slit), 0.02 * crack);
  EXPECT_LT(cracked.figures.crack_length_m - crack, 0.15);  // its two ends, and what was there before
}

TEST(Boundary, hole_in_the_image_is_no_crack_until_another_view_sees_it) {
  View view = view_from({0, 0, 1.5}, {0, 0, 0}, kFloor);
  for (int v = 50; v < 60; ++v)
    for (int u = 50; u < 60; ++u) view.range.at(u, v) = kInvalidRange;
  const Mesh mesh = mesh_of(view);
  EXPECT_EQ(classify(mesh, {view}).figures.crack_edges, 0u);
  const View other = view_from({0.3, 0.1, 1.4}, {0, 0, 0}, kFloor, 2);
  const BoundaryReport report = classify(mesh, {view, other});
  const auto is_middle = [](const Eigen::Vector3d& p) { return p.head<2>().norm() < 0.3; };
  EXPECT_GT(length_where(mesh, report, BoundaryKind::kCrack, is_middle), 0.4);
  EXPECT_EQ(length_where(mesh, report, BoundaryKind::kUnseen, is_middle), 0);
}

TEST(Boundary, mesh_that_ends_at_one_frame_though_another_view_saw_on_is_cracked) {
  const View near = view_from({0, 0, 0.8}, {0, 0, 0}, kFloor, 1), wide = view_from({0, 0, 2.4}, {0, 0, 0}, kFloor, 2);
  const BoundaryReport report = classify(mesh_of(near), {near, wide});
  EXPECT_GT(report.figures.crack_share(), 0.99);
}

TEST(Boundary, far_view_that_cannot_resolve_a_step_does_not_outvote_a_near_one) {
  // A slab of 5 cm: its edge is a step for the near view; neighbouring samples of the far one lie 3.6 cm apart.
  const test::Shape slab = nearest({rectangle(0.05, -0.1, 0.1, -0.1, 0.1), kFloor});
  const View near = view_from({0, 0, 0.5}, {0, 0, 0}, slab, 1), far = view_from({0, 0, 4.0}, {0, 0, 0}, slab, 2);
  const Mesh top = without(mesh_of(near), [](const Eigen::Vector3d& p) { return p.z() < 0.025; });
  ASSERT_GT(top.triangle_count(), 1000u);
  EXPECT_LT(classify(top, {near, far}).figures.crack_share(), 0.01);
  EXPECT_GT(classify(top, {far}).figures.crack_share(), 0.5);  // alone it knows no better
}

TEST(Boundary, wall_that_stops_short_of_the_floor_is_cracked_there) {
  const test::Shape corner = nearest({kFloor, plane({0, 0.5, 0}, {0, -1, 0})});
  const View view = view_from({0, -1, 0.8}, {0, 0.5, 0.1}, corner);
  const Mesh wall = without(mesh_of(view), [](const Eigen::Vector3d& p) { return p.z() < 0.01 || p.y() < 0.48; });
  const BoundaryReport report = classify(wall, {view});
  const double foot =
      length_where(wall, report, BoundaryKind::kCrack, [](const Eigen::Vector3d& p) { return p.z() < 0.08; });
  EXPECT_GT(foot, 1.2);  // the image is 1.5 m wide there
  EXPECT_DOUBLE_EQ(foot, report.figures.crack_length_m);
}

TEST(Boundary, same_for_any_number_of_threads) {
  allow_threads(8);
  const View view = view_from({0.3, 0.2, 1.6}, {0, 0, 0.3}, kTable);
  const Mesh mesh = without(mesh_of(view), [](const Eigen::Vector3d& p) { return p.head<2>().norm() < 0.1; });
  const std::string expected = to_json(classify(mesh, {view}, 1).figures);
  for (const int threads : {2, 3, 8}) EXPECT_EQ(to_json(classify(mesh, {view}, threads).figures), expected);
}

TEST(Boundary, closed_mesh_and_empty_mesh_have_none) {
  EXPECT_EQ(classify({}, {}).figures.edges, 0u);
  EXPECT_EQ(classify({}, {}).figures.crack_share(), 0);
}

}  // namespace
}  // namespace lapseam
