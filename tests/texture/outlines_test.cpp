// Where sheets are cut, and how their outlines are squeezed out of blocks.

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "lapseam/context.h"
#include "support/painted_views.h"
#include "texture/charts.h"
#include "texture/squeeze_outlines.h"

namespace lapseam {
namespace {

constexpr int kSize_px = 400;
constexpr double kFocal_px = 200, kDistance_m = 2;  // 100 pixels a metre

/// A rectangle in pixels of the camera at the origin, of triangles about `step_px` wide.
void append_rectangle(Mesh& mesh, double u0, double v0, double u1, double v1, double step_px) {
  const auto at = [](double u, double v) {
    const double middle = 0.5 * (kSize_px - 1);
    return Eigen::Vector3d((u - middle) * kDistance_m / kFocal_px, (v - middle) * kDistance_m / kFocal_px, kDistance_m);
  };
  test::append_patch(mesh, at(u0, v0), at(u0, v1) - at(u0, v0), at(u1, v0) - at(u0, v0),
                     std::max(1, int(std::max(u1 - u0, v1 - v0) / step_px)));
}

class Outlines : public testing::Test {
 protected:
  Layout lay_out() {
    mesh_.origin_m.setZero();
    view_.assign(mesh_.triangle_count(), 0);
    return project_frames(mesh_, cameras_, view_, view_, context_);
  }

  std::vector<Chart> charts_of(const Layout& layout) {
    const std::vector<float> scale(mesh_.triangle_count(), 1);
    return make_charts(layout, view_, scale, {}, 512, context_).charts;
  }
  std::size_t owned_blocks(const Layout& layout) {
    std::size_t blocks = 0;
    for (const Chart& chart : charts_of(layout))
      blocks += std::size_t(std::count(chart.shape.used.begin(), chart.shape.used.end(), 1));
    return blocks;
  }

  std::vector<ViewSource> sources_ = {test::painted_source(
      "front", test::small_camera(kSize_px, kFocal_px), Eigen::Isometry3d::Identity(),
      test::rectangle(kDistance_m, -9, 9, -9, 9), [](const Eigen::Vector3d&) { return Eigen::Vector3d(99, 99, 99); })};
  const ColorCameras cameras_ = make_color_cameras(sources_, Eigen::Vector3d::Zero());
  Mesh mesh_;
  std::vector<std::uint32_t> view_;
  Context context_{2};
};

double twice_area(const Corners& p) {
  const Eigen::Vector2f ab = p[1] - p[0], ac = p[2] - p[0];
  return double(ab.x() * ac.y() - ab.y() * ac.x());
}

// 98 pixels and the four that lookups read beyond either side are 13 blocks and two pixels, whatever the phase.
TEST_F(Outlines, TwoPixelsAreSqueezedOutOfARowOfBlocks) {
  append_rectangle(mesh_, 101, 103, 199, 201, 7);
  const Layout before = lay_out();
  Layout after = before;
  squeeze_outlines(mesh_, cameras_, view_, after, context_);
  EXPECT_EQ(owned_blocks(before), 14u * 14u);
  EXPECT_EQ(owned_blocks(after), 13u * 13u);
  std::size_t copies = 0;
  for (std::size_t i = 0; i < mesh_.triangle_count(); ++i) {
    const double ratio = twice_area(after.pixels[i]) / twice_area(before.pixels[i]);
    EXPECT_GT(ratio, 0.5) << "turned over or too small";
    EXPECT_LT(ratio, 1.2);
    const bool is_moved = after.pixels[i] != before.pixels[i];
    EXPECT_EQ(after.is_resampled[i] != 0, is_moved) << "others must stay copies of the image";
    copies += !is_moved;
  }
  EXPECT_GT(double(copies), 0.5 * double(mesh_.triangle_count()));
}

// 103 pixels and the eight around them are 13 blocks and seven pixels: to press so much together would cost more than
// the blocks.
TEST_F(Outlines, WhatReachesFarIntoBlocksStays) {
  append_rectangle(mesh_, 101, 103, 204, 206, 7);
  const Layout before = lay_out();
  Layout after = before;
  squeeze_outlines(mesh_, cameras_, view_, after, context_);
  EXPECT_EQ(owned_blocks(before), 14u * 14u);
  for (std::size_t i = 0; i < mesh_.triangle_count(); ++i) EXPECT_TRUE(after.pixels[i] == before.pixels[i]);
}

TEST_F(Outlines, AnAngleIsCutAndASquareIsNot) {
  append_rectangle(mesh_, 20, 20, 320, 60, 8);
  append_rectangle(mesh_, 20, 60, 60, 320, 8);
  Layout angle = lay_out();
  ASSERT_EQ(angle.frame.size(), 1u);
  const Layout before = angle;
  cut_sheets(angle, 512, context_);
  EXPECT_GE(angle.frame.size(), 2u);
  EXPECT_TRUE(angle.pixels == before.pixels) << "cuts move nothing";
  std::size_t boxes = 0;
  for (const Chart& chart : charts_of(angle)) boxes += std::size_t(chart.shape.width * chart.shape.height);
  EXPECT_LE(double(boxes), 1.1 * double(owned_blocks(before))) << "hardly a bay is left";
  EXPECT_LE(double(owned_blocks(angle)), 1.1 * double(owned_blocks(before)));

  mesh_ = {};
  append_rectangle(mesh_, 20, 20, 320, 320, 8);
  Layout square = lay_out();
  cut_sheets(square, 512, context_);
  EXPECT_EQ(square.frame.size(), 1u);
}

}  // namespace
}  // namespace lapseam
