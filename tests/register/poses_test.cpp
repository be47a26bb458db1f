#include "lapseam/poses.h"

#include <gtest/gtest.h>

#include "lapseam/error.h"
#include "support/analytic_views.h"

namespace lapseam {
namespace {

std::vector<Eigen::Isometry3d> ring(int count) {
  std::vector<Eigen::Isometry3d> poses;
  for (int i = 0; i < count; ++i)
    poses.push_back(test::look_at({2 * std::cos(0.5 * i), 2 * std::sin(0.5 * i), 0.3 * i}, {0, 0, 0.5}));
  return poses;
}

TEST(Poses, PerturbedByExactlyWhatWasAskedFor) {
  const auto truth = ring(6);
  const auto moved = perturb_poses(truth, {.translation_m = 0.01, .rotation_rad = 0.02, .seed = 3});
  const PoseErrors errors = compare_poses(moved, truth);
  EXPECT_EQ(errors.translation_m[0], 0);
  for (std::size_t i = 1; i < truth.size(); ++i) {
    EXPECT_NEAR(errors.translation_m[i], 0.01, 1e-12);
    EXPECT_NEAR(errors.rotation_rad[i], 0.02, 1e-12);
  }
  const auto other = perturb_poses(truth, {.translation_m = 0.01, .rotation_rad = 0.02, .seed = 4});
  EXPECT_GT((other[1].translation() - moved[1].translation()).norm(), 1e-4);
}

TEST(Poses, AlignmentTakesOutOneRigidMotion) {
  const auto truth = ring(7);
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.linear() = Eigen::AngleAxisd(0.7, Eigen::Vector3d(1, 2, 3).normalized()).toRotationMatrix();
  T.translation() = Eigen::Vector3d(1, -2, 3);
  auto moved = truth;
  for (auto& pose : moved) pose = T * pose;
  const Eigen::Isometry3d back = align_poses(moved, truth);
  for (auto& pose : moved) pose = back * pose;
  EXPECT_LT(compare_poses(moved, truth).max_translation_m, 1e-9);
  EXPECT_LT(compare_poses(moved, truth).max_rotation_rad, 1e-7);
}

TEST(Poses, OneLostViewDoesNotTurnTheOthers) {
  const auto truth = ring(9);
  auto moved = truth;
  moved[4].translation() += Eigen::Vector3d(3, 0, 0);
  const Eigen::Isometry3d T = align_poses(moved, truth);
  for (auto& pose : moved) pose = T * pose;
  EXPECT_LT(compare_poses(moved, truth).median_translation_m, 1e-4);
  EXPECT_NEAR(compare_poses(moved, truth).max_translation_m, 3, 1e-3);
}

TEST(Poses, NeedAsManyOfBoth) {
  const auto truth = ring(3), fewer = ring(2);
  EXPECT_THROW(align_poses(fewer, truth), InvalidInput);
  EXPECT_THROW(compare_poses({}, {}), InvalidInput);
}

}  // namespace
}  // namespace lapseam
