#include "lapseam/texture.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "lapseam/context.h"
#include "lapseam/error.h"
#include "lapseam/evaluate_novel.h"
#include "lapseam/render.h"
#include "support/painted_views.h"
#include "texture/depth_image.h"
#include "texture/foreign_colors.h"
#include "texture/painting.h"

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
  source.sensor_id = "camera";
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
  const TextureReport report =
      texture(mesh, sources, {.page_size = 512, .equalize = false, .level = false, .choose = false}, context);
  EXPECT_EQ(report.charts, 3u);
  EXPECT_EQ(report.unseen_triangles, 0u);
  EXPECT_GE(report.pages, 1u);
  for (const ColorImage& page : mesh.pages) {
    EXPECT_LE(page.width, 512);
    EXPECT_LE(page.height, 512);
  }
  // Well inside: at its ends nothing is known of what lies beyond, so the model takes colours from a little further in.
  for (std::size_t i = 0; i < mesh.triangle_count(); ++i)
    for (std::size_t k = 0; k < 3; ++k) {
      const auto inside = [&](const auto& corners) {
        return (0.5 * corners(k) + 0.25 * corners((k + 1) % 3) + 0.25 * corners((k + 2) % 3)).eval();
      };
      PixelRange expected;
      ASSERT_TRUE(camera.project(
          inside([&](std::size_t c) { return mesh.positions_m[mesh.triangles[i][c]].cast<double>(); }), expected));
      const ColorImage& page = mesh.pages[mesh.triangle_page[i]];
      const Eigen::Vector2d uv = inside([&](std::size_t c) { return mesh.texcoords[i][c].cast<double>(); });
      const double x = uv.x() * page.width - 0.5, y = uv.y() * page.height - 0.5;
      // The image says where its pixels are, so what is found says where the lookup came from.
      const int x0 = int(std::floor(x)), y0 = int(std::floor(y));
      Eigen::Vector3d found = Eigen::Vector3d::Zero();
      for (const auto& [u, v] : {std::pair{x0, y0}, {x0 + 1, y0}, {x0, y0 + 1}, {x0 + 1, y0 + 1}}) {
        const Rgb8 c = page.at(u, v);
        found += (1 - std::abs(x - u)) * (1 - std::abs(y - v)) * Eigen::Vector3d(c.r, c.g, c.b);
      }
      EXPECT_NEAR(found.x(), expected.u, 1e-2);
      EXPECT_NEAR(found.y(), expected.v, 1e-2);
      EXPECT_NEAR(found.z(), mesh.triangle_view[i] == 0 ? 10 : 20, 1e-9);
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
  const TextureReport report = texture(mesh, sources, {.page_size = 96}, context);
  EXPECT_GT(report.charts, 3u);
  EXPECT_EQ(report.unseen_triangles, 0u);
  for (const ColorImage& page : mesh.pages) EXPECT_LE(std::max(page.width, page.height), 96);
}

// Blue channel of the texture at the middle of a triangle.
int blue_of(const Mesh& mesh, std::size_t i) {
  const ColorImage& page = mesh.pages[mesh.triangle_page[i]];
  const Eigen::Vector2f uv = (mesh.texcoords[i][0] + mesh.texcoords[i][1] + mesh.texcoords[i][2]) / 3;
  return page.at(int(uv.x() * float(page.width)), int(uv.y() * float(page.height))).b;
}

TEST(Atlas, TrianglesDoNotTakeAFarImageForTheirNeighboursSake) {
  // The near image ends between two squares, whose triangles are one cell; the far one, four times coarser, shows both.
  const PinholeSensor near_camera{200, 150, 120, 120, 99.5, 74.5, {}}, far_camera{200, 150, 30, 30, 99.5, 74.5, {}};
  const std::vector<ViewSource> sources = {colored_source(near_camera, 10), colored_source(far_camera, 20)};
  Mesh mesh;
  append_square(mesh, near_camera, 100, 40, 195, 110, 0);
  append_square(mesh, near_camera, 195, 40, 240, 110, 1);
  for (std::size_t i = 2; i < 4; ++i)
    for (std::uint32_t& v : mesh.triangles[i]) v = v == 4 ? 3 : v == 5 ? 2 : v;
  Context context(2);
  texture(mesh, sources, {.equalize = false, .level = false}, context);
  ASSERT_EQ(std::count(mesh.triangle_page.begin(), mesh.triangle_page.end(), kInvalidIndex), 0);
  for (const std::size_t i : {0u, 1u}) EXPECT_EQ(blue_of(mesh, i), 10);
  for (const std::size_t i : {2u, 3u}) EXPECT_EQ(blue_of(mesh, i), 20);
}

