// A texture lookup at any point of any triangle, in mip levels 0 to 3, must find colours of that triangle's image only.

#include <gtest/gtest.h>

#include <cmath>

#include "lapseam/context.h"
#include "lapseam/texture.h"
#include "support/painted_views.h"

namespace lapseam {
namespace {

// A room of six walls; every wall has a checkerboard in two shades of a colour of its own, of which at least one
// channel is absent: 0 red, 1 green, 2 blue, 3 yellow, 4 cyan, 5 magenta.
const Eigen::Vector3d kLow(-1, -1.2, -0.9), kHigh(1, 1.2, 0.9);

int wall_of(const Eigen::Vector3d& p) {
  int wall = 0;
  double nearest = 1e9;
  for (int axis = 0; axis < 3; ++axis)
    for (int side = 0; side < 2; ++side) {
      const double off = std::abs(p[axis] - (side ? kHigh[axis] : kLow[axis]));
      if (off < nearest) nearest = off, wall = 2 * axis + side;
    }
  return wall;
}

Eigen::Vector3d hue_of(int wall) {
  const Eigen::Vector3d hues[6] = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}, {1, 1, 0}, {0, 1, 1}, {1, 0, 1}};
  return hues[wall];
}

Eigen::Vector3d checkerboard(const Eigen::Vector3d& p) {
  const int wall = wall_of(p);
  int cells = 0;
  for (int axis = 0; axis < 3; ++axis)
    if (axis != wall / 2) cells += int(std::floor(p[axis] * 7 + 100));
  return hue_of(wall) * (cells % 2 == 0 ? 220 : 120);
}

ColorImage half_size(const ColorImage& in) {
  ColorImage out((in.width + 1) / 2, (in.height + 1) / 2);
  for (int v = 0; v < out.height; ++v)
    for (int u = 0; u < out.width; ++u) {
      int sum[3] = {0, 0, 0};
      for (int k = 0; k < 4; ++k) {
        const Rgb8 c = in.at(std::min(2 * u + k % 2, in.width - 1), std::min(2 * v + k / 2, in.height - 1));
        sum[0] += c.r, sum[1] += c.g, sum[2] += c.b;
      }
      out.at(u, v) = {std::uint8_t((sum[0] + 2) / 4), std::uint8_t((sum[1] + 2) / 4), std::uint8_t((sum[2] + 2) / 4)};
    }
  return out;
}

Eigen::Vector3d sample_bilinear(const ColorImage& page, const Eigen::Vector2d& uv) {
  const double x = std::clamp(uv.x() * page.width - 0.5, 0.0, page.width - 1.0);
  const double y = std::clamp(uv.y() * page.height - 0.5, 0.0, page.height - 1.0);
  const int x0 = int(x), y0 = int(y), x1 = std::min(x0 + 1, page.width - 1), y1 = std::min(y0 + 1, page.height - 1);
  const auto at = [&](int u, int v) {
    const Rgb8 c = page.at(u, v);
    return Eigen::Vector3d(c.r, c.g, c.b);
  };
  return (1 - (y - y0)) * ((1 - (x - x0)) * at(x0, y0) + (x - x0) * at(x1, y0)) +
         (y - y0) * ((1 - (x - x0)) * at(x0, y1) + (x - x0) * at(x1, y1));
}

// One camera for each wall, which is its whole image: no image holds another wall's colours, so any that are found have
// bled from another chart, or from the background of the page.
std::vector<ViewSource> cameras_at_walls() {
  std::vector<ViewSource> sources;
  for (int wall = 0; wall < 6; ++wall) {
    Eigen::Vector3d target = Eigen::Vector3d::Zero();
    target[wall / 2] = wall % 2 ? kHigh[wall / 2] : kLow[wall / 2];
    const test::Paint paint = [wall](const Eigen::Vector3d& p) -> Eigen::Vector3d {
      return wall_of(p) == wall ? checkerboard(p) : hue_of(wall) * 170;
    };
    sources.push_back(test::painted_source("wall" + std::to_string(wall), test::small_camera(301, 90),
                                           test::look_at({0.05, 0.02, 0.03}, target), test::box_room(kLow, kHigh),
                                           paint));
  }
  return sources;
}

