#include <gtest/gtest.h>

#include <cmath>

#include "lapseam/context.h"
#include "lapseam/evaluate_novel.h"
#include "lapseam/texture.h"
#include "support/painted_views.h"

namespace lapseam {
namespace {

// A wall of soft colours, seen by five cameras side by side that overlap by half.
struct Wall {
  Mesh mesh;
  std::vector<ViewSource> sources;
};

const Eigen::Vector3d kGains[5] = {{0.75, 0.8, 0.7}, {1.15, 1.1, 1.2}, {1, 1, 1}, {1.3, 1.25, 1.2}, {0.85, 0.9, 1}};

Eigen::Vector3d soft_paint(const Eigen::Vector3d& p) {
  return Eigen::Vector3d(110 + 30 * std::sin(3 * p.x()) + 15 * std::sin(9 * p.y()),
                         100 + 35 * std::sin(2 * p.x() + 4 * p.y()), 105 + 30 * std::cos(5 * p.y() - p.x()));
}

Wall make_wall(double vignetting) {
  Wall wall;
  test::append_patch(wall.mesh, {-2, -0.5, 1.5}, {0, 1, 0}, {4, 0, 0}, 60);
  for (int i = 0; i < 5; ++i) {
    Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
    T.translation() = Eigen::Vector3d(0.6 * (i - 2), 0.05 * (i % 2), 0);
    wall.sources.push_back(test::painted_source("view" + std::to_string(i), test::small_camera(160, 130), T,
                                                test::plane({0, 0, 1.5}, {0, 0, -1}), soft_paint,
                                                {kGains[i], vignetting}));
  }
  return wall;
}

// Root mean square of the difference between the texture and the paint, after one factor a channel.
double distance_to_paint(const Mesh& mesh) {
  Eigen::Vector3d products = Eigen::Vector3d::Zero(), squares = Eigen::Vector3d::Zero();
  std::vector<std::pair<Eigen::Vector3d, Eigen::Vector3d>> pairs;
  for (std::size_t v = 0; v < mesh.vertex_count(); ++v) {
    const Eigen::Vector3d p = mesh.positions_m[v].cast<double>();
    if (std::abs(p.x()) > 1.2) continue;
    const Rgb8 c = mesh.colors[v];
    pairs.emplace_back(Eigen::Vector3d(c.r, c.g, c.b), soft_paint(p));
    products += pairs.back().first.cwiseProduct(pairs.back().second);
    squares += pairs.back().first.cwiseProduct(pairs.back().first);
  }
  double sum = 0;
  for (const auto& [found, paint] : pairs)
    sum += (found.cwiseProduct(products.cwiseQuotient(squares)) - paint).squaredNorm() / 3;
  return std::sqrt(sum / double(pairs.size()));
}

double textured_distance(Wall wall, const TextureOptions& options, TextureReport* report = nullptr) {
  Context context(2);
  const TextureReport found = texture(wall.mesh, wall.sources, options, context);
  if (report) *report = found;
  color_vertices(wall.mesh, context);
  return distance_to_paint(wall.mesh);
}

TEST(Equalize, GainsOfTheViewsAreFound) {
  TextureReport report;
  const Wall wall = make_wall(0);
  EXPECT_GT(textured_distance(wall, {.equalize = false, .level = false}), 10);
  // Rounding of the images and of the result leaves half a level each.
  EXPECT_LT(textured_distance(wall, {.level = false}, &report), 1.0);
  // The middle view in brightness is the third, with a gain of one; the darkest and brightest turn into it.
  EXPECT_NEAR(report.highest_gain, 1 / std::cbrt(0.75 * 0.8 * 0.7), 0.02);
  EXPECT_NEAR(report.lowest_gain, 1 / std::cbrt(1.3 * 1.25 * 1.2), 0.02);
  EXPECT_LT(report.color_residual_after, 0.1 * report.color_residual_before);
}

TEST(Equalize, VignettingIsFound) {
  const Wall wall = make_wall(0.35);
  EXPECT_LT(textured_distance(wall, {.level = false}), 2.0);
}

TEST(Equalize, AHighlightInOneViewCountsLittle) {
  Wall wall = make_wall(0);
  ColorImage image = *wall.sources[1].color->memory;
  for (int v = 30; v < 80; ++v)
    for (int u = 40; u < 90; ++u) image.at(u, v) = {240, 240, 240};
  wall.sources[1].color->memory = std::make_shared<ColorImage>(std::move(image));
  TextureReport report;
  textured_distance(wall, {.level = false}, &report);
  EXPECT_NEAR(report.highest_gain, 1 / std::cbrt(0.75 * 0.8 * 0.7), 0.03);
  EXPECT_NEAR(report.lowest_gain, 1 / std::cbrt(1.3 * 1.25 * 1.2), 0.03);
}

TEST(Level, StepsAtBordersVanishEvenWhereExposuresDiffer) {
  Context context(2);
  Wall plain = make_wall(0), levelled = make_wall(0);
  const TextureReport as_is = texture(plain.mesh, plain.sources, {.equalize = false, .level = false}, context);
  const TextureReport report = texture(levelled.mesh, levelled.sources, {.equalize = false}, context);
  const ColorStepFigures before = measure_color_steps(plain.mesh, context);
  const ColorStepFigures after = measure_color_steps(levelled.mesh, context);
  ASSERT_GT(before.samples, 100u);
  EXPECT_EQ(after.samples, before.samples);
  EXPECT_LT(after.median, 0.7);  // two roundings to whole levels
  // Most borders of charts go through an image; steps are where they meet borders of images.
  EXPECT_GT(before.p95, 10);
  EXPECT_LT(after.p95, before.p95 / 2);
  EXPECT_GT(report.inner_step_before, 10);
  EXPECT_LT(report.inner_step_after, 0.7);
  EXPECT_LT(report.inner_step_after_p95, 2);
  EXPECT_GT(report.step_before, 10);
  EXPECT_LT(report.step_after_p95, 2);
  EXPECT_EQ(as_is.step_before, report.step_before);
  EXPECT_EQ(as_is.step_after, as_is.step_before);
  EXPECT_EQ(as_is.inner_step_after_p95, report.inner_step_before_p95);
}

// Two cameras side by side show one wall: it is laid out as one of them has it, so that the border between their images
// has no padding, and shows no step either.
TEST(Level, ImagesWithinAChartMeetWithoutAStep) {
  Wall wall = make_wall(0);
  wall.mesh = {};
  test::append_patch(wall.mesh, {-1.4, -0.5, 1.5}, {0, 1, 0}, {2.2, 0, 0}, 40);
  wall.sources = {wall.sources[1], wall.sources[2]};
  const Wall equalized = wall;
  Context context(2);
  const TextureReport report = texture(wall.mesh, wall.sources, {.equalize = false}, context);
  EXPECT_EQ(report.charts, 1u);
  EXPECT_GT(report.inner_step_before, 10);
  EXPECT_LT(report.inner_step_after, 0.7);  // two roundings to whole levels
  EXPECT_LT(report.inner_step_after_p95, 2);
  EXPECT_EQ(report.step_before, report.inner_step_before);  // there are no others
  EXPECT_EQ(report.step_after_p95, report.inner_step_after_p95);
  EXPECT_EQ(measure_color_steps(wall.mesh, context).samples, 0u);
  // Both images are there, at their places: what the paint changes by in a pixel and a half is more.
  EXPECT_LT(textured_distance(equalized, {}), 1);
}

}  // namespace
}  // namespace lapseam