TEST(DepthImage, WhatAJumpHidesIsHiddenUpToTheJump) {
  // A board in front of the left half of a wall. Visible is still what lies a pixel or two behind the board's edge.
  const auto board = [](int u) { return u < 10; };
  DepthImage depth;
  depth.stride = 2;
  depth.distance_m = Image<float>(20, 10);
  depth.is_near_step = Image<std::uint8_t>(20, 10);
  for (int v = 0; v < 10; ++v)
    for (int u = 0; u < 20; ++u) {
      depth.distance_m.at(u, v) = board(u) ? 1.0f : 2.0f;
      depth.is_near_step.at(u, v) = std::abs(u - 9.5) < 2;
    }
  EXPECT_TRUE(depth.is_visible({18.8f, 9}, 2));
  EXPECT_TRUE(depth.is_hidden({18.8f, 9}, 2));
  EXPECT_TRUE(depth.is_hidden({10, 9}, 2));
  EXPECT_FALSE(depth.is_hidden({18.8f, 9}, 1));
  EXPECT_FALSE(depth.is_hidden({21, 9}, 2));
}

// A red thing before a blue wall, whose surface is ten pixels wider than it is: at its rims the image shows the wall.
TEST(ForeignColors, WhatShowsTheBackgroundBeyondTheFringeJoinsIt) {
  constexpr int kColumns = 200, kRows = 120;
  ColorImage image(kColumns, kRows);
  for (int v = 0; v < kRows; ++v)
    for (int u = 0; u < kColumns; ++u) image.at(u, v) = u < 90 ? Rgb8{200, 30, 30} : Rgb8{30, 30, 200};
  DepthImage depth;
  depth.stride = 2;
  depth.angle_rad = 0.002f;
  depth.distance_m = Image<float>(kColumns / 2, kRows / 2);
  for (int v = 0; v < kRows / 2; ++v)
    for (int u = 0; u < kColumns / 2; ++u) depth.distance_m.at(u, v) = u < 50 ? 1.0f : 2.0f;
  mark_fringes(depth, false, 0);
  ASSERT_FALSE(depth.is_fringe({94, 60}));
  DepthImage placed = depth;
  mark_foreign_colors(image, false, 0.001, placed);
  EXPECT_FALSE(placed.is_fringe({92, 60})) << "farther in than misplaced surfaces reach";
  mark_foreign_colors(image, false, 0.01, depth);
  for (int u = 91; u < 100; ++u) EXPECT_TRUE(depth.is_fringe({float(u), 60})) << u;
  EXPECT_FALSE(depth.is_fringe({87, 60})) << "its own colour";
  EXPECT_FALSE(depth.is_fringe({107, 60})) << "the wall's own colour";
  EXPECT_TRUE(depth.is_foreign({94, 60}));
  EXPECT_FALSE(depth.is_foreign({99, 60})) << "the fringe that was there";
}

// A row of pixels: own colour, then what shows the background, twice as wide as a fringe, then a fringe.
TEST(ForeignColors, AreReplacedHoweverWideTheyAreAndFringesAlone) {
  constexpr int kClean = 16, kForeign = 24, kAll = 32;
  Chart chart;
  chart.shape.width = kAll / kBlock_px, chart.shape.height = 1;
  chart.shape.used.assign(std::size_t(chart.shape.width), 1);
  const auto painted = [&](std::uint16_t foreign_mark) {
    ColorImage page(kAll, kBlock_px);
    PartMap map(kAll, kBlock_px);
    for (int y = 0; y < kBlock_px; ++y)
      for (int x = 0; x < kAll; ++x) {
        page.at(x, y) = x < kClean ? Rgb8{10, 200, 10} : Rgb8{200, 10, 10};
        map.at(x, y) = std::uint16_t(1 | (x < kClean ? 0 : x < kForeign ? foreign_mark : kNearStepBit));
      }
    fill_unused(chart, 4, map, page);
    return page;
  };
  const ColorImage page = painted(kNearStepBit | kForeignBit);
  for (const int x : {kClean, kForeign - 1, kForeign + 3}) EXPECT_EQ(page.at(x, 4), (Rgb8{10, 200, 10})) << x;
  EXPECT_EQ(page.at(kForeign + 6, 4), (Rgb8{200, 10, 10})) << "farther from any known colour than a fringe is wide";
  EXPECT_EQ(painted(kNearStepBit).at(kForeign - 1, 4), (Rgb8{200, 10, 10})) << "not foreign";
}