// wall: whose hue each triangle has.
void expect_no_foreign_colors(const Mesh& mesh, const std::vector<std::uint32_t>& wall) {
  std::vector<ColorImage> level = mesh.pages;
  for (int mip = 0; mip <= 3; ++mip) {
    std::uint64_t samples = 0;
    for (std::size_t i = 0; i < mesh.triangle_count(); ++i) {
      const ColorImage& page = level[mesh.triangle_page[i]];
      for (int a = 0; a <= 8; ++a)
        for (int b = 0; a + b <= 8; ++b) {
          const auto& uv = mesh.texcoords[i];
          const Eigen::Vector2d at =
              ((8 - a - b) * uv[0].cast<double>() + a * uv[1].cast<double>() + b * uv[2].cast<double>()) / 8;
          const Eigen::Vector3d found = sample_bilinear(page, at);
          const Eigen::Vector3d hue = hue_of(int(wall[i]));
          for (int c = 0; c < 3; ++c) {
            if (hue[c] > 0)
              ASSERT_GT(found[c], 118) << "background at mip level " << mip << ", triangle " << i;
            else
              ASSERT_LT(found[c], 1) << "foreign colour at mip level " << mip << ", triangle " << i;
          }
          ++samples;
        }
    }
    EXPECT_GT(samples, 10'000u);
    for (ColorImage& page : level) page = half_size(page);
  }
}

TEST(Bleeding, NoForeignColorAtChartBordersOfACheckerboardRoomDownToMipLevel3) {
  Mesh mesh = test::room_mesh(kLow, kHigh, 12);
  for (std::size_t i = 0; i < mesh.triangle_count(); ++i)
    mesh.triangle_view.push_back(
        std::uint32_t(wall_of(((mesh.positions_m[mesh.triangles[i][0]] + mesh.positions_m[mesh.triangles[i][1]] +
                                mesh.positions_m[mesh.triangles[i][2]]) /
                               3)
                                  .cast<double>())));
  const std::vector<std::uint32_t> wall = mesh.triangle_view;
  std::vector<ViewSource> sources = cameras_at_walls();
  Context context(2);
  const TextureReport report =
      texture(mesh, sources, {.page_size = 512, .equalize = false, .level = false, .choose = false}, context);
  ASSERT_EQ(report.unseen_triangles, 0u);
  ASSERT_EQ(report.retaken_triangles, 0u) << "each wall must show its own image";
  ASSERT_GE(report.charts, 6u);
  expect_no_foreign_colors(mesh, wall);
}

// Rectangles side by side in one image, of all widths and heights between two numbers of blocks: their outlines reach a
// few pixels into blocks, and are squeezed out of them.
TEST(Bleeding, NoForeignColorWhereOutlinesAreSqueezed) {
  constexpr double kWide_m = 0.62, kPitch_m = 1.0;  // 62 pixels and more, 38 or less between
  const auto size_of = [](int k) { return Eigen::Vector2d(kWide_m + 0.01 * (k % 8), kWide_m + 0.01 * (3 * k % 8)); };
  const auto place_of = [](int k) {
    return Eigen::Vector2d((k % 4 - 2) * kPitch_m + 0.1, (k / 4 - 1) * kPitch_m + 0.1);
  };
  Mesh mesh;
  std::vector<std::uint32_t> wall;
  std::vector<test::Shape> shapes;
  for (int k = 0; k < 8; ++k) {
    const Eigen::Vector2d at = place_of(k), size = size_of(k);
    test::append_patch(mesh, {at.x(), at.y(), 2}, {0, size.y(), 0}, {size.x(), 0, 0}, 12);
    wall.resize(mesh.triangle_count(), std::uint32_t(k % 6));
    // What the camera sees goes on a little: its pixels at the rim are not half background.
    const Eigen::Vector2d low = at.array() - 0.05, high = (at + size).array() + 0.05;
    shapes.push_back(test::rectangle(2, low.x(), high.x(), low.y(), high.y()));
  }
  mesh.triangle_view.assign(mesh.triangle_count(), 0);
  const test::Paint paint = [&](const Eigen::Vector3d& p) -> Eigen::Vector3d {
    const int column = int(std::floor(p.x() / kPitch_m)) + 2, row = int(std::floor(p.y() / kPitch_m)) + 1;
    const bool is_light = (int(std::floor(p.x() * 7 + 100)) + int(std::floor(p.y() * 7 + 100))) % 2 == 0;
    return hue_of((4 * row + column) % 6) * (is_light ? 220 : 120);
  };
  const std::vector<ViewSource> sources = {test::painted_source(
      "front", test::small_camera(450, 200), Eigen::Isometry3d::Identity(), test::nearest(shapes), paint)};
  Context context(2);
  Mesh as_it_is = mesh;
  const TextureReport copied =
      texture(as_it_is, sources, {.page_size = 512, .equalize = false, .level = false, .choose = false}, context);
  const TextureReport squeezed = texture(mesh, sources, {.page_size = 512, .equalize = false, .level = false}, context);
  EXPECT_EQ(squeezed.charts, 8u);
  EXPECT_LT(double(squeezed.chart_pixels), 0.95 * double(copied.chart_pixels)) << "nothing was squeezed";
  expect_no_foreign_colors(mesh, wall);
}

}  // namespace
}  // namespace lapseam
