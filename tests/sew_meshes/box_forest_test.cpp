#include "sew_meshes/box_forest.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <random>

namespace lapseam {
namespace {

TEST(BoxForest, FindsWhatBruteForceFinds) {
  std::mt19937 random(5);
  std::uniform_real_distribution<float> place(0, 1), size(0, 0.1f);
  const auto box = [&] {
    Box out;
    out.low = {place(random), place(random), place(random)};
    out.high = out.low + Eigen::Vector3f(size(random), size(random), size(random));
    return out;
  };
  BoxForest forest;
  std::vector<BoxEntry> all;
  for (std::uint32_t i = 0; i < 300; ++i) all.push_back({box(), i});
  forest.add(all);
  for (int round = 0; round < 1000; ++round) {
    all.push_back({box(), std::uint32_t(all.size())});
    forest.add(all.back());
    if (round % 7) continue;
    const Box query = box();
    std::vector<std::uint32_t> expected, found;
    for (const BoxEntry& entry : all)
      if (entry.box.overlaps(query)) expected.push_back(entry.id);
    forest.find(query, [&](std::uint32_t id) {
      found.push_back(id);
      return false;
    });
    std::sort(found.begin(), found.end());
    ASSERT_EQ(found, expected);
  }
}

TEST(BoxForest, StopsWhenAsked) {
  BoxForest forest;
  for (std::uint32_t i = 0; i < 100; ++i) forest.add({{Eigen::Vector3f::Zero(), Eigen::Vector3f::Ones()}, i});
  int visits = 0;
  EXPECT_TRUE(
      forest.find({Eigen::Vector3f::Zero(), Eigen::Vector3f::Ones()}, [&](std::uint32_t) { return ++visits == 3; }));
  EXPECT_EQ(visits, 3);
}

}  // namespace
}  // namespace lapseam
