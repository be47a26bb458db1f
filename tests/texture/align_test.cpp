// Images whose poses or cameras are not what the scene says are brought to agree on the surface.

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>

#include "lapseam/context.h"
#include "lapseam/texture.h"
#include "support/painted_views.h"
#include "texture/color_camera.h"

namespace lapseam {
namespace {

constexpr double kWallDistance_m = 1.5, kWallFocal_px = 130, kExpected_m = 0.03;  // 87 pixels a metre

Eigen::Vector3d striped_paint(const Eigen::Vector3d& p) {
  const double x = p.x(), y = p.y();
  return Eigen::Vector3d(120 + 40 * std::sin(23 * x + 9 * y) + 30 * std::sin(31 * y),
                         110 + 60 * std::sin(27 * y - 13 * x), 120 + 50 * std::cos(17 * x) + 20 * std::sin(35 * y));
}

struct StripedWall {
  Mesh mesh;
  std::vector<ViewSource> sources;
};

/// Six cameras side by side. Every other one stood `shift_m` off to one side of where its view says, the others as much
/// to the other side; and had a focal length that many times longer or shorter.
StripedWall make_striped_wall(const Eigen::Vector3d& shift_m, double zoom) {
  StripedWall wall;
  test::append_patch(wall.mesh, {-1.5, -0.6, kWallDistance_m}, {0, 1.2, 0}, {3, 0, 0}, 60);
  for (int i = 0; i < 6; ++i) {
    const bool is_odd = i % 2 != 0;
    Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
    T.translation() = Eigen::Vector3d(0.3 * (i - 2.5), 0, 0);
    Eigen::Isometry3d true_T = T;
    true_T.translation() += is_odd ? shift_m : Eigen::Vector3d(-shift_m);
    ViewSource source = test::painted_source(
        "view" + std::to_string(i), test::small_camera(160, is_odd ? kWallFocal_px * zoom : kWallFocal_px / zoom),
        true_T, test::plane({0, 0, kWallDistance_m}, {0, 0, -1}), striped_paint);
    source.T_world_view = T;
    source.sensor = source.color->camera = test::small_camera(160, kWallFocal_px);
    wall.sources.push_back(std::move(source));
  }
  return wall;
}

/// Root mean square of the difference between texture and paint, away from the ends, which few cameras see.
double distance_to_stripes(const Mesh& mesh) {
  double sum = 0, count = 0;
  for (std::size_t v = 0; v < mesh.vertex_count(); ++v) {
    const Eigen::Vector3d p = mesh.positions_m[v].cast<double>();
    if (std::abs(p.x()) > 0.8) continue;
    const Rgb8 c = mesh.colors[v];
    sum += (Eigen::Vector3d(c.r, c.g, c.b) - striped_paint(p)).squaredNorm() / 3;
    ++count;
  }
  return std::sqrt(sum / count);
}

struct Aligned {
  TextureReport report;
  double distance;
};

Aligned align_texture(StripedWall wall, double error_m, int threads = 2) {
  Context context(threads);
  TextureOptions options;
  options.registration_error_m = error_m;
  Aligned out{texture(wall.mesh, wall.sources, options, context), 0};
  color_vertices(wall.mesh, context);
  out.distance = distance_to_stripes(wall.mesh);
  return out;
}

// Within a share of how far off it is as it is.
void expect_aligned(const StripedWall& wall, double share) {
  const Aligned as_it_is = align_texture(wall, 0), aligned = align_texture(wall, kExpected_m);
  EXPECT_LT(aligned.report.displacement_after_px, 0.4 * aligned.report.displacement_before_px);
  EXPECT_LT(aligned.distance, share * as_it_is.distance);
}

// 1.5 cm are 1.3 pixels, for two neighbours in opposite directions.
TEST(Align, PosesThatAreOffAreFound) { expect_aligned(make_striped_wall({0.004, 0.015, 0}, 1), 0.35); }

// 2 % are a pixel and a half at the sides of the image: no motion of a camera before a wall does the same.
TEST(Align, CamerasThatAreNotQuiteKnownAreMadeUpFor) {
  const StripedWall wall = make_striped_wall({0, 0.005, 0}, 1.02);
  expect_aligned(wall, 0.42);  // more if all images could go astray together
  EXPECT_GT(align_texture(wall, kExpected_m).report.bent_images, 0u);
}

TEST(Align, WhatAgreesIsLeftWhereItIs) {
  const StripedWall wall = make_striped_wall(Eigen::Vector3d::Zero(), 1);
  const Aligned as_it_is = align_texture(wall, 0), aligned = align_texture(wall, kExpected_m);
  EXPECT_EQ(as_it_is.report.displacement_before_px, 0);  // not asked for
  EXPECT_EQ(aligned.report.bent_images, 0u);
  // A tenth of a pixel, where the paint changes by up to 25 levels a pixel.
  EXPECT_LT(aligned.distance, as_it_is.distance + 1);
}

// Blurred and sharp images of one camera after the other: where both show the wall, the sharp one has to be chosen.
TEST(Align, BlurredImagesAreKnownByTheirContrast) {
  StripedWall wall = make_striped_wall({0, 0.01, 0}, 1);
  for (std::size_t i = 1; i < wall.sources.size(); i += 2) {
    const ColorImage& sharp = *wall.sources[i].color->memory;
    auto blurred = std::make_shared<ColorImage>(sharp);
    for (int v = 3; v + 3 < sharp.height; ++v)
      for (int u = 3; u + 3 < sharp.width; ++u) {
        Eigen::Vector3i sum(24, 24, 24);
        for (int k = 0; k < 49; ++k) {
          const Rgb8 c = sharp.at(u + k % 7 - 3, v + k / 7 - 3);
          sum += Eigen::Vector3i(c.r, c.g, c.b);
        }
        blurred->at(u, v) = {std::uint8_t(sum.x() / 49), std::uint8_t(sum.y() / 49), std::uint8_t(sum.z() / 49)};
      }
    wall.sources[i].color->memory = blurred;
  }
  const Aligned with = align_texture(wall, kExpected_m), without = align_texture(wall, 0);
  EXPECT_LT(with.distance, 0.6 * without.distance);
}

// What a pixel is wide says nothing of the angle of parallel rays: such images are left where they are.
TEST(Align, ImagesWithParallelRaysStayWhereTheyAre) {
  StripedWall wall = make_striped_wall({0, 0.005, 0}, 1);
  const OrthographicSensor camera{160, 160, 0.01, 0.01, 79.5, 79.5};
  for (ViewSource& source : wall.sources) {
    source = test::painted_source(source.name, camera, source.T_world_view,
                                  test::plane({0, 0, kWallDistance_m}, {0, 0, -1}), striped_paint);
    source.sensor = source.color->camera = camera;
  }
  const Aligned aligned = align_texture(wall, kExpected_m);
  EXPECT_EQ(aligned.report.bent_images, 0u);
  EXPECT_EQ(aligned.report.unseen_triangles, align_texture(wall, 0).report.unseen_triangles);
}

TEST(Align, SameForAnyNumberOfThreads) {
  const StripedWall wall = make_striped_wall({0.004, 0.015, 0}, 1.01);
  allow_threads(8);
  std::vector<ColorImage> expected;
  for (const int threads : {1, 2, 3, 8}) {
    Context context(threads);
    TextureOptions options;
    options.registration_error_m = kExpected_m;
    Mesh mesh = wall.mesh;
    texture(mesh, wall.sources, options, context);
    if (expected.empty()) expected = mesh.pages;
    ASSERT_EQ(mesh.pages.size(), expected.size());
    for (std::size_t i = 0; i < expected.size(); ++i) {
      ASSERT_EQ(mesh.pages[i].size(), expected[i].size());
      EXPECT_EQ(std::memcmp(mesh.pages[i].pixels.data(), expected[i].pixels.data(), 3 * expected[i].size()), 0);
    }
  }
}

TEST(Align, RaysOfABentCameraMeetItsPixels) {
  const StripedWall wall = make_striped_wall(Eigen::Vector3d::Zero(), 1);
  ColorCamera camera(wall.sources.front(), Eigen::Vector3d::Zero());
  ImageWarp warp{3, 2, {80, 160}, {}};
  for (int k = 0; k < 6; ++k) warp.nodes.emplace_back(3 * std::sin(5 * k), 3 * std::cos(7 * k));
  camera.bend(warp);
  for (const Eigen::Vector2f& pixel : {Eigen::Vector2f(20, 30), Eigen::Vector2f(80, 75), Eigen::Vector2f(131, 140)}) {
    Eigen::Vector2f found;
    ASSERT_TRUE(camera.project(camera.ray_origin(pixel) + 2 * camera.ray_direction(pixel), found));
    EXPECT_LT((found - pixel).norm(), 0.01f);
  }
}

}  // namespace
}  // namespace lapseam
