#include "sew/planar_triangulation.h"

#include <gtest/gtest.h>

#include <map>
#include <random>
#include <set>

namespace lapseam {
namespace {

std::int64_t doubled_area(const GridPoint& a, const GridPoint& b, const GridPoint& c) {
  return (std::int64_t(b.x) - a.x) * (std::int64_t(c.y) - a.y) - (std::int64_t(b.y) - a.y) * (std::int64_t(c.x) - a.x);
}

// Every face turns left, neighbours know each other and share two corners, and the faces fill their frame.
void check_topology(const PlanarTriangulation& plane) {
  std::int64_t area = 0;
  for (std::uint32_t f = 0; f < plane.faces().size(); ++f) {
    const auto& face = plane.faces()[f];
    const std::int64_t one =
        doubled_area(plane.point(face.corner[0]), plane.point(face.corner[1]), plane.point(face.corner[2]));
    ASSERT_GT(one, 0);
    area += one;
    for (std::size_t k = 0; k < 3; ++k) {
      if (face.neighbor[k] == PlanarTriangulation::kNone) continue;
      const auto& other = plane.faces()[face.neighbor[k]];
      std::size_t j = 0;
      while (j < 3 && other.neighbor[j] != f) ++j;
      ASSERT_LT(j, 3u);
      EXPECT_EQ(other.corner[(j + 1) % 3], face.corner[(k + 2) % 3]);
      EXPECT_EQ(other.corner[(j + 2) % 3], face.corner[(k + 1) % 3]);
      EXPECT_EQ(other.constrained >> j & 1, face.constrained >> k & 1);
    }
  }
  const std::int64_t far = 4 * std::int64_t(GridPoint::kLargest);
  EXPECT_EQ(area, 4 * far * far);
}

// No corner across an edge lies inside the circle around a face, unless the edge is a constraint.
void check_delaunay(const PlanarTriangulation& plane) {
  for (const auto& face : plane.faces()) {
    if (!plane.is_real(face)) continue;
    for (std::size_t k = 0; k < 3; ++k) {
      if (face.neighbor[k] == PlanarTriangulation::kNone || (face.constrained >> k & 1)) continue;
      const auto& other = plane.faces()[face.neighbor[k]];
      if (!plane.is_real(other)) continue;
      for (const std::uint32_t d : other.corner) {
        if (d == face.corner[0] || d == face.corner[1] || d == face.corner[2]) continue;
        const auto at = [&](std::uint32_t i) {
          return std::pair<long double, long double>(plane.point(i).x - plane.point(d).x,
                                                     plane.point(i).y - plane.point(d).y);
        };
        const auto [ax, ay] = at(face.corner[0]);
        const auto [bx, by] = at(face.corner[1]);
        const auto [cx, cy] = at(face.corner[2]);
        const long double a2 = ax * ax + ay * ay, b2 = bx * bx + by * by, c2 = cx * cx + cy * cy;
        EXPECT_LE(ax * (by * c2 - b2 * cy) - ay * (bx * c2 - b2 * cx) + a2 * (bx * cy - by * cx), 1e6L);
      }
    }
  }
}

std::vector<GridPoint> random_points(std::size_t count, int extent, unsigned seed) {
  std::mt19937 random(seed);
  std::uniform_int_distribution<std::int32_t> any(-extent, extent);
  std::vector<GridPoint> points(count);
  for (GridPoint& p : points) p = {any(random), any(random)};
  return points;
}

TEST(PlanarTriangulation, RandomPointsAreDelaunay) {
  const PlanarTriangulation plane(random_points(3000, 100000, 1));
  check_topology(plane);
  check_delaunay(plane);
}

TEST(PlanarTriangulation, GridsWithAllTheirTiesAreTriangulated) {
  std::vector<GridPoint> points;
  for (int y = 0; y < 40; ++y)
    for (int x = 0; x < 50; ++x) points.push_back({x * 1024, y * 1024});
  const PlanarTriangulation plane(points);
  check_topology(plane);
  check_delaunay(plane);
  for (std::uint32_t i = 0; i < points.size(); ++i) EXPECT_TRUE(plane.is_in(i));
}

TEST(PlanarTriangulation, PointsAtOnePlaceAreInOnce) {
  const PlanarTriangulation plane({{0, 0}, {10, 0}, {0, 10}, {10, 0}});
  EXPECT_EQ(int(plane.is_in(1)) + int(plane.is_in(3)), 1);
  check_topology(plane);
}

TEST(PlanarTriangulation, ConstraintsBecomeEdgesOrAreRefused) {
  std::mt19937 random(5);
  const auto points = random_points(800, 3000, 2);
  PlanarTriangulation plane(points);
  std::uniform_int_distribution<std::uint32_t> any(0, 799);
  std::set<std::pair<std::uint32_t, std::uint32_t>> made;
  int refused = 0;
  for (int i = 0; i < 1500; ++i) {
    const std::uint32_t a = any(random), b = any(random);
    if (std::abs(points[a].x - points[b].x) + std::abs(points[a].y - points[b].y) > 900) continue;
    if (plane.constrain(a, b))
      made.insert({a, b});
    else
      ++refused;
  }
  check_topology(plane);
  check_delaunay(plane);
  EXPECT_GT(made.size(), 50u);
  EXPECT_GT(refused, 5);
  for (const auto& [a, b] : made) {
    const std::uint32_t left = plane.face_left_of(a, b), right = plane.face_left_of(b, a);
    ASSERT_NE(left, PlanarTriangulation::kNone);
    ASSERT_NE(right, PlanarTriangulation::kNone);
    for (std::size_t k = 0; k < 3; ++k) {
      const auto& face = plane.faces()[left];
      if (face.corner[k] != a && face.corner[k] != b) {
        EXPECT_TRUE(face.constrained >> k & 1);
      }
    }
  }
}

TEST(PlanarTriangulation, ConstraintsNeitherCrossNorPassThroughPoints) {
  PlanarTriangulation plane({{0, 0}, {1000, 1000}, {0, 1000}, {1000, 0}, {300, 300}, {-500, 2000}});
  EXPECT_TRUE(plane.constrain(2, 3));
  EXPECT_FALSE(plane.constrain(4, 1));  // crosses 2–3
  EXPECT_FALSE(plane.constrain(0, 1));  // passes through 4
  EXPECT_TRUE(plane.constrain(0, 4));
  EXPECT_FALSE(plane.constrain(0, 0));
  check_topology(plane);
}

}  // namespace
}  // namespace lapseam