TEST(Atlas, WhatNoImageShowsContinuesTheColorsAround) {
  const PinholeSensor camera{100, 100, 100, 100, 49.5, 49.5, {}};
  ViewSource red = colored_source(camera, 10);
  red.color->memory = std::make_shared<ColorImage>(100, 100, Rgb8{200, 40, 10});
  const std::vector<ViewSource> sources = {red, ViewSource{}};
  Mesh mesh;
  append_square(mesh, camera, 10, 10, 40, 40, 0);
  append_square(mesh, camera, 80, 10, 140, 40, 0);  // beyond the frame
  append_square(mesh, camera, 40, 10, 60, 40, 1);   // measured without colour, but another view shows it
  mesh.triangles[2][0] = mesh.triangles[0][2];      // what is beyond is joined to what is seen
  const std::vector<std::uint32_t> provenance = mesh.triangle_view;
  Context context(1);
  const TextureReport report = texture(mesh, sources, {.level = false}, context);
  EXPECT_EQ(report.unseen_triangles, 2u);
  EXPECT_EQ(mesh.triangle_view, provenance);
  EXPECT_EQ(mesh.triangle_page[2], kInvalidIndex);
  EXPECT_EQ(mesh.triangle_page[3], kInvalidIndex);
  EXPECT_EQ(mesh.is_unseen, (std::vector<std::uint8_t>{0, 0, 1, 1, 0, 0}));
  EXPECT_NE(mesh.triangle_page[0], kInvalidIndex);
  EXPECT_NE(mesh.triangle_page[4], kInvalidIndex);
  ASSERT_EQ(mesh.colors.size(), mesh.vertex_count());
  for (const std::uint32_t v : mesh.triangles[3]) EXPECT_EQ(mesh.colors[v], (Rgb8{200, 40, 10}));
}

// A page would need four blocks for such a chart; colours of its vertices say the same. What is around it was measured
// with another image, so that no edge of depth is near.
TEST(Atlas, ATinyChartOfTrianglesLikePixelsGetsVertexColors) {
  const PinholeSensor camera{200, 150, 120, 120, 99.5, 74.5, {}};
  const std::vector<ViewSource> sources = {colored_source(camera, 10), colored_source(camera, 20)};
  Mesh mesh;
  append_square(mesh, camera, 10, 20, 60, 50, 0);
  append_square(mesh, camera, 120, 20, 126, 26, 0);  // as tiny, but with nothing between its corners
  append_square(mesh, camera, 130, 80, 176, 100, 1);
  append_square(mesh, camera, 130, 106, 176, 126, 1);
  append_square(mesh, camera, 130, 100, 150, 106, 1);
  append_square(mesh, camera, 156, 100, 176, 106, 1);
  constexpr std::size_t kOnPages = 12;
  for (int v = 100; v < 106; ++v)
    for (int u = 150; u < 156; ++u) append_square(mesh, camera, u, v, u + 1, v + 1, 0);
  Context context(1);
  const TextureReport report = texture(mesh, sources, {.equalize = false, .level = false, .choose = false}, context);
  EXPECT_EQ(report.vertex_colored_triangles, 72u);
  EXPECT_EQ(report.charts, 3u);
  EXPECT_EQ(report.unseen_triangles, 0u);
  ASSERT_EQ(mesh.pages.size(), report.pages);
  ASSERT_EQ(mesh.colors.size(), mesh.vertex_count());
  for (std::size_t i = 0; i < mesh.triangle_count(); ++i) {
    EXPECT_EQ(mesh.triangle_page[i] == kInvalidIndex, i >= kOnPages) << i;
    EXPECT_FALSE(mesh.is_unseen[i]);
  }
  for (int v = 100; v < 106; ++v)
    for (int u = 150; u < 156; ++u) {
      const std::uint32_t corner = mesh.triangles[kOnPages + std::size_t(2 * ((v - 100) * 6 + u - 150))][0];
      EXPECT_EQ(mesh.colors[corner], (Rgb8{std::uint8_t(u), std::uint8_t(v), 10}));
    }
}

