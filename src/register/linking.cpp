// Who is matched with whom, by what, and at which scale each pair begins.

#include "core/parallel.h"
#include "register/registrar.h"

namespace lapseam {
namespace {

constexpr std::size_t kMostPartners = 40;
// A pair begins at this many times the spread of its first matches.
constexpr double kStart = 1.35;

}  // namespace

void Registrar::link() {
  StageScope stage(context_, "find pairs");
  pairs_.clear();
  scale_m_ = capture_m_ / kTukey;
  for (PlacedView& view : result_.views) {
    view.placement = ViewPlacement::kPlaced;
    view.problem.clear();
  }
  for (const Overlap& overlap :
       select_pairs(find_overlaps(posed_at(levels_ - 1), capture_m_, context_), n_, kMostPartners))
    pairs_.push_back({overlap, {capture_m_ / kTukey, capture_m_}});
  on_the_way_ = std::max(kOnTheWayEach, kOnTheWay * n_ / (2 * std::max<std::size_t>(1, pairs_.size())));
  for (const std::uint32_t view : options_.fixed) result_.views[view].placement = ViewPlacement::kFixed;
  fix_parts();
  start_pairs();
}

void Registrar::fix_parts() {
  std::vector<Overlap> links;
  for (const Pair& pair : pairs_)
    if (!pair.is_dropped) links.push_back(pair.views);
  const std::vector<std::uint32_t> part = linked_parts(links, n_);
  std::vector<std::size_t> size(n_), fixed(n_);
  for (std::size_t i = 0; i < n_; ++i) {
    ++size[part[i]];
    fixed[part[i]] += result_.views[i].placement == ViewPlacement::kFixed;
  }
  result_.report.parts = 0;
  for (std::size_t i = 0; i < n_; ++i) {
    PlacedView& view = result_.views[i];
    result_.report.parts += part[i] == i && size[i] > 1;
    if (view.placement != ViewPlacement::kPlaced || fixed[part[i]] > 0) continue;
    if (size[part[i]] == 1) {
      view.placement = ViewPlacement::kUnlinked;
      view.problem = "overlaps no other view";
    } else if (part[i] == i) {
      view.placement = ViewPlacement::kFixed;
    }
  }
}

void Registrar::start_pairs() {
  const std::vector<Posed> posed = posed_at(levels_ - 1);
  const Gate wide{capture_m_, capture_m_};
  parallel_for(context_, pairs_.size(), 1, [&](std::size_t k) {
    const Overlap& views = pairs_[k].views;
    std::vector<Match> all = find_matches(posed[views.a], posed[views.b], wide);
    const std::vector<Match> back = find_matches(posed[views.b], posed[views.a], wide);
    all.insert(all.end(), back.begin(), back.end());
    pairs_[k].start_m = all.size() < kFewestMatches ? scale_m_ : std::min(scale_m_, kStart * robust_spread(all, wide));
    pairs_[k].gate.distance_m = is_central(views.a) && is_central(views.b) ? typical_distance(all) : 0;
    pairs_[k].is_weak = all.size() < kFewestMatches;
  });
  double most = 0;
  for (const Pair& pair : pairs_) most = std::max(most, pair.start_m);
  scale_m_ = std::min(scale_m_, most);
}

double Registrar::typical_distance(const std::vector<Match>& matches) {
  std::vector<double> distances;
  for (const Match& match : matches) distances.push_back(double(match.distance_m));
  return middle(distances);
}

std::vector<std::optional<KdTree>> Registrar::make_trees(int level) const {
  std::vector<std::uint8_t> is_wanted(n_);
  for (std::size_t i = 0; i < n_; ++i) is_wanted[i] = !is_central(i);
  for (const Pair& pair : pairs_)
    if (pair.is_weak) is_wanted[pair.views.a] = is_wanted[pair.views.b] = 1;
  std::vector<std::optional<KdTree>> trees(n_);
  parallel_for(context_, n_, 1, [&](std::size_t i) {
    if (!is_wanted[i]) return;
    const SurfelImage& surfels = image(i, level);
    std::vector<Eigen::Vector3f> points;
    for (const std::uint32_t k : surfels.usable) points.push_back(surfels.surfels[k].point);
    trees[i].emplace(points);
  });
  return trees;
}

std::vector<GatedPair> Registrar::gated_pairs() const {
  std::vector<GatedPair> out;
  for (const Pair& pair : pairs_)
    if (!pair.is_dropped && pair.sums.matches > 0) out.push_back({pair.views.a, pair.views.b, pair.gate});
  return out;
}

}  // namespace lapseam
