#include "sew/edge_set.h"

#include <gtest/gtest.h>

#include <random>
#include <set>

namespace lapseam {
namespace {

TEST(EdgeSet, HoldsWhatWasAdded) {
  EdgeSet edges;
  Context context;
  std::set<std::uint64_t> expected;
  std::mt19937_64 random(1);
  EXPECT_FALSE(edges.contains(0));
  for (int round = 0; round < 40; ++round) {
    std::vector<std::uint64_t> keys(random() % 50);
    for (std::uint64_t& key : keys) key = random() % 3000;
    expected.insert(keys.begin(), keys.end());
    edges.add(keys, context);
  }
  for (std::uint64_t key = 0; key < 3000; ++key) EXPECT_EQ(edges.contains(key), expected.contains(key)) << key;
  edges.clear();
  EXPECT_FALSE(edges.contains(*expected.begin()));
}

}  // namespace
}  // namespace lapseam