TEST(Atlas, LimitsAreChecked) {
  const PinholeSensor camera{100, 100, 100, 100, 49.5, 49.5, {}};
  const std::vector<ViewSource> sources = {colored_source(camera, 10)};
  Mesh mesh;
  append_square(mesh, camera, 10, 10, 40, 40, 0);
  Context context(1);
  EXPECT_THROW(texture(mesh, sources, {.page_size = 8}, context), InvalidInput);
  EXPECT_THROW(texture(mesh, sources, {.texel_m = -1}, context), InvalidInput);
  EXPECT_THROW(texture(mesh, sources, {.memory_bytes = 100}, context), InvalidInput);  // under one block
}

// A room of two materials, seen by eight panorama-like rings of pinhole cameras.
struct PaintedRoom {
  Mesh mesh;
  std::vector<ViewSource> sources;
};

Eigen::Vector3d room_paint(const Eigen::Vector3d& p) {
  return Eigen::Vector3d(120 + 60 * std::sin(4 * p.x() + 2 * p.z()), 110 + 50 * std::sin(5 * p.y()),
                         115 + 55 * std::cos(3 * p.z() - 4 * p.y()));
}

PaintedRoom make_room(int n) {
  const Eigen::Vector3d low(-1.5, -1.2, -1), high(1.5, 1.2, 1);
  PaintedRoom room{test::room_mesh(low, high, n), {}};
  for (int i = 0; i < 8; ++i) {
    const double a = 0.785 * i;
    const Eigen::Vector3d eye(0.3 * std::cos(a + 3), 0.3 * std::sin(a + 3), 0.1 * (i % 3 - 1));
    const Eigen::Vector3d target = eye + Eigen::Vector3d(std::cos(a), std::sin(a), 0.45 * (i % 3 - 1));
    room.sources.push_back(test::painted_source("view" + std::to_string(i), test::small_camera(200, 95),
                                                test::look_at(eye, target), test::box_room(low, high), room_paint,
                                                {Eigen::Vector3d::Constant(0.8 + 0.06 * i), 0}));
  }
  return room;
}

TEST(Texture, SameBytesForAnyNumberOfThreads) {
  PaintedRoom first = make_room(24);
  Context one(1);
  texture(first.mesh, first.sources, {.page_size = 256}, one);
  allow_threads(8);
  for (const int threads : {2, 3, 8}) {
    PaintedRoom room = make_room(24);
    Context context(threads);
    texture(room.mesh, room.sources, {.page_size = 256}, context);
    ASSERT_EQ(room.mesh.pages.size(), first.mesh.pages.size());
    for (std::size_t p = 0; p < first.mesh.pages.size(); ++p)
      EXPECT_EQ(room.mesh.pages[p].pixels, first.mesh.pages[p].pixels) << threads << " threads";
    EXPECT_EQ(room.mesh.texcoords, first.mesh.texcoords);
    EXPECT_EQ(room.mesh.triangle_page, first.mesh.triangle_page);
    EXPECT_EQ(room.mesh.colors, first.mesh.colors);
  }
}

TEST(Texture, PicturesOfTheModelAreLikeTheImages) {
  PaintedRoom room = make_room(24);
  Context context(2);
  texture(room.mesh, room.sources, {}, context);
  const NovelEvaluation evaluation = evaluate_novel(room.mesh, room.sources, context);
  // One bilinear interpolation and a rounding more than the images: under half a level on the mean.
  EXPECT_GT(evaluation.lowest_psnr_db, 44);
  EXPECT_GT(evaluation.mean_ssim, 0.995);
}

TEST(Texture, LimitsOfMemoryAndTexelsAreObeyed) {
  PaintedRoom room = make_room(24), small = make_room(24), coarse = make_room(24);
  Context context(2);
  const TextureReport full = texture(room.mesh, room.sources, {}, context);
  const std::uint64_t limit = 3 * full.page_pixels / 4;
  const TextureReport reduced = texture(small.mesh, small.sources, {.memory_bytes = limit}, context);
  EXPECT_LE(3 * reduced.page_pixels, limit);
  EXPECT_GT(3 * reduced.page_pixels, limit / 3) << "smaller than it need be";
  EXPECT_LT(reduced.scale, 1);
  // The images have pixels of about 1 cm on the walls.
  const TextureReport at_3cm = texture(coarse.mesh, coarse.sources, {.texel_m = 0.03}, context);
  EXPECT_LT(at_3cm.used_pixels, full.used_pixels / 4);
  EXPECT_GT(evaluate_novel(coarse.mesh, coarse.sources, context).mean_psnr_db, 30);
}

