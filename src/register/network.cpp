// Degenerate directions after J. Zhang, M. Kaess, S. Singh, On degeneracy of optimization-based state estimation
// problems, 2016; here for all views at once, and measured against what the noise of normals feigns.

#include "register/network.h"

#include <Eigen/Eigenvalues>
#include <Eigen/Sparse>
#include <algorithm>
#include <cmath>

#include "core/parallel.h"
#include "lapseam/error.h"

namespace lapseam {
namespace {

using SparseMatrix = Eigen::SparseMatrix<double>;
constexpr Eigen::Index kModes = 8;
constexpr int kSubspaceRounds = 12;

// The motion (ω, t) about m as a motion about c: a matrix on (ω, t).
Matrix6d shift_center(const Eigen::Vector3d& m, const Eigen::Vector3d& c) {
  const Eigen::Vector3d d = c - m;
  Matrix6d A = Matrix6d::Identity();
  A.bottomLeftCorner<3, 3>() << 0, d.z(), -d.y(), -d.z(), 0, d.x(), d.y(), -d.x(), 0;  // ω × d = −[d]× ω
  return A;
}

class Network {
 public:
  Network(std::span<const NetworkView> views, std::span<const NetworkPair> pairs, double prior_m)
      : views_(views), slot_(views.size(), -1) {
    for (std::size_t i = 0; i < views.size(); ++i)
      if (!views[i].is_fixed) slot_[i] = free_++;
    const Eigen::Index n = 6 * free_;
    g_ = Eigen::VectorXd::Zero(n);
    std::vector<Matrix6d> H(std::size_t(free_), Matrix6d::Zero()), F(std::size_t(free_), Matrix6d::Zero());
    std::vector<Eigen::Triplet<double>> off_H, off_F;
    for (const NetworkPair& pair : pairs) add(pair, H, F, off_H, off_F);
    for (std::size_t i = 0; i < views.size(); ++i) {
      if (slot_[i] < 0) continue;
      const auto k = std::size_t(slot_[i]);
      Vector6d prior = Vector6d::Constant(1 / (prior_m * prior_m));
      prior.head<3>() *= views[i].radius_m * views[i].radius_m;
      H[k].diagonal() += prior;
      H[k] += views[i].known;
      g_.segment<6>(6 * slot_[i]) += views[i].known * views[i].away;
      F[k].diagonal() += prior;
      put(H[k], slot_[i], slot_[i], off_H);
      put(F[k], slot_[i], slot_[i], off_F);
    }
    H_.resize(n, n);
    F_.resize(n, n);
    H_.setFromTriplets(off_H.begin(), off_H.end());
    F_.setFromTriplets(off_F.begin(), off_F.end());
    solver_.compute(H_);
    if (solver_.info() != Eigen::Success) throw Error("registration: the normal equations cannot be solved");
  }

  Eigen::Index size() const { return 6 * free_; }

  NetworkStep step(double least_certainty, const std::vector<Vector6d>* total) {
    NetworkStep out;
    Eigen::VectorXd x = solver_.solve(-g_);
    find_modes(least_certainty);
    for (Eigen::Index k = 0; k < modes_.cols(); ++k) {
      const Eigen::VectorXd v = modes_.col(k);
      x -= v * v.dot(F_ * x);
      out.sliding.push_back(describe(v, certainty_[k]));
    }
    out.motion = spread(x);
    if (total && modes_.cols() > 0) out.slid = spread(taken_back(*total));
    return out;
  }

  Eigen::VectorXd taken_back(const std::vector<Vector6d>& total) const {
    Eigen::VectorXd x(size());
    for (std::size_t i = 0; i < views_.size(); ++i)
      if (slot_[i] >= 0) x.segment<6>(6 * slot_[i]) = total[i];
    return -(modes_ * (modes_.transpose() * (F_ * x)));
  }

  std::vector<Matrix6d> covariance(Context& context) const {
    std::vector<Matrix6d> out(views_.size(), Matrix6d::Zero());
    parallel_for(context, views_.size(), 1, [&](std::size_t i) {
      if (slot_[i] < 0) return;
      Eigen::MatrixXd e = Eigen::MatrixXd::Zero(size(), 6);
      e.middleRows<6>(6 * slot_[i]).setIdentity();
      const Eigen::MatrixXd column = solver_.solve(e);
      const Matrix6d block = column.middleRows<6>(6 * slot_[i]);
      out[i] = 0.5 * (block + block.transpose());
    });
    return out;
  }

 private:
  static void put(const Matrix6d& block, Eigen::Index row, Eigen::Index column,
                  std::vector<Eigen::Triplet<double>>& out) {
    for (int c = 0; c < 6; ++c)
      for (int r = 0; r < 6; ++r) out.emplace_back(6 * row + r, 6 * column + c, block(r, c));
  }

