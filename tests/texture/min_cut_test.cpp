#include "texture/min_cut.h"

#include <gtest/gtest.h>

#include <limits>
#include <random>

namespace lapseam {
namespace {

struct Link {
  std::uint32_t a, b;
  double forward, backward;
};

double cost_of(unsigned labels, const std::vector<double>& cost, const std::vector<Link>& links) {
  const auto label = [&](std::uint32_t i) { return (labels >> i & 1u) != 0; };
  double sum = 0;
  for (std::uint32_t i = 0; i < cost.size(); ++i) sum += label(i) ? cost[i] : 0;
  for (const Link& link : links)
    sum += !label(link.a) && label(link.b) ? link.forward : label(link.a) && !label(link.b) ? link.backward : 0;
  return sum;
}

TEST(MinCut, FindsTheLeastOfAllLabellings) {
  std::mt19937 random(7);
  // Multiples of 1/64 are not rounded: sums can be compared exactly.
  const auto draw = [&](int low, int high) { return double(std::uniform_int_distribution(low, high)(random)) / 64; };
  for (int round = 0; round < 60; ++round) {
    const auto n = std::uint32_t(std::uniform_int_distribution(1, 9)(random));
    std::vector<double> cost(n);
    std::vector<Link> links;
    MinCut cut(n);
    for (std::uint32_t i = 0; i < n; ++i) cut.add_cost(i, cost[i] = draw(-300, 300));
    for (std::uint32_t a = 0; a < n; ++a)
      for (std::uint32_t b = a + 1; b < n; ++b) {
        if (draw(0, 2) > 0.02) continue;
        links.push_back({a, b, draw(0, 200), draw(0, 200)});
        cut.add_link(a, b, links.back().forward, links.back().backward);
      }
    double least = std::numeric_limits<double>::infinity();
    unsigned most_zeros = 0;
    for (unsigned labels = 0; labels < 1u << n; ++labels) {
      const double sum = cost_of(labels, cost, links);
      if (sum < least || (sum == least && __builtin_popcount(labels) < __builtin_popcount(most_zeros)))
        least = sum, most_zeros = labels;
    }
    const std::vector<std::uint8_t> label = cut.solve();
    unsigned found = 0;
    for (std::uint32_t i = 0; i < n; ++i) found |= unsigned(label[i]) << i;
    EXPECT_EQ(cost_of(found, cost, links), least) << "round " << round;
    EXPECT_EQ(found, most_zeros) << "round " << round;
  }
}

TEST(MinCut, WithoutNodesThereIsNothingToLabel) { EXPECT_TRUE(MinCut(0).solve().empty()); }

}  // namespace
}  // namespace lapseam