// Coordinates are linear across a triangle, its image under perspective is not.
TEST(Texture, LargeTrianglesAreNotDistortedByPerspective) {
  const Eigen::Vector3d corner(-0.6, -0.5, 1.0), across(0, 1.0, 0.2), along(2.5, 0, 2.5);
  const test::Shape wall = test::plane(corner, across.cross(along));
  const auto stripes = [](const Eigen::Vector3d& p) {
    return Eigen::Vector3d(std::sin(12 * p.x()) > 0 ? 200 : 60, std::sin(11 * p.y()) > 0 ? 190 : 70, 128);
  };
  std::vector<ViewSource> sources = {test::painted_source("slanted", test::small_camera(300, 250),
                                                          test::look_at({0, 0, 0}, {0, 0.05, 2}), wall, stripes)};
  Mesh mesh;
  test::append_patch(mesh, corner + 0.02 * along, across, 0.5 * along, 1);
  Context context(1);
  const TextureReport report = texture(mesh, sources, {}, context);
  ASSERT_EQ(report.unseen_triangles, 0u);
  const NovelEvaluation evaluation = evaluate_novel(mesh, sources, context);
  // Linear coordinates alone would shift stripes by many pixels, 15 dB.
  EXPECT_GT(evaluation.mean_psnr_db, 27);
}

TEST(Texture, AnImageThatSomethingStandsInIsNotUsedBehindIt) {
  const test::Shape wall = test::rectangle(2, -3, 3, -3, 3), board = test::rectangle(1, -0.2, 0.2, -0.2, 0.2);
  const auto paint = [](const Eigen::Vector3d& p) {
    return p.z() < 1.5 ? Eigen::Vector3d(230, 20, 20) : Eigen::Vector3d(20, 60, 200);
  };
  Mesh mesh;
  test::append_patch(mesh, {-0.8, -0.8, 2}, {0, 1.6, 0}, {1.6, 0, 0}, 40);
  const std::size_t wall_triangles = mesh.triangle_count();
  test::append_patch(mesh, {-0.2, -0.2, 1}, {0, 0.4, 0}, {0.4, 0, 0}, 10);
  std::vector<ViewSource> sources;
  for (const double x : {0.0, 0.9}) {
    Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
    T.translation().x() = x;
    sources.push_back(test::painted_source("at" + std::to_string(x), test::small_camera(300, 150), T,
                                           test::nearest({wall, board}), paint));
  }
  mesh.triangle_view.assign(mesh.triangle_count(), 0);
  Context context(2);
  texture(mesh, sources, {.equalize = false, .level = false}, context);
  for (std::size_t i = 0; i < wall_triangles; ++i) {
    if (mesh.triangle_page[i] == kInvalidIndex) continue;
    const ColorImage& page = mesh.pages[mesh.triangle_page[i]];
    const Eigen::Vector2f uv = (mesh.texcoords[i][0] + mesh.texcoords[i][1] + mesh.texcoords[i][2]) / 3;
    const Rgb8 found = page.at(int(uv.x() * float(page.width)), int(uv.y() * float(page.height)));
    EXPECT_LT(found.r, 60) << "the board's red on the wall, triangle " << i;
  }
}

