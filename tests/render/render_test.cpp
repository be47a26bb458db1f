#include "lapseam/render.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "lapseam/context.h"
#include "lapseam/error.h"
#include "render/surface_color.h"

namespace lapseam {
namespace {

/// A square of side 2 in the plane z = 0, facing +z, cut from lower left to upper right.
Mesh square(float z = 0) {
  Mesh mesh;
  mesh.positions_m = {{-1, -1, z}, {1, -1, z}, {1, 1, z}, {-1, 1, z}};
  mesh.triangles = {{0, 1, 2}, {0, 2, 3}};
  return mesh;
}

/// Looks at the square from 3 m before it; it covers the pixels 20 to 80 of 101.
RenderCamera front_camera() {
  return look_at_camera(
      {.eye_m = {0, 0, 3}, .target_m = {0, 0, 0}, .fov_rad = 2 * std::atan(50.5 / 90), .width = 101, .height = 101});
}

RenderCamera back_camera() {
  RenderCamera camera = front_camera();
  camera.T_world_camera = Eigen::AngleAxisd(std::numbers::pi, Eigen::Vector3d::UnitY()) * camera.T_world_camera;
  return camera;
}

class Render : public ::testing::Test {
 protected:
  ColorImage draw(const Mesh& mesh, const RenderOptions& options) {
    return render(mesh, front_camera(), options, context_);
  }
  Context context_{2};
};

bool is_reddish(Rgb8 c) { return c.r > 2 * c.g && c.r > 2 * c.b && c.r > 60; }
bool is_yellow(Rgb8 c) { return c.r > 220 && c.g > 180 && c.b < 60; }
bool is_cyan(Rgb8 c) { return c.r < 60 && c.g > 190 && c.b > 220; }

TEST_F(Render, ShadedFrontIsGreyAndBackgroundShowsAround) {
  const ColorImage image = draw(square(), {.background = {1, 2, 3}});
  EXPECT_EQ(image.at(5, 50), (Rgb8{1, 2, 3}));
  EXPECT_EQ(image.at(18, 50), (Rgb8{1, 2, 3}));
  const Rgb8 c = image.at(60, 40);
  EXPECT_GT(c.r, 150);
  EXPECT_LT(std::abs(int(c.r) - int(c.b)), 20);
  EXPECT_GT(image.at(22, 50).r, 100) << "the square reaches from pixel 20 to 80";
  EXPECT_GT(image.at(78, 50).r, 100);
}

TEST_F(Render, BackfacesAreRedOrLookedThrough) {
  Mesh mesh = square(0.5f);  // in front, seen from behind
  for (Triangle& t : mesh.triangles) std::swap(t[1], t[2]);
  const Mesh wall = square(-0.5f);
  for (const Eigen::Vector3f& p : wall.positions_m) mesh.positions_m.push_back(p);
  for (const Triangle& t : wall.triangles) mesh.triangles.push_back({t[0] + 4, t[1] + 4, t[2] + 4});
  EXPECT_TRUE(is_reddish(draw(mesh, {}).at(50, 55)));
  const Rgb8 through = draw(mesh, {.cull_backfaces = true}).at(50, 55);
  EXPECT_FALSE(is_reddish(through));
  EXPECT_GT(through.g, 120);
}

TEST_F(Render, TextureIsTheRightWayUpAndBilinear) {
  Mesh mesh = square();
  ColorImage page(2, 2);
  page.at(0, 0) = {200, 0, 0}, page.at(1, 0) = {0, 200, 0}, page.at(0, 1) = {0, 0, 200},
             page.at(1, 1) = {200, 200, 200};
  mesh.pages = {page};
  mesh.triangle_page = {0, 0};
  const Eigen::Vector2f a(0, 1), b(1, 1), c(1, 0), d(0, 0);  // the page's first row is the square's upper edge
  mesh.texcoords = {{a, b, c}, {a, c, d}};
  const ColorImage image = draw(mesh, {.mode = RenderMode::kTextured});
  EXPECT_EQ(image.at(23, 23), (Rgb8{200, 0, 0}));
  EXPECT_EQ(image.at(77, 23), (Rgb8{0, 200, 0}));
  EXPECT_EQ(image.at(23, 77), (Rgb8{0, 0, 200}));
  EXPECT_EQ(image.at(77, 77), (Rgb8{200, 200, 200}));
  const Rgb8 middle = image.at(50, 50);
  for (const int channel : {middle.r, middle.g, middle.b}) EXPECT_NEAR(channel, 100, 4);
}

TEST_F(Render, ColorsAreInterpolated) {
  Mesh mesh = square();
  mesh.colors = {{0, 0, 0}, {240, 0, 0}, {240, 240, 0}, {0, 240, 0}};
  const ColorImage image = draw(mesh, {.mode = RenderMode::kColors});
  EXPECT_NEAR(image.at(65, 65).r, 180, 4);  // three quarters across, one quarter up
  EXPECT_NEAR(image.at(65, 65).g, 60, 4);
}

TEST_F(Render, ProvenanceTellsViewsSeamsAndFillingApart) {
  Mesh mesh = square();
  mesh.triangle_view = {0, 1};
  const auto colors_of = [&](const Mesh& m) {
    const ColorImage image = draw(m, {.mode = RenderMode::kProvenance});
    return std::pair(image.at(60, 70), image.at(40, 30));
  };
  const auto [first, second] = colors_of(mesh);
  EXPECT_GT(std::abs(first.r - second.r) + std::abs(first.g - second.g) + std::abs(first.b - second.b), 100);
  mesh.triangle_tag = {TriangleTag::kSeam, TriangleTag::kFilled};
  const auto [seam, filled] = colors_of(mesh);
  EXPECT_TRUE(seam.r > 200 && seam.r == seam.g && seam.g == seam.b);
  EXPECT_TRUE(filled.r > 200 && filled.g == 0 && filled.b > 200);
}

TEST(ViewColor, NeighboursInTheListDiffer) {
  for (std::uint32_t a = 0; a < 100; ++a)
    for (std::uint32_t b = a + 1; b < a + 12; ++b)
      EXPECT_GT((view_color(a) - view_color(b)).norm(), 20) << a << " and " << b;
}

TEST_F(Render, OpenEdgesAreYellowAndInnerOnesAreNot) {
  const ColorImage image = draw(square(), {.show_boundary = true});
  for (const int at : {25, 50, 75}) {
    EXPECT_TRUE(is_yellow(image.at(20, at)));
    EXPECT_TRUE(is_yellow(image.at(80, at)));
    EXPECT_TRUE(is_yellow(image.at(at, 20)));
    EXPECT_TRUE(is_yellow(image.at(at, 80)));
  }
  EXPECT_FALSE(is_yellow(image.at(50, 50))) << "the diagonal has two triangles";
  EXPECT_FALSE(is_yellow(image.at(25, 50)));
}

TEST_F(Render, HiddenEdgesAreNotDrawn) {
  Mesh mesh = square();
  const std::size_t first = mesh.positions_m.size();
  for (const Eigen::Vector3f& p : {Eigen::Vector3f(-3, -3, 0.5f), Eigen::Vector3f(3, -3, 0.5f),
                                   Eigen::Vector3f(3, 3, 0.5f), Eigen::Vector3f(-3, 3, 0.5f)})
    mesh.positions_m.push_back(p);
  const auto base = std::uint32_t(first);
  mesh.triangles.push_back({base, base + 1, base + 2});
  mesh.triangles.push_back({base, base + 2, base + 3});
  EXPECT_FALSE(is_yellow(draw(mesh, {.show_boundary = true}).at(20, 50))) << "behind a wall";
  EXPECT_TRUE(is_yellow(render(mesh, back_camera(), {.show_boundary = true}, context_).at(20, 50))) << "before it";
}

TEST_F(Render, EdgesOfSurfacesLookedThroughAreNotDrawn) {
  Mesh mesh = square();
  for (Triangle& t : mesh.triangles) std::swap(t[1], t[2]);
  const ColorImage image = draw(mesh, {.cull_backfaces = true, .show_boundary = true, .background = {9, 9, 9}});
  for (const Rgb8 c : image.pixels) ASSERT_EQ(c, (Rgb8{9, 9, 9}));
}

TEST_F(Render, FaultyEdgesAreCyan) {
  Mesh fin = square();
  fin.positions_m.emplace_back(0.9f, -0.9f, 0.4f);
  fin.triangles.push_back({0, 2, 4});  // a third triangle at the diagonal
  EXPECT_TRUE(is_cyan(draw(fin, {.show_boundary = true}).at(45, 55)));
  Mesh twisted = square();
  std::swap(twisted.triangles[1][1], twisted.triangles[1][2]);
  EXPECT_TRUE(is_cyan(draw(twisted, {.show_boundary = true}).at(45, 55)));
}

TEST_F(Render, WireframeDrawsTheDiagonal) {
  const ColorImage plain = draw(square(), {}),
                   wired = draw(square(), {.show_wireframe = true, .wireframe_width_px = 2});
  EXPECT_LT(wired.at(45, 55).r, plain.at(45, 55).r - 60);
  EXPECT_EQ(wired.at(60, 70), plain.at(60, 70));
}

TEST_F(Render, SmoothNormalsHideTheFacets) {
  Mesh roof;  // two slopes that meet at x = 0
  roof.positions_m = {{-1, -1, 0}, {0, -1, 0.7f}, {0, 1, 0.7f}, {-1, 1, 0}, {1, -1, 0}, {1, 1, 0}};
  roof.triangles = {{0, 1, 2}, {0, 2, 3}, {1, 4, 5}, {1, 5, 2}};
  const auto step_at_ridge = [&](bool smooth) {
    const ColorImage image = draw(roof, {.smooth_normals = smooth});
    return image.at(47, 50).r - image.at(30, 50).r;
  };
  // On one flat slope only the direction to the camera changes; smooth normals also turn towards it at the ridge.
  EXPECT_GT(step_at_ridge(true), step_at_ridge(false) + 10);
}

TEST_F(Render, PicturesOfASensorsOwnView) {
  RenderCamera camera;
  camera.sensor = SphericalSensor::from_limits(64, 32, -std::numbers::pi, std::numbers::pi, std::numbers::pi / 2,
                                               -std::numbers::pi / 2);
  // The square lies before the scanner at azimuth 0, elevation 0; its front (+z) turned to −x.
  Mesh mesh = square();
  for (Eigen::Vector3f& p : mesh.positions_m) p = Eigen::Vector3f(1.0f, -p.x(), p.y());
  const RenderOptions options{.background = {0, 0, 0}};
  const ColorImage image = render(mesh, camera, options, context_);
  EXPECT_EQ(image.width, 64);
  EXPECT_EQ(image.height, 32);
  EXPECT_GT(image.at(32, 16).r, 120);
  EXPECT_EQ(image.at(0, 16).r, 0);
  // The same view, twice as large.
  camera.width = 128, camera.height = 64;
  const ColorImage large = render(mesh, camera, options, context_);
  EXPECT_EQ(large.width, 128);
  EXPECT_GT(large.at(64, 32).r, 120);
  for (int u = 0; u < 128; ++u) EXPECT_EQ(large.at(u, 32).r > 60, image.at(u / 2, 16).r > 60 && u >= 48 && u < 80) << u;
}

TEST_F(Render, OrthographicSensor) {
  RenderCamera camera;
  camera.sensor =
      OrthographicSensor{.width = 40, .height = 40, .pitch_x_m = 0.1, .pitch_y_m = 0.1, .cx = 19.5, .cy = 19.5};
  camera.T_world_camera.linear() = Eigen::Vector3d(1, -1, -1).asDiagonal();
  camera.T_world_camera.translation() = Eigen::Vector3d(0, 0, 5);
  const ColorImage image = render(square(), camera, {.samples_per_side = 2, .background = {0, 0, 0}}, context_);
  int covered = 0;
  for (const Rgb8 c : image.pixels) covered += c.r > 100;
  EXPECT_EQ(covered, 400);
}

TEST_F(Render, FarFromTheWorldOriginIsTheSamePicture) {
  const Mesh near = square();
  Mesh far = near;
  far.origin_m = {512000, 4096000, 128};
  RenderCamera camera = front_camera();
  const ColorImage expected = render(near, camera, {.show_boundary = true, .show_wireframe = true}, context_);
  camera.T_world_camera.translation() += far.origin_m;
  EXPECT_EQ(render(far, camera, {.show_boundary = true, .show_wireframe = true}, context_).pixels, expected.pixels);
}

TEST_F(Render, SameBytesForAnyNumberOfThreads) {
  Mesh mesh;  // a crumpled sheet
  for (int v = 0; v < 40; ++v)
    for (int u = 0; u < 40; ++u)
      mesh.positions_m.emplace_back(0.05f * float(u) - 1, 0.05f * float(v) - 1, 0.1f * float((u * 17 + v * 29) % 7));
  for (std::uint32_t v = 0; v + 1 < 40; ++v)
    for (std::uint32_t u = 0; u + 1 < 40; ++u) {
      if ((u * v) % 13 == 5) continue;
      const std::uint32_t a = v * 40 + u;
      mesh.triangles.push_back({a, a + 1, a + 41});
      mesh.triangles.push_back({a, a + 41, a + 40});
      mesh.triangle_view.insert(mesh.triangle_view.end(), {u / 10, v / 10});
    }
  const RenderOptions options{
      .mode = RenderMode::kProvenance, .smooth_normals = true, .show_boundary = true, .show_wireframe = true};
  Context one(1);
  const ColorImage expected = render(mesh, front_camera(), options, one);
  for (const int threads : {2, 3, 8}) {
    Context context(threads);
    EXPECT_EQ(render(mesh, front_camera(), options, context).pixels, expected.pixels) << threads;
  }
}

TEST_F(Render, RefusesWhatTheMeshCannotShow) {
  const Mesh plain = square();
  for (const RenderMode mode : {RenderMode::kTextured, RenderMode::kColors, RenderMode::kProvenance})
    EXPECT_THROW(draw(plain, {.mode = mode}), InvalidInput);
  EXPECT_THROW(draw(plain, {.samples_per_side = 0}), InvalidInput);
  EXPECT_THROW(draw(plain, {.boundary_width_px = -1}), InvalidInput);
  Mesh broken = plain;
  broken.triangle_page = {0, 0};
  EXPECT_THROW(draw(broken, {.mode = RenderMode::kTextured}), InvalidInput);
  RenderCamera huge = front_camera();
  huge.width = huge.height = 60000;
  EXPECT_THROW(render(plain, huge, {}, context_), InvalidInput);
}

TEST_F(Render, EmptyMeshIsAllBackground) {
  const ColorImage image = draw(Mesh{}, {.show_boundary = true, .background = {7, 8, 9}});
  for (const Rgb8 c : image.pixels) ASSERT_EQ(c, (Rgb8{7, 8, 9}));
}

}  // namespace
}  // namespace lapseam