  void add(const NetworkPair& pair, std::vector<Matrix6d>& H, std::vector<Matrix6d>& F,
           std::vector<Eigen::Triplet<double>>& off_H, std::vector<Eigen::Triplet<double>>& off_F) {
    const Matrix6d A = shift_center(views_[pair.a].center, pair.center);
    const Matrix6d B = shift_center(views_[pair.b].center, pair.center);
    const Eigen::Index a = slot_[pair.a], b = slot_[pair.b];
    const PairSums& sums = *pair.sums;
    if (a >= 0) {
      H[std::size_t(a)] += A.transpose() * sums.H * A;
      F[std::size_t(a)] += A.transpose() * sums.feigned * A;
      g_.segment<6>(6 * a) += A.transpose() * sums.g;
    }
    if (b >= 0) {
      H[std::size_t(b)] += B.transpose() * sums.H * B;
      F[std::size_t(b)] += B.transpose() * sums.feigned * B;
      g_.segment<6>(6 * b) -= B.transpose() * sums.g;
    }
    if (a < 0 || b < 0) return;
    const Matrix6d AHB = -A.transpose() * sums.H * B, AFB = -A.transpose() * sums.feigned * B;
    put(AHB, a, b, off_H);
    put(AHB.transpose(), b, a, off_H);
    put(AFB, a, b, off_F);
    put(AFB.transpose(), b, a, off_F);
  }

  // Motions whose information is least against what is feigned: H v = λ F v by subspace iteration, vᵀ F v = 1.
  void find_modes(double least_certainty) {
    for (Eigen::Index wanted = std::min(kModes, size());; wanted = std::min(2 * wanted, size())) {
      Eigen::MatrixXd X(size(), wanted);
      std::uint64_t state = 1;
      for (Eigen::Index i = 0; i < X.size(); ++i) {
        state = state * 6364136223846793005ull + 1442695040888963407ull;
        X.data()[i] = double(state >> 11) * 0x1p-52 - 1;
      }
      Eigen::VectorXd lambda;
      for (int round = 0; round < kSubspaceRounds; ++round) {
        X = solver_.solve(F_ * X);
        const Eigen::MatrixXd small_H = X.transpose() * (H_ * X), small_F = X.transpose() * (F_ * X);
        const Eigen::GeneralizedSelfAdjointEigenSolver<Eigen::MatrixXd> eigen(small_H, small_F);
        if (eigen.info() != Eigen::Success) break;  // fewer independent motions than asked for
        X = X * eigen.eigenvectors();
        lambda = eigen.eigenvalues();
      }
      Eigen::Index count = 0;
      while (count < lambda.size() && lambda[count] < least_certainty) ++count;
      if (count == wanted && wanted < size()) continue;
      modes_ = X.leftCols(count);
      certainty_ = lambda.head(count);
      return;
    }
  }

  std::vector<Vector6d> spread(const Eigen::VectorXd& x) const {
    std::vector<Vector6d> out(views_.size(), Vector6d::Zero());
    for (std::size_t i = 0; i < views_.size(); ++i)
      if (slot_[i] >= 0) out[i] = x.segment<6>(6 * slot_[i]);
    return out;
  }

  SlidingMode describe(const Eigen::VectorXd& v, double certainty) const {
    SlidingMode mode;
    mode.motion = spread(v);
    mode.certainty = certainty;
    double largest = 0;
    for (std::size_t i = 0; i < views_.size(); ++i)
      largest =
          std::max({largest, mode.motion[i].tail<3>().norm(), views_[i].radius_m * mode.motion[i].head<3>().norm()});
    for (Vector6d& motion : mode.motion) motion /= largest;
    return mode;
  }

  std::span<const NetworkView> views_;
  std::vector<Eigen::Index> slot_;  // of each view, its place among those that move; −1: fixed
  Eigen::Index free_ = 0;
  SparseMatrix H_, F_;
  Eigen::VectorXd g_;
  Eigen::SimplicialLDLT<SparseMatrix> solver_;
  Eigen::MatrixXd modes_;
  Eigen::VectorXd certainty_;
};

}  // namespace

NetworkStep solve_network(std::span<const NetworkView> views, std::span<const NetworkPair> pairs,
                          const NetworkOptions& options, Context& context) {
  Network network(views, pairs, options.prior_m);
  NetworkStep out;
  out.motion.assign(views.size(), Vector6d::Zero());
  if (network.size() > 0) out = network.step(options.least_certainty, options.total);
  if (options.with_covariance) out.covariance = network.covariance(context);
  return out;
}

double tension(const PairSums& sums) {
  const Matrix6d H = sums.H + 1e-9 * sums.H.trace() * Matrix6d::Identity();
  const double share = sums.weights > 0 ? sums.shared_weights / sums.weights : 1;  // which g varies less by than H says
  return sums.g.dot(H.ldlt().solve(sums.g)) / (6 * share);
}

}  // namespace lapseam
