#include "lapseam/poses.h"

#include <Eigen/SVD>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>

#include "lapseam/error.h"

namespace lapseam {
namespace {

constexpr int kAlignmentRounds = 20;
// Of the arm: distances below this do not count more.
constexpr double kLeastDistance = 1e-7;

// Uniform over the sphere (Archimedes). Not std::normal_distribution, whose results are the library's own choice.
Eigen::Vector3d direction(std::mt19937_64& random) {
  const auto unit = [&] { return double(random() >> 11) * 0x1p-53; };
  const double z = 2 * unit() - 1, angle = 2 * std::numbers::pi * unit(), r = std::sqrt(std::max(0.0, 1 - z * z));
  return {r * std::cos(angle), r * std::sin(angle), z};
}

void check_sizes(std::size_t poses, std::size_t truth) {
  if (poses == 0) throw InvalidInput({}, {}, "poses", "there is none");
  if (poses != truth) throw InvalidInput({}, {}, "poses", "not as many as there are true ones");
}

double spread(std::span<const Eigen::Isometry3d> poses) {
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  for (const auto& pose : poses) mean += pose.translation() / double(poses.size());
  double sum = 0;
  for (const auto& pose : poses) sum += (pose.translation() - mean).squaredNorm() / double(poses.size());
  return std::max(std::sqrt(sum), 1.0);
}

// T · from nearest to `to` in weighted least squares (Kabsch 1976).
Eigen::Isometry3d fit_rigid(const Eigen::Matrix3Xd& from, const Eigen::Matrix3Xd& to, const Eigen::VectorXd& weights) {
  const Eigen::Vector3d a = from * weights / weights.sum(), b = to * weights / weights.sum();
  const Eigen::Matrix3d C = (to.colwise() - b) * weights.asDiagonal() * (from.colwise() - a).transpose();
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(C, Eigen::ComputeFullU | Eigen::ComputeFullV);
  Eigen::Matrix3d R = svd.matrixU() * svd.matrixV().transpose();
  if (R.determinant() < 0) R = svd.matrixU() * Eigen::Vector3d(1, 1, -1).asDiagonal() * svd.matrixV().transpose();
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.linear() = R;
  T.translation() = b - R * a;
  return T;
}

void summarize(std::vector<double> values, double& median, double& p90, double& max) {
  std::sort(values.begin(), values.end());
  const auto at = [&](double share) { return values[std::size_t(share * double(values.size() - 1) + 0.5)]; };
  median = at(0.5);
  p90 = at(0.9);
  max = values.back();
}

}  // namespace

std::vector<Eigen::Isometry3d> perturb_poses(std::span<const Eigen::Isometry3d> T_world_view,
                                             const PerturbOptions& options) {
  std::vector<Eigen::Isometry3d> out(T_world_view.begin(), T_world_view.end());
  for (std::size_t i = 1; i < out.size(); ++i) {
    std::mt19937_64 random(options.seed * 0x9E3779B97F4A7C15ull + i);
    const Eigen::Vector3d shift = options.translation_m * direction(random), axis = direction(random);
    out[i].linear() = Eigen::AngleAxisd(options.rotation_rad, axis).toRotationMatrix() * out[i].linear();
    out[i].translation() += shift;
  }
  return out;
}

Eigen::Isometry3d align_poses(std::span<const Eigen::Isometry3d> poses, std::span<const Eigen::Isometry3d> truth) {
  check_sizes(poses.size(), truth.size());
  const double arm = spread(truth);
  const auto n = Eigen::Index(4 * poses.size());
  Eigen::Matrix3Xd from(3, n), to(3, n);
  for (std::size_t i = 0; i < poses.size(); ++i)
    for (int k = 0; k < 4; ++k) {
      const Eigen::Vector3d local =
          k == 0 ? Eigen::Vector3d(0, 0, 0) : Eigen::Vector3d(arm * Eigen::Vector3d::Unit(k - 1));
      from.col(Eigen::Index(4 * i) + k) = poses[i] * local;
      to.col(Eigen::Index(4 * i) + k) = truth[i] * local;
    }
  // Least distances instead of least squares, by reweighting (Weiszfeld 1937): one lost view does not turn the others.
  Eigen::VectorXd weights = Eigen::VectorXd::Ones(n);
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  for (int round = 0; round < kAlignmentRounds; ++round) {
    T = fit_rigid(from, to, weights);
    const Eigen::VectorXd distances = ((T * from) - to).colwise().norm();
    weights = (distances.array() + kLeastDistance * arm).inverse();
  }
  return T;
}

PoseErrors compare_poses(std::span<const Eigen::Isometry3d> poses, std::span<const Eigen::Isometry3d> truth) {
  check_sizes(poses.size(), truth.size());
  PoseErrors out;
  for (std::size_t i = 0; i < poses.size(); ++i) {
    out.translation_m.push_back((poses[i].translation() - truth[i].translation()).norm());
    const Eigen::Quaterniond turn(Eigen::Matrix3d(poses[i].linear().transpose() * truth[i].linear()));
    out.rotation_rad.push_back(2 * std::atan2(turn.vec().norm(), std::abs(turn.w())));
  }
  summarize(out.translation_m, out.median_translation_m, out.p90_translation_m, out.max_translation_m);
  summarize(out.rotation_rad, out.median_rotation_rad, out.p90_rotation_rad, out.max_rotation_rad);
  return out;
}

}  // namespace lapseam
