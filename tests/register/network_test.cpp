#include "register/network.h"

#include <gtest/gtest.h>

#include <array>

namespace lapseam {
namespace {

// Two views; what they share wants the second one 50 mm along x and 20 mm along z, with one unit of information.
NetworkStep step_of(const Matrix6d& known, const Vector6d& away) {
  PairSums sums;
  sums.matches = 1;
  sums.H = Matrix6d::Identity();
  sums.g << 0, 0, 0, 0.05, 0, 0.02;  // moves the first against the second
  sums.feigned = 1e-6 * Matrix6d::Identity();
  const std::array<NetworkPair, 1> pairs = {{{0, 1, Eigen::Vector3d::Zero(), &sums}}};
  std::array<NetworkView, 2> views;
  views[0].is_fixed = true;
  views[1].known = known;
  views[1].away = away;
  Context context(1);
  return solve_network(views, pairs, {.prior_m = 1e3}, context);
}

TEST(Network, WhatPlanesKnowOfAViewHoldsIt) {
  const Vector6d free = step_of(Matrix6d::Zero(), Vector6d::Zero()).motion[1];
  EXPECT_NEAR(free[3], 0.05, 1e-6);
  EXPECT_NEAR(free[5], 0.02, 1e-6);
  // A floor tells z a hundred times as well, and of x nothing.
  Matrix6d known = Matrix6d::Zero();
  known(5, 5) = 99;
  Vector6d away = Vector6d::Zero();
  const Vector6d held = step_of(known, away).motion[1];
  EXPECT_NEAR(held[3], 0.05, 1e-6);
  EXPECT_NEAR(held[5], 0.0002, 1e-6);
  // Moved off the floor by 10 mm, it goes back.
  away[5] = 0.01;
  EXPECT_NEAR(step_of(known, away).motion[1][5], 0.0002 - 0.0099, 1e-6);
}

}  // namespace
}  // namespace lapseam
