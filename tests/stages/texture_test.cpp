#include "lapseam/texture.h"

#include <gtest/gtest.h>

#include "lapseam/context.h"
#include "lapseam/error.h"
#include "support/analytic_views.h"

namespace lapseam {
namespace {

// Each pixel says where it is.
ColorImage coordinates_image(int w, int h, std::uint8_t blue) {
  ColorImage image(w, h);
  for (int v = 0; v < h; ++v)
    for (int u = 0; u < w; ++u) image.at(u, v) = {std::uint8_t(u), std::uint8_t(v), blue};
  return image;
}

ViewSource colored_source(const Sensor& camera, std::uint8_t blue) {
  ViewSource source;
  source.name = "view" + std::to_string(blue);
  source.color = ColorSource{{},
                             camera,
                             Eigen::Isometry3d::Identity(),
                             std::make_shared<ColorImage>(coordinates_image(width(camera), height(camera), blue))};
  return source;
}

// A square of two triangles that fills pixels (u0, v0) to (u1, v1) of a camera at the origin, at z = 1.
void append_square(Mesh& mesh, const PinholeSensor& camera, int u0, int v0, int u1, int v1, std::uint32_t view) {
  const auto base = std::uint32_t(mesh.vertex_count());
  for (const auto& [u, v] : {std::pair{u0, v0}, {u0, v1}, {u1, v1}, {u1, v0}}) {
    mesh.positions_m.push_back(camera.unproject(u, v, 1).cast<float>());
    mesh.vertex_view.push_back(view);
    mesh.vertex_pixel.push_back(0);
  }
  mesh.triangles.push_back({base, base + 1, base + 2});
  mesh.triangles.push_back({base, base + 2, base + 3});
  for (int i = 0; i < 2; ++i) {
    mesh.triangle_view.push_back(view);
    mesh.triangle_tag.push_back(TriangleTag::kMeasured);
  }
}

// The source colour that a corner's coordinates point at must be the pixel that the corner projects to.
TEST(Atlas, CornersKeepTheirPixels) {
  const PinholeSensor camera{200, 150, 120, 120, 99.5, 74.5, {}};
  const std::vector<ViewSource> sources = {colored_source(camera, 10), colored_source(camera, 20)};
  Mesh mesh;
  append_square(mesh, camera, 10, 20, 60, 50, 0);
  append_square(mesh, camera, 100, 20, 190, 140, 1);
  append_square(mesh, camera, 3, 100, 33, 140, 1);
  Context context(2);
  const AtlasReport report = build_atlas(mesh, sources, {.page_size = 128}, context);
  EXPECT_EQ(report.charts, 3u);
  EXPECT_EQ(report.untextured_triangles, 0u);
  EXPECT_GE(report.pages, 1u);
  for (const ColorImage& page : mesh.pages) {
    EXPECT_LE(page.width, 128);
    EXPECT_LE(page.height, 128);
  }
  for (std::size_t i = 0; i < mesh.triangle_count(); ++i)
    for (std::size_t k = 0; k < 3; ++k) {
      PixelRange expected;
      ASSERT_TRUE(camera.project(mesh.positions_m[mesh.triangles[i][k]].cast<double>(), expected));
      const ColorImage& page = mesh.pages[mesh.triangle_page[i]];
      const auto x = int(std::lround(double(mesh.texcoords[i][k].x()) * page.width - 0.5));
      const auto y = int(std::lround(double(mesh.texcoords[i][k].y()) * page.height - 0.5));
      const Rgb8 found = page.at(x, y);
      EXPECT_EQ(found.r, std::lround(expected.u));
      EXPECT_EQ(found.g, std::lround(expected.v));
      EXPECT_EQ(found.b, mesh.triangle_view[i] == 0 ? 10 : 20);
    }
}

TEST(Atlas, ChartLargerThanAPageIsCut) {
  const PinholeSensor camera{250, 250, 200, 200, 124.5, 124.5, {}};
  const std::vector<ViewSource> sources = {colored_source(camera, 10)};
  Mesh mesh;
  // A connected strip of small squares, 240 pixels long.
  for (int u = 4; u < 244; u += 8) append_square(mesh, camera, u, 100, u + 8, 108, 0);
  for (std::uint32_t i = 4; i < mesh.vertex_count(); i += 4)  // share the vertices of neighbours
    for (Triangle& t : mesh.triangles)
      for (std::uint32_t& v : t) v = v == i ? i - 1 : v == i + 1 ? i - 2 : v;
  Context context(2);
  const AtlasReport report = build_atlas(mesh, sources, {.page_size = 64}, context);
  EXPECT_GT(report.charts, 3u);
  EXPECT_EQ(report.untextured_triangles, 0u);
  for (const ColorImage& page : mesh.pages) EXPECT_LE(std::max(page.width, page.height), 64);
}

TEST(Atlas, WithoutColourOrOutsideTheImageIsUntextured) {
  const PinholeSensor camera{100, 100, 100, 100, 49.5, 49.5, {}};
  std::vector<ViewSource> sources = {colored_source(camera, 10), ViewSource{}};
  Mesh mesh;
  append_square(mesh, camera, 10, 10, 40, 40, 0);
  append_square(mesh, camera, 80, 10, 140, 40, 0);
  append_square(mesh, camera, 10, 10, 40, 40, 1);
  Context context(1);
  const AtlasReport report = build_atlas(mesh, sources, {}, context);
  EXPECT_EQ(report.untextured_triangles, 4u);
  EXPECT_EQ(mesh.triangle_page[2], kInvalidIndex);
  EXPECT_NE(mesh.triangle_page[0], kInvalidIndex);
  EXPECT_THROW(build_atlas(mesh, sources, {.page_size = 8}, context), InvalidInput);
}

TEST(Atlas, SeamAtTheFrameTakesTheOtherView) {
  const PinholeSensor camera{100, 100, 100, 100, 49.5, 49.5, {}};
  std::vector<ViewSource> sources = {colored_source(camera, 10), colored_source(camera, 20)};
  sources[1].T_world_view.translation().x() = 0.4;  // sees 40 pixels farther right
  Mesh mesh;
  append_square(mesh, camera, 80, 10, 120, 40, 0);
  for (std::size_t k = 0; k < 4; ++k) mesh.vertex_view[k] = k < 2 ? 0 : 1;
  Context context(1);
  EXPECT_EQ(build_atlas(mesh, sources, {}, context).untextured_triangles, 0u);
  EXPECT_EQ(mesh.triangle_view, (std::vector<std::uint32_t>{1, 1}));
}

TEST(ColorVertices, TakesTheViewsOwnPixel) {
  const PinholeSensor camera{200, 150, 120, 120, 99.5, 74.5, {}};
  const std::vector<ViewSource> sources = {colored_source(camera, 10), ViewSource{}};
  Mesh mesh;
  append_square(mesh, camera, 10, 20, 60, 50, 0);
  append_square(mesh, camera, 10, 20, 60, 50, 1);
  Context context(2);
  color_vertices(mesh, sources, context);
  EXPECT_EQ(mesh.colors[0], (Rgb8{10, 20, 10}));
  EXPECT_EQ(mesh.colors[2], (Rgb8{60, 50, 10}));
  EXPECT_EQ(mesh.colors[4], (Rgb8{128, 128, 128}));
}

}  // namespace
}  // namespace lapseam
