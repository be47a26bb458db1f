#include "mesh/edge_sides.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <random>
#include <set>

namespace lapseam {
namespace {

// Any triangles: edges of one, two and more of them.
std::vector<Triangle> random_triangles(std::uint32_t vertices, std::size_t count) {
  std::mt19937 random(3);
  std::vector<Triangle> triangles;
  while (triangles.size() < count) {
    const Triangle t = {std::uint32_t(random() % vertices), std::uint32_t(random() % vertices),
                        std::uint32_t(random() % vertices)};
    if (t[0] != t[1] && t[1] != t[2] && t[2] != t[0]) triangles.push_back(t);
  }
  return triangles;
}

using Edge = std::pair<std::uint32_t, std::uint32_t>;

std::map<Edge, std::vector<std::uint32_t>> corners_of_edges(const std::vector<Triangle>& triangles) {
  std::map<Edge, std::vector<std::uint32_t>> corners;
  for (std::uint32_t corner = 0; corner < 3 * triangles.size(); ++corner) {
    const Triangle& t = triangles[corner / 3];
    corners[std::minmax(t[corner % 3], t[(corner % 3 + 1) % 3])].push_back(corner);
  }
  return corners;
}

TEST(EdgeSides, AreDealtOutByTheLowerEndInTheOrderOfTriangles) {
  const std::vector<Triangle> triangles = random_triangles(30, 200);
  const EdgeSides sides(triangles, 31);  // the last vertex has none
  std::map<Edge, std::vector<std::uint32_t>> found;
  ASSERT_EQ(sides.vertices(), 31u);
  for (std::uint32_t v = 0; v < 31; ++v)
    for (const EdgeSides::Side& side : sides.at(v)) found[{v, side.higher}].push_back(side.corner);
  EXPECT_EQ(found, corners_of_edges(triangles));
  EXPECT_TRUE(sides.at(30).empty());
}

TEST(EdgeSides, PairsAreThoseThatFollowEachOtherAtAnEdge) {
  const std::vector<Triangle> triangles = random_triangles(30, 200);
  std::set<std::pair<std::uint32_t, std::uint32_t>> expected, found;
  for (const auto& [edge, corners] : corners_of_edges(triangles))
    for (std::size_t i = 0; i + 1 < corners.size(); ++i) expected.emplace(corners[i], corners[i + 1]);
  std::size_t visits = 0;
  EdgeSides(triangles, 30).for_each_pair([&](std::uint32_t p, std::uint32_t q) {
    found.emplace(p, q);
    ++visits;
  });
  EXPECT_EQ(found, expected);
  EXPECT_EQ(visits, expected.size());
}

}  // namespace
}  // namespace lapseam
