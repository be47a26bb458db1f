// What measured views say of a mesh, and cracks by the truth.

#include "lapseam/evaluate_views.h"

#include <gtest/gtest.h>

#include "evaluate/surfaces.h"
#include "lapseam/context.h"
#include "lapseam/error.h"
#include "lapseam/evaluate.h"

namespace lapseam {
namespace {

using test::append;
using test::flip;
using test::move;
using test::sheet;
using test::view_down_on_floor;

// The floor is 4 × 4 m; the view covers 1 × 0.75 m of it: 100 × 75 pixels of 1 cm, from 2 m.
const View kView = view_down_on_floor(2, 2, 2, 100, 75, 200);
const Mesh kFloor = sheet(4, 4, 40, 40, 0);

ViewEvaluation evaluate_against(const Mesh& result, const std::vector<View>& views,
                                const ViewEvaluationOptions& options = {}, int threads = 2) {
  Context context(threads);
  const MeasuredViews measured{views.size(), [&](std::size_t i) { return views[i]; },
                               [](std::size_t) {
                                 return NoiseModel{0.001, 0, 0, 0.001};
                               }};
  return evaluate_views(result, measured, measured, options, context);
}

Mesh lifted(float z_m) { return sheet(4, 4, 40, 40, z_m); }

/// A floor without its cells from (1.9, 1.9) to (2.1, 2.1): 0.04 m² of which the view sees all.
Mesh floor_with_hole() {
  Mesh mesh = kFloor;
  std::vector<std::uint8_t> keep;
  for (const Triangle& t : mesh.triangles) {
    const Eigen::Vector3f c = (mesh.positions_m[t[0]] + mesh.positions_m[t[1]] + mesh.positions_m[t[2]]) / 3;
    keep.push_back(!(std::abs(c.x() - 2) < 0.1f && std::abs(c.y() - 2) < 0.1f));
  }
  return compact(mesh, keep);
}

TEST(EvaluateViews, range_off_is_what_the_mesh_is_moved_by) {
  const RangeFigures ranges = evaluate_against(lifted(0.015f), {kView}).ranges;
  EXPECT_EQ(ranges.rays, 7500u);
  EXPECT_EQ(ranges.hits, 7500u);
  EXPECT_NEAR(ranges.median_m, -0.015, 1e-6);  // nearer than measured, in z and not along the slanted rays
  EXPECT_NEAR(ranges.median_absolute_m, 0.015, 1e-6);
  EXPECT_NEAR(ranges.p90_absolute_m, 0.015, 1e-6);
  EXPECT_EQ(ranges.within, 7500u);
  EXPECT_EQ(ranges.within_scaled, 7500u);  // two spacings of 1 cm
  EXPECT_EQ(ranges.double_layers, 0u);
}

TEST(EvaluateViews, thresholds_tell_near_from_far) {
  const RangeFigures in_front = evaluate_against(lifted(0.03f), {kView}).ranges;
  EXPECT_EQ(in_front.within, 0u);
  EXPECT_EQ(in_front.floating, 7500u);
  const RangeFigures behind = evaluate_against(lifted(-0.015f), {kView}, {.within_spacings = 1}).ranges;
  EXPECT_EQ(behind.within, 7500u);
  EXPECT_EQ(behind.within_scaled, 0u);
  EXPECT_EQ(evaluate_against(lifted(-0.03f), {kView}).ranges.behind, 7500u);
}

TEST(EvaluateViews, rays_through_a_hole_miss) {
  const RangeFigures ranges = evaluate_against(floor_with_hole(), {kView}).ranges;
  EXPECT_NEAR(double(ranges.misses()), 400, 40);  // 20 × 20 pixels, whose border rays may go either way
}

TEST(EvaluateViews, second_sheet_is_a_double_layer_only_when_near_and_facing) {
  Mesh two = kFloor;
  append(two, lifted(-0.02f));
  EXPECT_EQ(evaluate_against(two, {kView}).ranges.double_layers, 7500u);
  Mesh apart = kFloor;
  append(apart, lifted(-0.05f));
  EXPECT_EQ(evaluate_against(apart, {kView}).ranges.double_layers, 0u);
  Mesh back = lifted(-0.02f);  // a slab of 2 cm: the second surface is its underside
  flip(back);
  append(back, kFloor);
  EXPECT_EQ(evaluate_against(back, {kView}).ranges.double_layers, 0u);
  Mesh half = sheet(2, 4, 20, 40, -0.02f);  // below the left half of the floor only
  append(half, kFloor);
  EXPECT_NEAR(double(evaluate_against(half, {kView}).ranges.double_layers), 3750, 1);
}

TEST(EvaluateViews, figures_of_all_views_are_the_sum_of_each) {
  const ViewEvaluation e = evaluate_against(lifted(0.01f), {kView, view_down_on_floor(1, 1, 1, 40, 30, 100)});
  ASSERT_EQ(e.ranges_by_view.size(), 2u);
  EXPECT_EQ(e.ranges.rays, 7500u + 1200u);
  EXPECT_EQ(e.ranges_by_view[1].rays, 1200u);
  EXPECT_EQ(e.ranges_by_view[0].view, "down");
  EXPECT_NEAR(e.ranges.median_m, -0.01, 1e-6);
}

TEST(EvaluateViews, same_for_any_number_of_threads) {
  allow_threads(8);
  const std::string expected = to_json(evaluate_against(floor_with_hole(), {kView}, {.rays_per_view = 3000}, 1));
  for (const int threads : {2, 3, 8})
    EXPECT_EQ(to_json(evaluate_against(floor_with_hole(), {kView}, {.rays_per_view = 3000}, threads)), expected);
}

TEST(EvaluateViews, empty_mesh_is_missed_by_every_ray) {
  const ViewEvaluation e = evaluate_against({}, {kView});
  EXPECT_EQ(e.ranges.misses(), 7500u);
  EXPECT_NE(to_json(e).find("\"median_absolute_mm\":null"), std::string::npos);
}

TEST(EvaluateViews, senseless_options_are_refused) {
  EXPECT_THROW(evaluate_against(kFloor, {kView}, {.within_m = 0}), InvalidInput);
  EXPECT_THROW(evaluate_against(kFloor, {kView}, {.double_layer_m = -1}), InvalidInput);
}

BoundaryFigures boundary_by_truth(const Mesh& result, const Mesh& truth, const std::vector<View>& views) {
  Context context;
  return evaluate(result, truth, truth_views(views), {.samples = 1000}, context).boundary;
}

TEST(TruthBoundary, hole_in_the_floor_is_a_crack_where_a_view_saw_it) {
  const BoundaryFigures seen = boundary_by_truth(floor_with_hole(), kFloor, {kView});
  EXPECT_EQ(seen.loops, 2u);
  EXPECT_EQ(seen.crack_loops, 1u);
  EXPECT_NEAR(seen.crack_length_m, 0.8, 1e-4);
  EXPECT_NEAR(seen.seen_end_length_m, 16, 1e-3);  // the floor's own edge
  const BoundaryFigures unseen =
      boundary_by_truth(floor_with_hole(), kFloor, {view_down_on_floor(1, 1, 1, 40, 30, 100)});
  EXPECT_EQ(unseen.crack_edges, 0u);
  EXPECT_NEAR(unseen.unseen_length_m, 0.8, 1e-4);
}

TEST(TruthBoundary, part_of_a_floor_is_cracked_all_round) {
  Mesh part = sheet(0.4f, 0.3f, 4, 3, 0);
  move(part, {1.8f, 1.8f, 0});
  const BoundaryFigures figures = boundary_by_truth(part, kFloor, {kView});
  EXPECT_NEAR(figures.crack_length_m, 1.4, 1e-4);
  EXPECT_EQ(figures.crack_share(), 1);
}

TEST(TruthBoundary, noise_of_the_result_does_not_hide_a_crack) {
  Mesh result = floor_with_hole();
  for (std::size_t i = 0; i < result.vertex_count(); ++i) result.positions_m[i].z() = i % 3 == 0 ? 0.008f : -0.006f;
  EXPECT_NEAR(boundary_by_truth(result, kFloor, {kView}).crack_length_m, 0.8, 0.01);
}

TEST(TruthBoundary, edge_of_a_step_is_an_end) {
  // A block of 20 × 20 × 10 cm on the floor, seen from above; the result is its top alone.
  Mesh truth = kFloor, top = sheet(0.2f, 0.2f, 10, 10, 0.1f);
  move(top, {1.9f, 1.9f, 0});
  append(truth, top);
  const BoundaryFigures of_top = boundary_by_truth(top, truth, {kView});
  EXPECT_EQ(of_top.crack_edges, 0u);
  EXPECT_NEAR(of_top.seen_end_length_m, 0.8, 1e-4);
}

}  // namespace
}  // namespace lapseam
