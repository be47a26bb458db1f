// Views that settled in a wrong place, one repeat of a radiator off or by a part of what they see: told by how hard
// they pull against the others and by how much of them fits, and started again while those hold still.

#include <algorithm>
#include <cmath>

#include "core/parallel.h"
#include "register/registrar.h"

namespace lapseam {
namespace {

// Standard deviations, as all views have them, beyond which a view is tried elsewhere. A trial costs time, nothing
// else.
constexpr double kSuspected = 3;
// What is still beyond this afterwards is reported. Far above what is tried: of a hundred views of a cluttered room,
// each within a millimetre of its place, seven were beyond half of this, and one is beyond it.
constexpr double kDoubted = 2 * kTukey;
// Fewer views, or pairs of a view, do not tell what is usual.
constexpr std::size_t kFewestToCompare = 5, kFewestPairs = 3;
// Least standard deviation of the logarithm of a view's middle tension, times the root of its pairs: that of six
// degrees of freedom, and of a median. And of the share that does not fit: what views see differs by so much.
constexpr double kChanceOfTension = 0.58 * 1.25, kChanceOfMisfit = 0.05;
// Besides from where it was given, a view is started from where so many partners imply.
constexpr std::size_t kImpliedStarts = 4;
constexpr int kMostRounds = 3;

// Turns logarithms into standard deviations above the usual; NaN: not known, and stays 0.
std::vector<double> standardized(const std::vector<double>& logs, const std::vector<double>& least_spread) {
  std::vector<double> out(logs.size()), usual;
  for (const double value : logs)
    if (std::isfinite(value)) usual.push_back(value);
  if (usual.size() < kFewestToCompare) return out;
  const double center = middle(usual);
  for (double& value : usual) value = std::abs(value - center);
  const double spread = kNormalPerMedian * middle(usual);
  for (std::size_t i = 0; i < logs.size(); ++i)
    if (std::isfinite(logs[i])) out[i] = (logs[i] - center) / std::max(spread, least_spread[i]);
  return out;
}

}  // namespace

std::vector<double> Registrar::strains() const {
  const std::vector<Posed> placed = posed_at(0);
  std::vector<Agreement> found(pairs_.size());
  parallel_for(context_, pairs_.size(), 1, [&](std::size_t k) {
    if (is_live(pairs_[k])) found[k] = agreement(pairs_[k], placed[pairs_[k].views.a], placed[pairs_[k].views.b]);
  });
  std::vector<std::vector<double>> tensions(n_);
  std::vector<double> gain(n_), matches(n_);
  for (std::size_t k = 0; k < pairs_.size(); ++k)
    for (const std::uint32_t view : {pairs_[k].views.a, pairs_[k].views.b}) {
      if (!is_live(pairs_[k])) continue;
      tensions[view].push_back(tension(pairs_[k].sums));
      gain[view] += found[k].gain;
      matches[view] += double(found[k].residual.matches);
    }
  const double none = std::numeric_limits<double>::quiet_NaN();
  std::vector<double> pull(n_, none), misfit(n_, none), chance(n_);
  for (std::size_t i = 0; i < n_; ++i) {
    if (tensions[i].size() < kFewestPairs || !(matches[i] > 0)) continue;
    chance[i] = kChanceOfTension / std::sqrt(double(tensions[i].size()));
    pull[i] = std::log(middle(tensions[i]));
    misfit[i] = std::log(1 - gain[i] / matches[i]);
  }
  std::vector<double> out = standardized(pull, chance);
  const std::vector<double> other = standardized(beside_partners(misfit), std::vector<double>(n_, kChanceOfMisfit));
  for (std::size_t i = 0; i < n_; ++i) out[i] = std::max(out[i], other[i]);
  return out;
}

std::vector<double> Registrar::beside_partners(const std::vector<double>& of_view) const {
  std::vector<std::vector<double>> theirs(n_);
  for (const Pair& pair : pairs_) {
    if (!is_live(pair)) continue;
    theirs[pair.views.a].push_back(of_view[pair.views.b]);
    theirs[pair.views.b].push_back(of_view[pair.views.a]);
  }
  std::vector<double> out = of_view;
  for (std::size_t i = 0; i < n_; ++i) {
    std::erase_if(theirs[i], [](double value) { return !std::isfinite(value); });
    out[i] -= middle(theirs[i]);
  }
  return out;
}

void Registrar::mend_misplaced() {
  StageScope stage(context_, "misplaced views");
  std::vector<double> strain = strains();
  for (int round = 0; round < kMostRounds && restart(strain); ++round) {
    refine_with_all(make_trees(0));
    strain = strains();
  }
  for (std::size_t i = 0; i < n_; ++i) {
    result_.views[i].strain = strain[i];
    if (is_moving(i) && strain[i] > kDoubted)
      result_.views[i].problem = "fits worse than other views do, wherever it was tried";
  }
}

bool Registrar::restart(const std::vector<double>& strain) {
  std::vector<std::size_t> suspects;
  std::vector<bool> is_suspect(n_);
  for (std::size_t i = 0; i < n_; ++i) {
    is_suspect[i] = is_moving(i) && strain[i] > kSuspected;
    if (is_suspect[i]) suspects.push_back(i);
  }
  std::stable_sort(suspects.begin(), suspects.end(),
                   [&](std::size_t x, std::size_t y) { return strain[x] > strain[y]; });
  bool is_changed = false;
  for (const std::size_t i : suspects) {
    if (!place_anew(i, is_suspect)) continue;
    is_suspect[i] = false;
    is_changed = true;
  }
  return is_changed;
}

bool Registrar::place_anew(std::size_t i, const std::vector<bool>& is_suspect) {
  std::vector<Pair> own;
  for (const Pair& pair : pairs_) {
    if (!is_live(pair) || (pair.views.a != i && pair.views.b != i)) continue;
    if (!is_suspect[pair.views.a == i ? pair.views.b : pair.views.a]) own.push_back(pair);
  }
  if (own.empty()) return false;
  const std::vector<Pair> as_found = own;
  const std::vector<Eigen::Isometry3d> starts = starts_of(i, own);
  const std::vector<PlacedView> placements = result_.views;
  for (std::size_t k = 0; k < n_; ++k)
    if (k != i) result_.views[k].placement = ViewPlacement::kFixed;
  const double scale_m = scale_m_, before = gain_of(as_found);
  std::swap(pairs_, own);
  Eigen::Isometry3d& pose = result_.views[i].T_world_view;
  Eigen::Isometry3d best = pose;
  double most = before;
  for (const Eigen::Isometry3d& start : starts) {
    pose = start;
    scale_m_ = capture_m_ / kTukey;
    start_pairs();
    for (int level = levels_ - 1; level >= 0; --level) descend(level);
    const double gain = gain_of(as_found);
    if (!(gain > most) || is_lost(i)) continue;
    most = gain;
    best = pose;
  }
  std::swap(pairs_, own);
  scale_m_ = scale_m;
  result_.views = placements;  // and the poses
  if (!is_worse(most, before)) return false;
  result_.views[i].T_world_view = best;
  return true;
}

std::vector<Eigen::Isometry3d> Registrar::starts_of(std::size_t i, std::vector<Pair> own) const {
  std::stable_sort(own.begin(), own.end(), [](const Pair& x, const Pair& y) { return x.views.share > y.views.share; });
  std::vector<Eigen::Isometry3d> out = {views_[i].T_world_view};
  for (std::size_t k = 0; k < std::min(kImpliedStarts, own.size()); ++k) {
    const std::size_t partner = own[k].views.a == i ? own[k].views.b : own[k].views.a;
    const Eigen::Isometry3d moved =
        result_.views[partner].T_world_view * views_[partner].T_world_view.inverse(Eigen::Isometry);
    out.push_back(moved * views_[i].T_world_view);
  }
  return out;
}

double Registrar::gain_of(const std::vector<Pair>& pairs) const {
  const std::vector<Posed> placed = posed_at(0);
  double sum = 0;
  for (const Pair& pair : pairs) sum += agreement(pair, placed[pair.views.a], placed[pair.views.b]).gain;
  return sum;
}

}  // namespace lapseam