// The nearer image is overexposed on the left; white lines on the right, four pixels wide, are print.
TEST(Texture, AnOverexposedImageGivesWayToACoarserOneThatIsNot) {
  const test::Shape wall = test::rectangle(2, -3, 3, -3, 3);
  const auto far_paint = [](const Eigen::Vector3d&) { return Eigen::Vector3d(232, 240, 240); };
  const auto near_paint = [](const Eigen::Vector3d& p) {
    const bool is_white = p.x() < 0 || (p.x() > 0.25 && std::fmod(p.x(), 0.03) < 0.015);
    return is_white ? Eigen::Vector3d(255, 255, 255) : Eigen::Vector3d(240, 240, 240);
  };
  Mesh mesh;
  test::append_patch(mesh, {-0.6, -0.6, 2}, {0, 1.2, 0}, {1.2, 0, 0}, 40);
  mesh.triangle_view.assign(mesh.triangle_count(), 0);
  std::vector<ViewSource> sources;
  const PinholeSensor camera = test::small_camera(600, 300);
  Eigen::Isometry3d nearer = Eigen::Isometry3d::Identity();
  nearer.translation().z() = 0.8;
  sources.push_back(test::painted_source("near", camera, nearer, wall, near_paint));
  sources.push_back(test::painted_source("far", camera, Eigen::Isometry3d::Identity(), wall, far_paint));
  Context context(2);
  texture(mesh, sources, {.equalize = false, .level = false}, context);
  std::size_t from_far = 0, from_near = 0;
  for (std::size_t i = 0; i < mesh.triangle_count(); ++i) {
    ASSERT_NE(mesh.triangle_page[i], kInvalidIndex);
    const Triangle& t = mesh.triangles[i];
    const float x = (mesh.positions_m[t[0]] + mesh.positions_m[t[1]] + mesh.positions_m[t[2]]).x() / 3;
    const ColorImage& page = mesh.pages[mesh.triangle_page[i]];
    const Eigen::Vector2f uv = (mesh.texcoords[i][0] + mesh.texcoords[i][1] + mesh.texcoords[i][2]) / 3;
    const Rgb8 found = page.at(int(uv.x() * float(page.width)), int(uv.y() * float(page.height)));
    if (x < -0.1f) {
      EXPECT_NEAR(found.r, 232, 1) << "overexposed at " << x;
      ++from_far;
    } else if (x > 0.2f) {
      EXPECT_GE(found.r, 239) << "print at " << x;
      ++from_near;
    }
  }
  EXPECT_GT(from_far, 1000u);
  EXPECT_GT(from_near, 1000u);
}

TEST(Texture, APanoramaIsUsedAcrossItsSeam) {
  const Eigen::Vector3d low(-1.5, -1.2, -1), high(1.5, 1.2, 1);
  const SphericalSensor camera = SphericalSensor::from_limits(720, 360, -M_PI, M_PI, M_PI / 2, -M_PI / 2);
  std::vector<ViewSource> sources = {
      test::painted_source("station", camera, Eigen::Isometry3d::Identity(), test::box_room(low, high), room_paint)};
  Mesh mesh = test::room_mesh(low, high, 30);
  Context context(2);
  const TextureReport report = texture(mesh, sources, {.page_size = 512}, context);
  EXPECT_EQ(report.unseen_triangles, 0u);
  const PinholeSensor pinhole = test::small_camera(200, 100);
  std::vector<ViewSource> novel;
  for (const Eigen::Vector3d& target :
       {Eigen::Vector3d(-1.5, 0, 0), Eigen::Vector3d(0, 0, 1), Eigen::Vector3d(1, 1, 0)})
    novel.push_back(test::painted_source("novel", pinhole, test::look_at({0.1, 0.05, 0}, target),
                                         test::box_room(low, high), room_paint));
  EXPECT_GT(evaluate_novel(mesh, novel, context).lowest_psnr_db, 36);
}

TEST(ColorVertices, TakesTheTexturesColor) {
  PaintedRoom room = make_room(24);
  for (std::size_t i = 1; i < room.sources.size(); ++i) room.sources[i].color.reset();
  Context context(2);
  texture(room.mesh, room.sources, {}, context);
  color_vertices(room.mesh, context);
  ASSERT_EQ(room.mesh.colors.size(), room.mesh.vertex_count());
  std::size_t compared = 0;
  std::vector<std::uint8_t> is_seen(room.mesh.vertex_count(), 0);
  for (std::size_t i = 0; i < room.mesh.triangle_count(); ++i)
    if (room.mesh.triangle_page[i] != kInvalidIndex)
      for (const std::uint32_t v : room.mesh.triangles[i]) is_seen[v] = 1;
  for (std::size_t v = 0; v < is_seen.size(); ++v) {
    if (!is_seen[v]) continue;
    const Eigen::Vector3d paint = 0.8 * room_paint(room.mesh.positions_m[v].cast<double>());
    const Rgb8 c = room.mesh.colors[v];
    EXPECT_LT((Eigen::Vector3d(c.r, c.g, c.b) - paint).norm(), 12) << v;
    ++compared;
  }
  EXPECT_GT(compared, 100u);
}

}  // namespace
}  // namespace lapseam
