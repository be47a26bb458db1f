#include "health/predicates.h"

#include <gtest/gtest.h>
#include <Eigen/Geometry>

#include <random>

namespace lapseam {
namespace {

__extension__ typedef __int128 Int;
using Point = std::array<std::int64_t, 3>;

int sign_of(Int x) { return (x > 0) - (x < 0); }

int orient3d_by_integers(const Point& a, const Point& b, const Point& c, const Point& d) {
  Int m[3][3];
  for (std::size_t k = 0; k < 3; ++k) m[0][k] = b[k] - a[k], m[1][k] = c[k] - a[k], m[2][k] = d[k] - a[k];
  return sign_of(m[0][0] * (m[1][1] * m[2][2] - m[1][2] * m[2][1]) - m[0][1] * (m[1][0] * m[2][2] - m[1][2] * m[2][0]) +
                 m[0][2] * (m[1][0] * m[2][1] - m[1][1] * m[2][0]));
}

Eigen::Vector3f to_float(const Point& p) { return {float(p[0]), float(p[1]), float(p[2])}; }

TEST(Predicates, orient3d_is_exact_where_doubles_are_not) {
  // Four points of 24-bit integers close to one plane: the determinant has 75 bits, doubles have 53.
  std::mt19937_64 random(7);
  std::uniform_int_distribution<std::int64_t> coordinate(-(1 << 23), 1 << 23), small(-1, 1);
  int zeros = 0, rounding_is_wrong = 0;
  for (int i = 0; i < 20000; ++i) {
    Point a, b, c, d;
    for (std::size_t k = 0; k < 3; ++k) {
      a[k] = coordinate(random), b[k] = coordinate(random);
      c[k] = a[k] + (b[k] - a[k]) / 2 + small(random);
      d[k] = a[k] + (b[k] - a[k]) / 4 + (c[k] - a[k]) / 4 + small(random);
    }
    const int expected = orient3d_by_integers(a, b, c, d);
    const Eigen::Vector3f fa = to_float(a), fb = to_float(b), fc = to_float(c), fd = to_float(d);
    ASSERT_EQ(orient3d(fa, fb, fc, fd), expected);
    const Eigen::Vector3f naive = (fb - fa).cross(fc - fa);
    const float by_floats = naive.dot(fd - fa);
    rounding_is_wrong += ((by_floats > 0) - (by_floats < 0)) != expected;
    zeros += expected == 0;
  }
  EXPECT_GT(rounding_is_wrong, 1000) << "the cases must be hard, or the test proves nothing";
  EXPECT_LT(zeros, 20000);
}

TEST(Predicates, orient3d_sees_one_unit_in_the_last_place) {
  const Eigen::Vector3f a(0.1f, 0.1f, 0.1f), b(0.7f, 0.1f, 0.1f), c(0.1f, 0.9f, 0.1f);
  EXPECT_EQ(orient3d(a, b, c, {0.3f, 0.3f, 0.1f}), 0);
  EXPECT_EQ(orient3d(a, b, c, {0.3f, 0.3f, std::nextafter(0.1f, 1.f)}), 1);
  EXPECT_EQ(orient3d(a, b, c, {0.3f, 0.3f, std::nextafter(0.1f, 0.f)}), -1);
}

TEST(Predicates, magnitudes_that_differ_by_thirty_orders) {
  // d lies above the plane z = 0 by less than any difference to the large coordinates can hold.
  const Eigen::Vector3f a(-1e15f, -1e15f, 0), b(1e15f, -1e15f, 0), c(0, 1e15f, 0);
  EXPECT_EQ(orient3d(a, b, c, {0, 0, 1e-15f}), 1);
  EXPECT_EQ(orient3d(a, b, c, {0, 0, -1e-15f}), -1);
  EXPECT_EQ(orient3d(a, b, c, {1e-15f, 3, 0}), 0);
}

TEST(Predicates, orient2d_is_exact) {
  std::mt19937_64 random(3);
  std::uniform_int_distribution<std::int64_t> coordinate(-(1 << 23), 1 << 23), small(-1, 1);
  for (int i = 0; i < 20000; ++i) {
    std::array<std::int64_t, 2> a, b, c;
    for (std::size_t k = 0; k < 2; ++k) {
      a[k] = coordinate(random), b[k] = coordinate(random);
      c[k] = a[k] + (b[k] - a[k]) / 3 + small(random);
    }
    const Int expected = Int(b[0] - a[0]) * (c[1] - a[1]) - Int(b[1] - a[1]) * (c[0] - a[0]);
    ASSERT_EQ(orient2d({float(a[0]), float(a[1])}, {float(b[0]), float(b[1])}, {float(c[0]), float(c[1])}),
              sign_of(expected));
  }
}

TEST(Predicates, dominant_plane_is_none_for_collinear_points) {
  EXPECT_EQ(dominant_plane({0, 0, 0}, {1, 0, 0}, {0, 1, 0}), 2);
  EXPECT_EQ(dominant_plane({0, 0, 0}, {0, 1, 0}, {0, 0, 1}), 0);
  EXPECT_EQ(dominant_plane({0, 0, 0}, {1, 2, 3}, {3, 6, 9}), -1);
  EXPECT_EQ(dominant_plane({1, 1, 1}, {1, 1, 1}, {3, 6, 9}), -1);
}

}  // namespace
}  // namespace lapseam
