#include "io/angle_table.h"

#include <gtest/gtest.h>

#include <numbers>

namespace lapseam {
namespace {

constexpr double kPi = std::numbers::pi;

TEST(AngleTable, LimitsGiveBackTheTableBitForBit) {
  for (const int count : {2, 7, 360, 2000}) {
    const std::vector<double> full = angles_between(-kPi, kPi, count);
    const auto limits = exact_limits(full);
    ASSERT_TRUE(limits) << count;
    EXPECT_EQ(angles_between(limits->first, limits->second, count), full);
    const auto limits_deg = limits_in_degrees(full);
    ASSERT_TRUE(limits_deg);
    EXPECT_EQ(*limits_deg, (std::pair{-180.0, 180.0}));
  }
}

TEST(AngleTable, AnUnevenTableHasNoLimits) {
  std::vector<double> table = angles_between(-1, 1, 100);
  table[50] += 1e-6;
  EXPECT_FALSE(exact_limits(table));
  EXPECT_FALSE(limits_in_degrees(table));
}

TEST(AngleTable, TextKeepsEveryBit) {
  const std::vector<double> values{1.0 / 3.0, -kPi, 1e-300, 0.1};
  std::vector<double> again;
  const std::string text = to_text(values);
  for (std::size_t at = 0, used = 0; at < text.size(); at += used + 1)
    again.push_back(std::stod(text.substr(at), &used));
  EXPECT_EQ(again, values);
}

}  // namespace
}  // namespace lapseam
