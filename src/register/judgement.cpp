// What came of a registration: what agrees less than before is left where it was, the rest is reported.

#include <cmath>

#include "core/parallel.h"
#include "register/registrar.h"

namespace lapseam {
namespace {

// A result is worse than what it came from only beyond this many standard deviations of chance.
constexpr double kChance = 2;
// After something was left out, the rest is refined once more.
constexpr int kMostJudgements = 1;

}  // namespace

Registrar::Agreement Registrar::agreement(const Pair& pair, const Posed& a, const Posed& b) const {
  const Gate wide{capture_m_, capture_m_};
  std::vector<double> absolute;
  Agreement out;
  for (const bool is_turned : {false, true}) {
    const Posed &from = is_turned ? b : a, &to = is_turned ? a : b;
    for (const Match& match : find_matches(from, to, wide, thinning(*from.image, kJudged))) {
      const double r = std::abs(double(match.residual_m)), t = r / pair.gate.at(match);
      absolute.push_back(r);
      out.gain += std::max(0.0, 1 - t * t);
    }
  }
  std::sort(absolute.begin(), absolute.end());
  out.residual.matches = absolute.size();
  if (absolute.empty()) return out;
  out.residual.median_m = absolute[(absolute.size() - 1) / 2];
  out.residual.p90_m = absolute[std::size_t(0.9 * double(absolute.size() - 1))];
  return out;
}

void Registrar::judge() {
  std::vector<Posed> given = posed_at(0);
  for (std::size_t i = 0; i < n_; ++i) given[i].T_world_view = views_[i].T_world_view;
  for (int round = 0;; ++round) {
    const std::vector<Posed> placed = posed_at(0);
    std::vector<Agreement> before(pairs_.size()), after(pairs_.size());
    parallel_for(context_, pairs_.size(), 1, [&](std::size_t k) {
      const Overlap& views = pairs_[k].views;
      before[k] = agreement(pairs_[k], given[views.a], given[views.b]);
      after[k] = agreement(pairs_[k], placed[views.a], placed[views.b]);
    });
    report_pairs(before, after);
    if (round == kMostJudgements || !refuse(before, after)) return;
    fix_parts();
    for (std::size_t i = 0; i < n_; ++i)
      if (result_.views[i].placement == ViewPlacement::kUnlinked)
        result_.views[i].T_world_view = views_[i].T_world_view;
    refine_with_all(make_trees(0));
  }
}

bool Registrar::is_worse(double before, double after) { return after < before - kChance * std::sqrt(before); }

bool Registrar::refuse(const std::vector<Agreement>& before, const std::vector<Agreement>& after) {
  std::vector<double> gain_before(n_), gain_after(n_);
  std::vector<bool> has_matches(n_);
  for (std::size_t k = 0; k < pairs_.size(); ++k)
    for (const std::uint32_t view : {pairs_[k].views.a, pairs_[k].views.b}) {
      if (pairs_[k].is_dropped) continue;
      gain_before[view] += before[k].gain;
      gain_after[view] += after[k].gain;
      if (pairs_[k].sums.matches > 0) has_matches[view] = true;
    }
  bool is_changed = false;
  for (std::size_t i = 0; i < n_; ++i) {
    if (!is_moving(i)) continue;
    std::string problem;
    if (!has_matches[i]) problem = "shows nothing that another view shows";
    if (is_lost(i)) problem = "moved farther than the capture range";
    if (is_worse(gain_before[i], gain_after[i]))
      problem = result_.views[i].line_offset_rad.empty() ? "agreed better with the other views where it was"
                                                         : "agreed better where planes had put it";
    if (problem.empty()) continue;
    leave(i, problem);
    is_changed = true;
  }
  for (std::size_t k = 0; k < pairs_.size(); ++k) {
    if (pairs_[k].is_dropped || pairs_[k].sums.matches == 0) continue;
    if (!is_worse(before[k].gain, after[k].gain) || is_needed(k)) continue;
    drop(k, "agreed better where it was");
    is_changed = true;
  }
  return is_changed;
}

bool Registrar::is_needed(std::size_t k) const {
  std::vector<Overlap> links;
  for (std::size_t i = 0; i < pairs_.size(); ++i)
    if (i != k && !pairs_[i].is_dropped && pairs_[i].sums.matches > 0) links.push_back(pairs_[i].views);
  const std::vector<std::uint32_t> part = linked_parts(links, n_);
  return part[pairs_[k].views.a] != part[pairs_[k].views.b];
}

bool Registrar::is_lost(std::size_t i) const {
  const Vector6d motion = motion_since_given(i);
  return std::max(motion.tail<3>().norm(), pyramids_[i].radius_m * motion.head<3>().norm()) > capture_m_;
}

void Registrar::leave(std::size_t i, const std::string& problem) {
  result_.views[i].placement = ViewPlacement::kRefused;
  result_.views[i].problem = problem;
  result_.views[i].T_world_view = views_[i].T_world_view;
  for (std::size_t k = 0; k < pairs_.size(); ++k)
    if (pairs_[k].views.a == i || pairs_[k].views.b == i) drop(k, "one of its views was left where it was");
}

void Registrar::drop(std::size_t k, const std::string& problem) {
  if (pairs_[k].is_dropped) return;
  pairs_[k].is_dropped = true;
  result_.report.pairs[k].problem = problem;
}

void Registrar::report_pairs(const std::vector<Agreement>& before, const std::vector<Agreement>& after) {
  result_.report.pairs.resize(pairs_.size());
  for (std::size_t k = 0; k < pairs_.size(); ++k) {
    RegisteredPair& out = result_.report.pairs[k];
    out.a = pairs_[k].views.a;
    out.b = pairs_[k].views.b;
    out.overlap = pairs_[k].views.share;
    out.before = before[k].residual;
    out.after = after[k].residual;
    out.unexplained_m = std::max(pairs_[k].gate.scale_m, pairs_[k].gate.unexplained_m);
    if (pairs_[k].sums.matches == 0 && !pairs_[k].is_dropped) out.problem = "too few matches";
  }
}

void Registrar::finish() {
  associate_all(0, make_trees(0), kAll);
  std::vector<double> tensions;
  for (std::size_t k = 0; k < pairs_.size(); ++k) {
    if (pairs_[k].is_dropped || pairs_[k].sums.matches == 0) continue;
    tensions.push_back(result_.report.pairs[k].tension = tension(pairs_[k].sums) / kCountedTwice);
  }
  result_.report.variance_factor = tensions.empty() ? 1.0 : middle(tensions);
  const NetworkStep step = solve(true);
  for (const SlidingMode& mode : step.sliding) result_.report.sliding.push_back(describe(mode));
  for (std::size_t i = 0; i < n_; ++i) {
    PlacedView& view = result_.views[i];
    const Eigen::Isometry3d moved = view.T_world_view * given_[i].T_world_view.inverse(Eigen::Isometry);
    view.moved_m = (view.T_world_view.translation() - given_[i].T_world_view.translation()).norm();
    view.turned_rad = Eigen::AngleAxisd(moved.linear()).angle();
    view.covariance = about_origin(step.covariance[i], view.T_world_view.translation() - center_of(i));
  }
}

PoseCovariance Registrar::about_origin(const Matrix6d& covariance, const Eigen::Vector3d& d) {
  Matrix6d A = Matrix6d::Zero();
  A.topRightCorner<3, 3>().setIdentity();
  A.topLeftCorner<3, 3>() << 0, d.z(), -d.y(), -d.z(), 0, d.x(), d.y(), -d.x(), 0;  // t + ω × d
  A.bottomLeftCorner<3, 3>().setIdentity();
  return A * covariance * A.transpose();
}

Sliding Registrar::describe(const SlidingMode& mode) const {
  Sliding out;
  out.certainty = mode.certainty;
  double most = 0;
  for (std::size_t i = 0; i < n_; ++i) {
    const Eigen::Vector3d turn = pyramids_[i].radius_m * mode.motion[i].head<3>(), shift = mode.motion[i].tail<3>();
    const double size = std::max(turn.norm(), shift.norm());
    if (size >= 0.5) out.views.push_back(std::uint32_t(i));
    if (size <= most) continue;
    most = size;
    out.translation = shift;
    out.rotation = turn;
  }
  return out;
}

}  // namespace lapseam
