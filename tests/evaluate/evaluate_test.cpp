#include "lapseam/evaluate.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "evaluate/surfaces.h"
#include "lapseam/context.h"
#include "lapseam/error.h"

namespace lapseam {
namespace {

using test::append;
using test::flip;
using test::sheet;
using test::sphere;
using test::view_down_on_floor;

constexpr double kDegrees = std::numbers::pi / 180;

Evaluation evaluate_meshes(const Mesh& result, const Mesh& truth, const std::vector<View>& views = {},
                           EvaluateOptions options = {}) {
  Context context;
  options.samples = std::min<std::size_t>(options.samples, 100'000);
  return evaluate(result, truth, truth_views(views), options, context);
}

TEST(Evaluate, surface_against_itself_is_perfect) {
  const Mesh mesh = sphere(0.5, 40, 80);
  const Evaluation e = evaluate_meshes(mesh, mesh);
  ASSERT_TRUE(e.accuracy);
  EXPECT_LT(e.accuracy->p99_m, 1e-6);
  // float dot products of unit vectors are good to some 3e-4 rad near 1
  EXPECT_LT(e.accuracy->normal_deviation_p90_rad, 1e-3);
  EXPECT_LT(e.completeness.p90_m, 1e-6);
  for (const DistanceFigures& d : e.distances) EXPECT_DOUBLE_EQ(d.f_score, 1);
  EXPECT_FALSE(e.has_views);
  EXPECT_FALSE(e.is_orientation_flipped);
}

TEST(Evaluate, shifted_plane_shows_the_shift_and_its_sign) {
  const Mesh truth = sheet(2, 2, 8, 8, 0);
  for (const float shift_m : {0.003f, -0.003f}) {
    Mesh result = sheet(1, 1, 5, 5, shift_m);
    test::move(result, {0.5f, 0.5f, 0});
    const Evaluation e = evaluate_meshes(result, truth);
    ASSERT_TRUE(e.accuracy);
    EXPECT_NEAR(e.accuracy->median_m, 0.003, 1e-7);
    EXPECT_NEAR(e.accuracy->rms_m, 0.003, 1e-7);
    EXPECT_NEAR(e.accuracy->p99_m, 0.003, 1e-7);
    EXPECT_NEAR(e.accuracy->bias_median_m, double(shift_m), 1e-7);
    EXPECT_NEAR(e.accuracy->normal_deviation_median_rad, 0, 1e-3);
    EXPECT_EQ(e.distances[1].precision, 0) << "2 mm";
    EXPECT_EQ(e.distances[2].precision, 1) << "5 mm";
  }
}

TEST(Evaluate, slanted_plane_has_the_slant_as_normal_deviation) {
  const Mesh truth = sheet(4, 4, 2, 2, 0);
  Mesh result = sheet(1, 1, 4, 4, 0);
  const double slant = 7 * kDegrees;
  for (Eigen::Vector3f& p : result.positions_m) p.z() = float(std::tan(slant)) * p.x();
  const Evaluation e = evaluate_meshes(result, truth);
  ASSERT_TRUE(e.accuracy);
  EXPECT_NEAR(e.accuracy->normal_deviation_median_rad, slant, 1e-5);
  EXPECT_NEAR(e.accuracy->median_m, std::tan(slant) / 2, 1e-5);
  // Heights are even between 0 and tan. Of 100,000 samples, those of the column of cells that holds a quantile are
  // random: it is known to about 8e-4 of the height; four times that.
  EXPECT_NEAR(e.accuracy->p90_m, 0.9 * std::tan(slant), 3e-3 * std::tan(slant));
  EXPECT_NEAR(e.accuracy->rms_m, std::tan(slant) / std::sqrt(3.0), 3e-3 * std::tan(slant));
}

TEST(Evaluate, coarse_sphere_has_its_chord_error) {
  // A chord of the angle 2a lies up to r (1 − cos a) inside, two thirds of that on the mean along a great circle.
  const double radius_m = 1, step = std::numbers::pi / 24;
  const Mesh coarse = sphere(radius_m, 24, 48), fine = sphere(radius_m, 480, 960);
  const Evaluation e = evaluate_meshes(coarse, fine);
  ASSERT_TRUE(e.accuracy);
  const double sagitta = radius_m * (1 - std::cos(step / 2));
  // Cells are `step` wide in both directions at the equator: sagittas of both add up in the middle.
  EXPECT_GT(e.accuracy->p99_m, sagitta);
  EXPECT_LT(e.accuracy->p99_m, 2 * sagitta);
  EXPECT_LT(e.accuracy->bias_median_m, -0.5 * sagitta) << "chords lie inside";
  // Triangle centroids at the equator: mean deviation of a cell is (1 + 1) · 2/3 sagitta, cells shrink to the poles.
  EXPECT_NEAR(e.accuracy->median_m, sagitta, 0.25 * sagitta);
  EXPECT_LT(e.accuracy->normal_deviation_p90_rad, step);
}

TEST(Evaluate, hole_takes_its_share_of_completeness_and_no_accuracy) {
  const Mesh truth = sheet(1, 1, 10, 10, 0);
  std::vector<std::uint8_t> keep(truth.triangle_count(), 1);
  for (const std::size_t column : {3u, 4u, 5u})
    for (const std::size_t row : {3u, 4u, 5u}) keep[2 * (row * 10 + column)] = keep[2 * (row * 10 + column) + 1] = 0;
  const Evaluation e = evaluate_meshes(compact(truth, keep), truth);
  ASSERT_TRUE(e.accuracy);
  EXPECT_LT(e.accuracy->p99_m, 1e-6);
  for (const DistanceFigures& d : e.distances) {
    EXPECT_EQ(d.precision, 1);
    // The truth within `at` of the rim still counts as covered. 100,000 stratified samples: the share is good to 1e-3.
    const double hole = std::pow(0.3 - 2 * d.at_m, 2);
    EXPECT_NEAR(d.completeness, 1 - hole, 1e-3);
    EXPECT_NEAR(d.f_score, 2 * d.completeness / (1 + d.completeness), 1e-12);
  }
  EXPECT_EQ(e.health.boundary_loops, 2u);
  EXPECT_NEAR(e.health.boundary_length_m, 4 + 1.2, 1e-5);
}

TEST(Evaluate, clutter_takes_precision_and_no_completeness) {
  const Mesh truth = sheet(1, 1, 10, 10, 0);
  Mesh result = truth;
  append(result, sheet(0.5f, 0.5f, 3, 3, 0.1f));  // a quarter of the area, 10 cm off
  const Evaluation e = evaluate_meshes(result, truth);
  ASSERT_TRUE(e.accuracy);
  EXPECT_NEAR(e.accuracy->beyond_gross_share, 0.2, 1e-4);
  EXPECT_NEAR(e.accuracy->p90_m, 0.1, 1e-6);
  EXPECT_NEAR(e.accuracy->rms_m, 0.1 * std::sqrt(0.2), 1e-5);
  EXPECT_LT(e.accuracy->rms_within_gross_m, 1e-6);
  EXPECT_NEAR(e.distances[0].precision, 0.8, 1e-4);
  EXPECT_EQ(e.distances[0].completeness, 1);
  EXPECT_EQ(e.health.components, 2u);
}

TEST(Evaluate, result_inside_out_is_reported_and_measured_turned) {
  const Mesh truth = sphere(0.5, 40, 80);
  Mesh result = truth;
  flip(result);
  const Evaluation e = evaluate_meshes(result, truth);
  EXPECT_TRUE(e.is_orientation_flipped);
  ASSERT_TRUE(e.accuracy);
  EXPECT_LT(e.accuracy->normal_deviation_p90_rad, 1e-3);
  EXPECT_NE(to_text(e).find("inside out"), std::string::npos);
}

TEST(Evaluate, meshes_with_different_origins_meet_in_the_world) {
  Mesh truth = sheet(2, 2, 8, 8, 0);
  Mesh result = sheet(1, 1, 5, 5, 0.25f);
  truth.origin_m = {4'000'000, 500'000, 100};
  result.origin_m = {4'000'000.5, 500'000.5, 99.752};
  View view = view_down_on_floor(1, 1, 2, 50, 50, 100);
  view.T_world_view.translation() += truth.origin_m;
  const Evaluation e = evaluate_meshes(result, truth, {view});
  ASSERT_TRUE(e.accuracy);
  EXPECT_NEAR(e.accuracy->median_m, 0.002, 1e-6);
  EXPECT_EQ(e.rays.close, e.rays.rays);
}

TEST(Evaluate, empty_result_covers_nothing_and_does_not_fail) {
  const Mesh truth = sheet(1, 1, 10, 10, 0);
  for (Mesh result : {Mesh{}, sheet(0, 1, 2, 2, 0)}) {  // nothing, or nothing with an area
    const Evaluation e = evaluate_meshes(result, truth, {view_down_on_floor(0.5, 0.5, 1, 20, 20, 40)});
    EXPECT_FALSE(e.accuracy);
    EXPECT_EQ(e.distances[3].precision, 0);
    EXPECT_EQ(e.distances[3].completeness, 0);
    EXPECT_EQ(e.distances[3].f_score, 0);
    EXPECT_TRUE(std::isinf(e.completeness.median_m));
    EXPECT_EQ(e.rays.close, 0u);
    const auto json = nlohmann::json::parse(to_json(e));
    EXPECT_TRUE(json["accuracy"].is_null());
    EXPECT_TRUE(json["completeness"]["median_mm"].is_null());
    EXPECT_NE(to_text(e).find("no area"), std::string::npos);
  }
}

TEST(Evaluate, truth_without_area_and_bad_options_are_refused) {
  const Mesh mesh = sheet(1, 1, 2, 2, 0);
  EXPECT_THROW(evaluate_meshes(mesh, Mesh{}), InvalidInput);
  EXPECT_THROW(evaluate_meshes(mesh, sheet(1, 0, 2, 2, 0)), InvalidInput);
  EXPECT_THROW(evaluate_meshes(mesh, mesh, {}, {.at_m = {0.001, -1}}), InvalidInput);
  EXPECT_THROW(evaluate_meshes(mesh, mesh, {}, {.samples = 0}), InvalidInput);
  EXPECT_THROW(evaluate_meshes(mesh, mesh, {}, {.gross_m = std::nan("")}), InvalidInput);
  EXPECT_THROW(evaluate_meshes(mesh, mesh, {}, {.grazing_cosine = 1}), InvalidInput);
}

TEST(Evaluate, seed_changes_the_samples_and_threads_do_not) {
  const Mesh truth = sphere(0.5, 60, 90);
  Mesh result = sphere(0.5, 17, 23);
  append(result, sheet(0.4f, 0.4f, 9, 9, 0.6f));
  View view = view_down_on_floor(0, 0, 2, 160, 120, 150);
  for (int v = 0; v < 120; ++v) {
    for (int u = 0; u < 160; ++u) {  // the truth of this image matters little here: any numbers do
      view.range.at(u, v) = 1.5f + 0.002f * float(u) + (v % 7 == 0 ? 0.1f : 0.f);
    }
  }
  const EvaluateOptions options{.samples = 20'000, .rays_per_view = 5'000};
  std::string expected;
  allow_threads(8);  // or threads beyond the processors would not be made
  for (const int threads : {1, 2, 3, 8}) {
    Context context(threads);
    const std::string json = to_json(evaluate(result, truth, truth_views({&view, 1}), options, context));
    if (expected.empty()) expected = json;
    EXPECT_EQ(json, expected) << threads;
  }
  Context context;
  EvaluateOptions other = options;
  other.seed = 1;
  const Evaluation a = evaluate(result, truth, truth_views({&view, 1}), options, context);
  const Evaluation b = evaluate(result, truth, truth_views({&view, 1}), other, context);
  EXPECT_NE(a.accuracy->median_m, b.accuracy->median_m);
  EXPECT_NEAR(a.accuracy->median_m, b.accuracy->median_m, 0.05 * a.accuracy->median_m);
}

// The floor is cut in two by a gap of ten times or half of what counts (2 cm).
TEST(Evaluate, pieces_that_views_saw_are_counted_and_narrow_gaps_are_none) {
  for (const auto& [gap_m, pieces] : {std::pair{0.2f, 2u}, {0.01f, 1u}}) {
    Mesh truth = sheet(0.4f, 1, 10, 10, 0);
    Mesh other = sheet(0.4f, 1, 10, 10, 0);
    for (Eigen::Vector3f& p : other.positions_m) p.x() += 0.4f + gap_m;
    append(truth, other);
    View view = view_down_on_floor(0.5, 0.5, 1, 400, 300, 400);
    for (int v = 0; v < 300; ++v)
      for (int u = 0; u < 400; ++u) {
        float& r = view.range.at(u, v);
        const double x = (view.T_world_view * unproject(view.sensor, u, v, double(r))).x();
        if (x > 0.4 && x < 0.4 + double(gap_m)) r = kInvalidRange;
      }
    const Evaluation e = evaluate_meshes(truth, truth, {view});
    EXPECT_EQ(e.completeness.seen_pieces, pieces) << gap_m;
    EXPECT_EQ(nlohmann::json::parse(to_json(e))["completeness"]["seen_pieces"], pieces);
  }
  EXPECT_EQ(evaluate_meshes(sheet(1, 1, 4, 4, 0), sheet(1, 1, 4, 4, 0)).completeness.seen_pieces, 0u);
}

TEST(Evaluate, reports_hold_every_figure) {
  const Mesh truth = sheet(1, 1, 10, 10, 0);
  const std::vector<View> views = {view_down_on_floor(0.5, 0.5, 1, 40, 30, 40)};
  const Evaluation e = evaluate_meshes(sheet(1, 1, 4, 4, 0.001f), truth, views, {.at_m = {0.0005, 0.025}});
  const auto json = nlohmann::json::parse(to_json(e));
  EXPECT_NEAR(json["accuracy"]["median_mm"].get<double>(), 1, 1e-4);
  EXPECT_EQ(json["distances"].size(), 2u);
  EXPECT_DOUBLE_EQ(json["distances"][1]["at_mm"].get<double>(), 25);
  EXPECT_DOUBLE_EQ(json["distances"][0]["precision_percent"].get<double>(), 0);
  EXPECT_DOUBLE_EQ(json["distances"][1]["f_score_percent"].get<double>(), 100);
  EXPECT_DOUBLE_EQ(json["rays"]["close_percent"].get<double>(), 100);
  EXPECT_EQ(json["rays_by_view"][0]["view"], "down");
  EXPECT_EQ(json["mesh"]["triangles"], 32);
  const std::string text = to_text(e);
  for (const char* part : {"25 mm", "1.000 mm", "F-score", "double layer", "boundary length", "self-intersecting"})
    EXPECT_NE(text.find(part), std::string::npos) << part;
  const std::string without_views = to_text(evaluate_meshes(truth, truth));
  EXPECT_NE(without_views.find("left out, no views given"), std::string::npos);
}

}  // namespace
}  // namespace lapseam
