#include "texture/packing.h"

#include <gtest/gtest.h>

#include <numeric>
#include <random>

#include "lapseam/context.h"

namespace lapseam {
namespace {

BlockShape random_shape(std::mt19937& random, int largest) {
  std::uniform_int_distribution<int> size(1, largest), coin(0, 3);
  BlockShape shape{size(random), size(random), {}};
  shape.used.resize(std::size_t(shape.width * shape.height));
  for (std::uint8_t& block : shape.used) block = coin(random) != 0;
  for (int x = 0; x < shape.width; ++x) shape.used[std::size_t(x)] = 1;  // shapes reach their boxes' sides
  for (int y = 0; y < shape.height; ++y) {
    shape.used[std::size_t(y * shape.width)] = 1;
    shape.used[std::size_t(y * shape.width + shape.width - 1)] = 1;
  }
  for (int x = 0; x < shape.width; ++x) shape.used[std::size_t((shape.height - 1) * shape.width + x)] = 1;
  return shape;
}

// Counts how often each block of each page is used.
void expect_disjoint(const std::vector<BlockShape>& shapes, const Packing& packing, int width, int height) {
  std::vector<std::vector<int>> uses(packing.pages.size(), std::vector<int>(std::size_t(width * height), 0));
  for (std::size_t i = 0; i < shapes.size(); ++i) {
    const BlockPlace& place = packing.places[i];
    ASSERT_LT(std::size_t(place.page), packing.pages.size());
    const BlockPage& page = packing.pages[std::size_t(place.page)];
    for (int y = 0; y < shapes[i].height; ++y)
      for (int x = 0; x < shapes[i].width; ++x) {
        const auto [u, v] = turn(x, y, shapes[i].width, shapes[i].height, place.turns);
        ASSERT_TRUE(u >= 0 && v >= 0 && place.x + u < page.width && place.y + v < page.height);
        if (shapes[i].used[std::size_t(y * shapes[i].width + x)])
          ++uses[std::size_t(place.page)][std::size_t((place.y + v) * width + place.x + u)];
      }
  }
  for (const auto& page : uses)
    for (const int count : page) ASSERT_LE(count, 1);
}

TEST(Packing, ShapesDoNotMeetAndStayOnTheirPages) {
  Context context(1);
  std::mt19937 random(5);
  for (const int width : {20, 63, 64, 65, 130}) {
    std::vector<BlockShape> shapes;
    for (int i = 0; i < 200; ++i) shapes.push_back(random_shape(random, 19));
    const Packing packing = pack_blocks(shapes, width, 40, context);
    for (const BlockPage& page : packing.pages) {
      EXPECT_LE(page.width, width);
      EXPECT_LE(page.height, 40);
    }
    expect_disjoint(shapes, packing, width, 40);
  }
}

TEST(Packing, ShapesAreTurnedWhereTheyFitBetter) {
  Context context(1);
  const BlockShape slab{8, 6, std::vector<std::uint8_t>(48, 1)}, upright{2, 8, std::vector<std::uint8_t>(16, 1)};
  const Packing packing = pack_blocks({slab, upright}, 8, 8, context);
  ASSERT_EQ(packing.pages.size(), 1u);  // the bar lies down
  EXPECT_EQ(packing.places[1].turns % 2, 1);
}

TEST(Packing, SquaresFillAPageWithoutGaps) {
  Context context(1);
  const std::vector<BlockShape> shapes(64, BlockShape{4, 4, std::vector<std::uint8_t>(16, 1)});
  const Packing packing = pack_blocks(shapes, 32, 32, context);
  ASSERT_EQ(packing.pages.size(), 1u);
  EXPECT_EQ(packing.pages[0].width, 32);
  EXPECT_EQ(packing.pages[0].height, 32);
}

TEST(Packing, SmallShapesLieInTheBaysOfLargeOnes) {
  Context context(1);
  BlockShape frame{10, 10, std::vector<std::uint8_t>(100, 1)};
  for (int y = 1; y < 9; ++y)
    for (int x = 1; x < 9; ++x) frame.used[std::size_t(10 * y + x)] = 0;
  const BlockShape square{8, 8, std::vector<std::uint8_t>(64, 1)};
  const Packing packing = pack_blocks({square, frame}, 10, 10, context);
  ASSERT_EQ(packing.pages.size(), 1u);
  EXPECT_EQ(packing.places[0].x, 1);
  EXPECT_EQ(packing.places[0].y, 1);
}

std::size_t area_of(const Packing& packing) {
  std::size_t area = 0;
  for (const BlockPage& page : packing.pages) area += std::size_t(page.width) * std::size_t(page.height);
  return area;
}

TEST(Packing, TighteningLowersPagesAndKeepsShapesApart) {
  Context context(1);
  std::mt19937 random(11);
  std::vector<BlockShape> shapes;
  for (int i = 0; i < 150; ++i) shapes.push_back(random_shape(random, 15));
  for (const int height : {400, 60}) {  // one page, several
    Packing packing = pack_blocks(shapes, 80, height, context);
    const std::vector<BlockPlace> before = packing.places;
    const std::size_t area = area_of(packing);
    tighten(shapes, packing, context);
    EXPECT_LT(area_of(packing), area);
    for (std::size_t i = 0; i < shapes.size(); ++i) EXPECT_EQ(packing.places[i].page, before[i].page);
    expect_disjoint(shapes, packing, 80, height);
  }
}

TEST(Packing, TighteningLeavesAFullPageAsItIs) {
  Context context(1);
  const std::vector<BlockShape> shapes(16, BlockShape{4, 4, std::vector<std::uint8_t>(16, 1)});
  Packing packing = pack_blocks(shapes, 16, 16, context);
  tighten(shapes, packing, context);
  ASSERT_EQ(packing.pages.size(), 1u);
  EXPECT_EQ(area_of(packing), 256u);
  expect_disjoint(shapes, packing, 16, 16);
}

}  // namespace
}  // namespace lapseam
