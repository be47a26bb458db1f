#include "health/self_intersection.h"

#include <gtest/gtest.h>
#include <Eigen/Geometry>

#include <algorithm>
#include <cmath>
#include <set>
#include <vector>

#include "health/meshes.h"
#include "health/predicates.h"
#include "lapseam/context.h"

namespace lapseam {
namespace {

using Corners = std::array<Eigen::Vector3f, 3>;
using IntPoint = Eigen::Matrix<std::int64_t, 3, 1>;

const Corners kFloor = {Eigen::Vector3f(0, 0, 0), Eigen::Vector3f(4, 0, 0), Eigen::Vector3f(0, 4, 0)};

bool meets_floor(const Corners& other) {
  const bool meets = do_triangles_meet(kFloor, other);
  EXPECT_EQ(do_triangles_meet(other, kFloor), meets);
  return meets;
}

TEST(DoTrianglesMeet, crossing_touching_and_apart) {
  const float above = std::nextafter(0.f, 1.f);
  EXPECT_TRUE(meets_floor({{{1, 1, -1}, {1, 1, 1}, {9, 9, 0}}})) << "pierces";
  EXPECT_TRUE(meets_floor({{{1, 1, 0}, {1, 1, 1}, {9, 9, 1}}})) << "a corner on the face";
  EXPECT_FALSE(meets_floor({{{1, 1, above}, {1, 1, 1}, {9, 9, 1}}})) << "a hair above";
  EXPECT_TRUE(meets_floor({{{-1, 2, 0}, {5, 2, 0}, {2, 2, 5}}})) << "an edge across the face";
  EXPECT_TRUE(meets_floor({{{0, 0, 0}, {-1, 0, 1}, {-1, 0, -1}}})) << "corner on corner";
  EXPECT_TRUE(meets_floor({{{2, 0, 0}, {2, -1, 1}, {2, -1, -1}}})) << "corner on edge";
  EXPECT_FALSE(meets_floor({{{2, -above, 0}, {2, -1, 1}, {2, -1, -1}}}));
  EXPECT_FALSE(meets_floor({{{3, 3, -1}, {3, 3, 1}, {9, 9, 0}}})) << "passes the plane beside the face";
}

TEST(DoTrianglesMeet, coplanar) {
  EXPECT_TRUE(meets_floor({{{1, 1, 0}, {2, 1, 0}, {1, 2, 0}}})) << "inside";
  EXPECT_TRUE(meets_floor({{{-9, -9, 0}, {20, -9, 0}, {-9, 20, 0}}})) << "around";
  EXPECT_TRUE(meets_floor({{{-1, 1, 0}, {9, 1, 0}, {9, 1.5f, 0}}})) << "across, no corner inside";
  EXPECT_TRUE(meets_floor({{{4, 0, 0}, {5, 0, 0}, {5, 1, 0}}})) << "corner to corner";
  EXPECT_FALSE(meets_floor({{{3, 2, 0}, {4, 2, 0}, {3, 3, 0}}})) << "beside";
}

// Separating axes over integers: an independent and exact reference. Two compact convex sets are disjoint just when a
// facet normal of their Minkowski difference separates them strictly; the axes below are all the normals it can have.
bool are_separated(const std::vector<IntPoint>& a, const std::vector<IntPoint>& b, const IntPoint& axis) {
  if (axis.isZero()) return false;
  std::int64_t a_low = axis.dot(a[0]), a_high = a_low, b_low = axis.dot(b[0]), b_high = b_low;
  for (const IntPoint& p : a) a_low = std::min(a_low, axis.dot(p)), a_high = std::max(a_high, axis.dot(p));
  for (const IntPoint& p : b) b_low = std::min(b_low, axis.dot(p)), b_high = std::max(b_high, axis.dot(p));
  return a_high < b_low || b_high < a_low;
}

bool do_meet_by_axes(const std::vector<IntPoint>& a, const std::vector<IntPoint>& b) {
  std::vector<IntPoint> a_edges, b_edges, axes;
  for (std::size_t i = 0; i < a.size(); ++i) a_edges.push_back(a[(i + 1) % a.size()] - a[i]);
  for (std::size_t i = 0; i < b.size(); ++i) b_edges.push_back(b[(i + 1) % b.size()] - b[i]);
  for (const auto& [edges, others] : {std::pair{a_edges, b_edges}, std::pair{b_edges, a_edges}}) {
    const IntPoint normal = edges[0].cross(edges[1]);  // zero for a segment
    axes.push_back(normal);
    for (const IntPoint& e : edges) axes.push_back(normal.cross(e));
    for (const IntPoint& f : others) axes.push_back(normal.cross(f));
    for (const IntPoint& e : edges)
      for (const IntPoint& f : others) axes.push_back(e.cross(f));
  }
  return std::none_of(axes.begin(), axes.end(), [&](const IntPoint& axis) { return are_separated(a, b, axis); });
}

SelfIntersections count_by_brute_force(const Mesh& mesh) {
  std::vector<std::vector<IntPoint>> corners;
  for (const Triangle& t : mesh.triangles) {
    corners.emplace_back();
    for (const std::uint32_t v : t) corners.back().push_back(mesh.positions_m[v].cast<std::int64_t>());
  }
  const auto has_area = [&](std::size_t i) {
    return !(corners[i][1] - corners[i][0]).cross(corners[i][2] - corners[i][0]).isZero();
  };
  SelfIntersections result;
  std::set<std::size_t> meeting;
  for (std::size_t i = 0; i < corners.size(); ++i) {
    for (std::size_t j = i + 1; j < corners.size(); ++j) {
      if (!has_area(i) || !has_area(j)) continue;
      std::vector<IntPoint> i_rest, j_rest;
      for (std::size_t k = 0; k < 3; ++k) {
        const auto &t = mesh.triangles[i], &s = mesh.triangles[j];
        if (std::find(s.begin(), s.end(), t[k]) == s.end()) i_rest.push_back(corners[i][k]);
        if (std::find(t.begin(), t.end(), s[k]) == t.end()) j_rest.push_back(corners[j][k]);
      }
      bool meets = false;
      if (i_rest.size() == 3) meets = do_meet_by_axes(corners[i], corners[j]);
      if (i_rest.size() == 2) meets = do_meet_by_axes(i_rest, corners[j]) || do_meet_by_axes(j_rest, corners[i]);
      if (!meets) continue;
      result.pairs.push_back({std::uint32_t(i), std::uint32_t(j)});
      meeting.insert({i, j});
    }
  }
  result.triangles = meeting.size();
  return result;
}

class SelfIntersectionsOfSoup : public testing::TestWithParam<std::uint32_t> {};

TEST_P(SelfIntersectionsOfSoup, agree_with_separating_axes) {
  const std::uint32_t seed = GetParam();
  const Mesh mesh = test::lattice_soup(seed, 300, 2 + int(seed) * 2, 30 + 60 * seed);
  Context context;
  const SelfIntersections found = find_self_intersections(mesh.positions_m, mesh.triangles, context);
  const SelfIntersections expected = count_by_brute_force(mesh);
  EXPECT_EQ(found.pairs, expected.pairs);
  EXPECT_EQ(found.triangles, expected.triangles);
  EXPECT_GT(found.pairs.size(), 0u);
}

INSTANTIATE_TEST_SUITE_P(Seeds, SelfIntersectionsOfSoup, testing::Range(1u, 13u));

TEST(SelfIntersections, small_triangles_far_apart_are_sparse_and_all_found) {
  // Most boxes do not overlap, so this one goes deep into the tree.
  std::mt19937 random(11);
  std::uniform_int_distribution<int> place(-285, 285), offset(-30, 30);
  Mesh mesh;
  for (std::uint32_t i = 0; i < 900; ++i) {
    const Eigen::Vector3f center(float(place(random)), float(place(random)), float(place(random)));
    for (int k = 0; k < 3; ++k)
      mesh.positions_m.push_back(center +
                                 Eigen::Vector3f(float(offset(random)), float(offset(random)), float(offset(random))));
    mesh.triangles.push_back({3 * i, 3 * i + 1, 3 * i + 2});
  }
  Context context;
  const SelfIntersections found = find_self_intersections(mesh.positions_m, mesh.triangles, context);
  const SelfIntersections expected = count_by_brute_force(mesh);
  EXPECT_EQ(found.pairs, expected.pairs);
  EXPECT_EQ(found.triangles, expected.triangles);
  EXPECT_GT(found.pairs.size(), 20u);
  EXPECT_LT(found.triangles, 450u);
}

TEST(SelfIntersections, folded_grid_meets_itself_and_a_flat_one_does_not) {
  Mesh mesh = test::grid(20, 20);
  Context context;
  EXPECT_EQ(find_self_intersections(mesh.positions_m, mesh.triangles, context).pairs.size(), 0u);
  mesh.positions_m[21 * 10 + 10] += Eigen::Vector3f(3.25f, 0, 0);  // drags its six triangles over their neighbours
  EXPECT_GT(find_self_intersections(mesh.positions_m, mesh.triangles, context).pairs.size(), 6u);
}

}  // namespace
}  // namespace lapseam
