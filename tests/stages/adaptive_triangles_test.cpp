#include "triangulate/adaptive_triangles.h"

#include <gtest/gtest.h>

#include <cmath>
#include <map>
#include <random>

namespace lapseam {
namespace {

const SampleDeviation kFlat = [](std::uint32_t, std::uint32_t, std::uint32_t, std::uint32_t) { return 0.0f; };

struct Covered {
  double area = 0;
  std::map<std::pair<std::uint32_t, std::uint32_t>, int> half_edges;
};

// Every triangle turns left with up being −v.
Covered measure(const std::vector<SampleTriangle>& triangles, int width) {
  Covered out;
  const auto w = std::uint32_t(width);
  for (const SampleTriangle& t : triangles) {
    const auto u = [&](std::size_t k) { return double(t[k % 3] % w); };
    const auto v = [&](std::size_t k) { return -double(t[k % 3] / w); };
    const double area = 0.5 * ((u(1) - u(0)) * (v(2) - v(0)) - (v(1) - v(0)) * (u(2) - u(0)));
    EXPECT_GT(area, 0);
    out.area += area;
    for (std::size_t k = 0; k < 3; ++k) ++out.half_edges[{t[k], t[(k + 1) % 3]}];
  }
  return out;
}

// Conforming: each edge is met by its opposite, or lies between a full cell and one that is not; those are one sample
// long.
void check_conforming(const Covered& covered, const Image<std::uint8_t>& is_full) {
  const auto w = std::uint32_t(is_full.width);
  double outline = 0;
  for (const auto& [edge, count] : covered.half_edges) {
    EXPECT_EQ(count, 1);
    if (covered.half_edges.count({edge.second, edge.first})) continue;
    const int du = int(edge.first % w) - int(edge.second % w), dv = int(edge.first / w) - int(edge.second / w);
    EXPECT_EQ(std::abs(du) + std::abs(dv), 1);
    outline += 1;
  }
  double expected = 0;
  const auto full = [&](int u, int v) {
    return u >= 0 && v >= 0 && u + 1 < is_full.width && v + 1 < is_full.height && is_full.at(u, v);
  };
  for (int v = 0; v < is_full.height; ++v)
    for (int u = 0; u < is_full.width; ++u)
      if (full(u, v))
        expected += int(!full(u - 1, v)) + int(!full(u + 1, v)) + int(!full(u, v - 1)) + int(!full(u, v + 1));
  EXPECT_EQ(outline, expected);
}

std::size_t full_cells(const Image<std::uint8_t>& is_full) {
  std::size_t count = 0;
  for (int v = 0; v + 1 < is_full.height; ++v)
    for (int u = 0; u + 1 < is_full.width; ++u) count += is_full.at(u, v) ? 1u : 0u;
  return count;
}

TEST(AdaptiveTriangles, FlatImagesOfAnySizeAreCoveredByFew) {
  Context context;
  for (const auto& [w, h] :
       {std::pair(80, 60), std::pair(33, 33), std::pair(65, 40), std::pair(2, 2), std::pair(31, 97)}) {
    const Image<std::uint8_t> all(w, h, 1);
    const auto triangles = adaptive_triangles(all, kFlat, context);
    const Covered covered = measure(triangles, w);
    EXPECT_EQ(covered.area, double((w - 1) * (h - 1)));
    check_conforming(covered, all);
    if (w > 60 && h > 50) {
      EXPECT_LT(double(triangles.size()), 0.5 * covered.area);
    }
  }
}

TEST(AdaptiveTriangles, RaggedRegionsAreCoveredExactly) {
  Context context;
  std::mt19937 random(3);
  Image<std::uint8_t> some(120, 90, 0);
  for (int v = 0; v < 90; ++v)
    for (int u = 0; u < 120; ++u) {
      const bool inside = std::hypot(u - 55, v - 40) < 38 && std::hypot(u - 70, v - 30) > 9;
      some.at(u, v) = inside && random() % 50 != 0;
    }
  const Covered covered = measure(adaptive_triangles(some, kFlat, context), 120);
  EXPECT_EQ(covered.area, double(full_cells(some)));
  check_conforming(covered, some);
}

TEST(AdaptiveTriangles, SplitsWhereTheSurfaceLeavesThePlane) {
  Context context;
  Image<std::uint8_t> all(97, 97, 1);
  const auto height = [](std::uint32_t i) {
    const double u = double(i % 97), v = double(i / 97);
    return 4 * std::exp(-((u - 40) * (u - 40) + (v - 50) * (v - 50)) / 60);
  };
  const SampleDeviation bump = [&](std::uint32_t a, std::uint32_t b, std::uint32_t, std::uint32_t m) {
    return float(std::abs(0.5 * (height(a) + height(b)) - height(m)) / 0.05);
  };
  const auto triangles = adaptive_triangles(all, bump, context);
  const Covered covered = measure(triangles, 97);
  EXPECT_EQ(covered.area, 96.0 * 96.0);
  check_conforming(covered, all);
  std::size_t near = 0, far = 0;
  for (const SampleTriangle& t : triangles) {
    const double r = std::hypot(double(t[0] % 97) - 40, double(t[0] / 97) - 50);
    near += r < 12;
    far += r > 24 && r < 27;
  }
  EXPECT_GT(near, 3 * far);
}

TEST(AdaptiveTriangles, NothingFullGivesNothing) {
  Context context;
  EXPECT_TRUE(adaptive_triangles(Image<std::uint8_t>(50, 50, 0), kFlat, context).empty());
  EXPECT_TRUE(adaptive_triangles(Image<std::uint8_t>(1, 1, 1), kFlat, context).empty());
}

}  // namespace
}  // namespace lapseam
