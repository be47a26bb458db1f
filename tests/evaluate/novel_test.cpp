#include "lapseam/evaluate_novel.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "evaluate/image_difference.h"
#include "lapseam/context.h"
#include "lapseam/error.h"
#include "support/painted_views.h"

namespace lapseam {
namespace {

ColorImage ramp(int width, int height) {
  ColorImage image(width, height);
  for (int v = 0; v < height; ++v)
    for (int u = 0; u < width; ++u) image.at(u, v) = {std::uint8_t(40 + u), std::uint8_t(60 + v), 100};
  return image;
}

TEST(ImageDifference, OfEqualImagesIsNone) {
  const ColorImage image = ramp(40, 30);
  const ImageDifference found = compare_images(image, image, Image<std::uint8_t>(40, 30, 1));
  EXPECT_EQ(found.pixels, 1200u);
  EXPECT_DOUBLE_EQ(found.gain, 1);
  EXPECT_EQ(found.psnr_db, std::numeric_limits<double>::infinity());
  EXPECT_NEAR(found.ssim, 1, 1e-12);
}

TEST(ImageDifference, OneGainIsForgiven) {
  const ColorImage image = ramp(40, 30);
  ColorImage half = image;
  for (Rgb8& c : half.pixels) c = {std::uint8_t(c.r / 2), std::uint8_t(c.g / 2), std::uint8_t(c.b / 2)};
  const ImageDifference found = compare_images(half, image, Image<std::uint8_t>(40, 30, 1));
  EXPECT_NEAR(found.gain, 2, 0.02);
  EXPECT_GT(found.psnr_db, 48);  // rounding to half of the levels: an error of 0.7 at most
}

// 10 log10(255² / 16) for a difference of 4 levels that no gain can take away: half of the pixels up, half down.
TEST(ImageDifference, PsnrOfAKnownDifference) {
  ColorImage a(20, 20, Rgb8{100, 100, 100}), b = a;
  for (std::size_t i = 0; i < b.size(); ++i) {
    const auto level = std::uint8_t(i % 2 == 0 ? 104 : 96);
    b.pixels[i] = {level, level, level};
  }
  const ImageDifference found = compare_images(a, b, Image<std::uint8_t>(20, 20, 1));
  EXPECT_NEAR(found.psnr_db, 10 * std::log10(255.0 * 255.0 / 16), 1e-9);
  EXPECT_LT(found.ssim, 0.8);
}

TEST(ImageDifference, OnlyTheMaskCounts) {
  const ColorImage image = ramp(40, 30);
  ColorImage spoilt = image;
  Image<std::uint8_t> mask(40, 30, 1);
  for (int v = 0; v < 30; ++v)
    for (int u = 0; u < 15; ++u) spoilt.at(u, v) = {255, 0, 255}, mask.at(u, v) = 0;
  const ImageDifference found = compare_images(spoilt, image, mask);
  EXPECT_EQ(found.pixels, 750u);
  EXPECT_EQ(found.psnr_db, std::numeric_limits<double>::infinity());
  EXPECT_NEAR(found.ssim, 1, 1e-12);
}

// Two squares side by side, on two pages whose colours differ by 6, 8 and 10 levels.
Mesh two_pages() {
  Mesh mesh;
  for (const auto& [x, y] : {std::pair{0, 0}, {1, 0}, {2, 0}, {0, 1}, {1, 1}, {2, 1}})
    mesh.positions_m.push_back({float(x), float(y), 0});
  mesh.triangles = {{0, 1, 4}, {0, 4, 3}, {1, 2, 5}, {1, 5, 4}};
  mesh.triangle_page = {0, 0, 1, 1};
  mesh.pages = {ColorImage(16, 16, Rgb8{100, 100, 100}), ColorImage(16, 16, Rgb8{106, 108, 110})};
  const Eigen::Vector2f a(0.25f, 0.25f), b(0.75f, 0.25f), c(0.75f, 0.75f), d(0.25f, 0.75f);
  mesh.texcoords = {{a, b, c}, {a, c, d}, {a, b, c}, {a, c, d}};
  return mesh;
}

TEST(ColorSteps, AreMeasuredWhereTheTextureIsCut) {
  Context context(1);
  const ColorStepFigures found = measure_color_steps(two_pages(), context);
  EXPECT_EQ(found.edges, 1u);
  EXPECT_EQ(found.samples, 8u);  // the edge is half of a page of 16 pixels
  EXPECT_DOUBLE_EQ(found.length_m, 1);
  EXPECT_NEAR(found.median, std::sqrt((36.0 + 64.0 + 100.0) / 3), 1e-4);
  EXPECT_NEAR(found.p95, found.median, 1e-6);
}

TEST(ColorSteps, AreMeasuredTowardsTrianglesWithVertexColors) {
  Context context(1);
  Mesh mesh = two_pages();
  mesh.pages.pop_back();
  mesh.triangle_page = {0, 0, kInvalidIndex, kInvalidIndex};
  mesh.colors.assign(mesh.vertex_count(), Rgb8{112, 112, 112});
  const ColorStepFigures found = measure_color_steps(mesh, context);
  EXPECT_EQ(found.edges, 0u);
  EXPECT_EQ(found.vertex_color_samples, 8u) << "none between triangles that both have the colours of their vertices";
  EXPECT_NEAR(found.vertex_color_median, 12, 1e-4);
  EXPECT_NEAR(found.vertex_color_p95, 12, 1e-4);
  mesh.colors.clear();
  EXPECT_EQ(measure_color_steps(mesh, context).vertex_color_samples, 0u) << "what has no colour makes no step";
}

TEST(ColorSteps, ThereAreNoneInsideAChartOrWithoutATexture) {
  Context context(1);
  Mesh mesh = two_pages();
  mesh.triangles.resize(2);
  mesh.triangle_page.resize(2);
  mesh.texcoords.resize(2);
  EXPECT_EQ(measure_color_steps(mesh, context).samples, 0u);
  Mesh plain = two_pages();
  plain.triangle_page.clear();
  EXPECT_EQ(measure_color_steps(plain, context).samples, 0u);
}

// Vertex colours are linear across triangles, and so is the paint of this wall.
TEST(NovelViews, AModelIsComparedOverWhatItCovers) {
  const auto paint = [](const Eigen::Vector3d& p) { return Eigen::Vector3d(120 + 60 * p.x(), 120 + 60 * p.y(), 128); };
  Mesh mesh;
  test::append_patch(mesh, {-0.5, -0.5, 1.5}, {0, 1, 0}, {1, 0, 0}, 10);
  for (const Eigen::Vector3f& p : mesh.positions_m) {
    const Eigen::Vector3d c = paint(p.cast<double>());
    mesh.colors.push_back({std::uint8_t(c.x() + 0.5), std::uint8_t(c.y() + 0.5), std::uint8_t(c.z() + 0.5)});
  }
  std::vector<ViewSource> views = {
      test::painted_source("darker", test::small_camera(120, 110), Eigen::Isometry3d::Identity(),
                           test::plane({0, 0, 1.5}, {0, 0, -1}), paint, {Eigen::Vector3d::Constant(0.8), 0}),
      ViewSource{}};
  Context context(2);
  const NovelEvaluation found = evaluate_novel(mesh, views, context);
  ASSERT_EQ(found.views.size(), 1u);  // the other has no image
  EXPECT_NEAR(found.views[0].gain, 0.8, 0.005);
  // The wall is 73.3 pixels wide and high; pixels that it covers in part do not count.
  EXPECT_NEAR(double(found.views[0].pixels), 73 * 73, 2 * 73);
  EXPECT_GT(found.mean_psnr_db, 50);  // rounding alone
  mesh.colors.clear();
  EXPECT_THROW(evaluate_novel(mesh, views, context), InvalidInput);
  EXPECT_THROW(evaluate_novel(mesh, std::span(views).subspan(1), context), InvalidInput);
}

}  // namespace
}  // namespace lapseam
