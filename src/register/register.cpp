// Joint registration of many range images, coarse to fine. After K. Pulli, Multiview registration for large data sets,
// 1999, and S. Krishnan et al., 2005 (all views at once); the parts are in associate.cpp and network.cpp.

#include "lapseam/register.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>

#include "core/parallel.h"
#include "lapseam/error.h"
#include "register/brightness.h"
#include "register/line_angles.h"
#include "register/network.h"
#include "register/noise_symmetry.h"
#include "register/pairs.h"
#include "register/range_offsets.h"

namespace lapseam {
namespace {

// Surfels of a view at the finest level: more add time and little else, since each is a mean of many samples.
constexpr std::size_t kMostSurfels = 25'000;
// Share of what a view sees that its points may be off by.
constexpr double kCaptureShare = 0.1;
constexpr std::size_t kMostPartners = 20;
constexpr int kCoarseIterations = 30, kFineIterations = 12;
// Views that move less than this share of the scale have arrived, and the scale is halved: what is left of surfaces
// that were off farther is told from what never fits (graduated non-convexity: Blake and Zisserman 1987).
constexpr double kArrived = 0.1, kClosing = 0.5;
// A scale below this share of the noise is no different from none.
constexpr double kNegligible = 0.25;
// Of the distance between surfels: edges are known no better, so that the next level has to go on.
constexpr double kFinestScale = 1.0 / 16;
// A pair begins at this many times the spread of its first matches.
constexpr double kStart = 1.35;
// Surfels of each view that are matched on the way, with all its partners together and at least with each; and that a
// result is judged by. Only the last steps take all.
constexpr std::size_t kOnTheWay = 20'000, kOnTheWayEach = 1000, kJudged = 4000;
constexpr std::size_t kAll = std::numeric_limits<std::size_t>::max();
constexpr int kLastIterations = 4;
// Poses and what sensors are off by take turns.
constexpr int kCalibrations = 10;
// Lines, poses and planes are found together; at first, planes reach this share of the capture range.
constexpr int kLineRounds = 30;
constexpr double kLineReach = 0.5;
// Fewer matches say nothing of a pair.
constexpr std::size_t kFewestMatches = 30;
// Each measurement is matched from both sides.
constexpr double kCountedTwice = 2;
// A result is worse than what it came from only beyond this many standard deviations of chance.
constexpr double kChance = 2;
// After something was left out, the rest is refined once more.
constexpr int kMostJudgements = 1;

struct Pair {
  Overlap views{};
  Gate gate{};
  Eigen::Vector3d center = Eigen::Vector3d::Zero();
  PairSums sums{};
  double start_m = 0;    // scale of its residuals at first; 0: too few to tell
  double noise_m = 0;    // what noise makes of them, median
  bool is_weak = false;  // projection finds too little: closest points help
  bool is_dropped = false;
};

double middle(std::vector<double>& values) {
  if (values.empty()) return 0;
  const auto at = values.begin() + std::ptrdiff_t(values.size() / 2);
  std::nth_element(values.begin(), at, values.end());
  return *at;
}

class Registrar {
 public:
  Registrar(std::span<const View> views, std::span<const NoiseModel> noise, const PictureOf& pictures,
            const RegisterOptions& options, Context& context)
      : given_(views),
        views_(views),
        noise_(noise),
        pictures_(pictures),
        options_(options),
        context_(context),
        n_(views.size()) {
    if (noise.size() != n_) throw InvalidInput({}, {}, "noise", "not one model for each view");
    for (const std::uint32_t view : options.fixed)
      if (view >= n_) throw InvalidInput({}, {}, "fixed", "there is no view " + std::to_string(view));
  }

  RegisterResult run() {
    result_.views.resize(n_);
    for (std::size_t i = 0; i < n_; ++i) result_.views[i].T_world_view = views_[i].T_world_view;
    if (n_ == 0) return std::move(result_);
    judge_noise();
    make_pyramids();
    set_capture_range();
    link();
    refine_all();
    if (options_.calibrate && calibrate_lines()) {
      link();
      refine_all();
    }
    if (options_.calibrate) calibrate();
    StageScope stage(context_, "judge registration");
    judge();
    finish();
    return std::move(result_);
  }

 private:
  void judge_noise() {
    is_symmetric_in_range_.assign(n_, false);
    std::map<std::string, std::vector<std::size_t>> members;
    for (std::size_t i = 0; i < n_; ++i)
      if (is_central(i)) members[views_[i].sensor_id].push_back(i);
    for (const auto& [id, of_sensor] : members) {
      std::vector<const View*> views;
      std::vector<const NoiseModel*> noise;
      for (const std::size_t i : of_sensor) {
        views.push_back(&views_[i]);
        noise.push_back(&noise_[i]);
      }
      const bool is_symmetric = is_symmetric_in_range(views, noise, context_);
      for (const std::size_t i : of_sensor) is_symmetric_in_range_[i] = is_symmetric;
    }
  }

  void make_pyramids() {
    StageScope stage(context_, "surfels", n_);
    pyramids_.resize(n_);
    parallel_for(context_, n_, 1, [&](std::size_t i) {
      BrightnessAt brightness;
      if (options_.use_color && pictures_)
        if (const auto picture = pictures_(i)) brightness = make_brightness(*picture);
      pyramids_[i] = make_surfels(views_[i], noise_[i], is_symmetric_in_range_[i], kMostSurfels, brightness);
      stage.advance();
    });
  }

  void set_capture_range() {
    std::vector<double> sizes;
    for (const SurfelPyramid& pyramid : pyramids_) {
      levels_ = std::max(levels_, int(pyramid.levels.size()));
      if (!pyramid.box_in_view.isEmpty()) sizes.push_back(2 * pyramid.radius_m);
    }
    const double size = middle(sizes);
    capture_m_ = options_.capture_m > 0 ? options_.capture_m : kCaptureShare * size;
    result_.report.capture_m = capture_m_;
    scale_m_ = capture_m_ / kTukey;
    result_.report.capture_rad = size > 0 ? capture_m_ / (0.5 * size) : 0;
  }

  const SurfelImage& image(std::size_t i, int level) const {
    const auto& levels = pyramids_[i].levels;
    return levels[std::min(std::size_t(level), levels.size() - 1)];
  }

  std::vector<Posed> posed_at(int level) const {
    std::vector<Posed> out(n_);
    for (std::size_t i = 0; i < n_; ++i)
      out[i] = {&image(i, level), &views_[i].sensor, nullptr, &pyramids_[i].box_in_view, result_.views[i].T_world_view};
    return out;
  }

  void refine_all() {
    StageScope stage(context_, "register", std::uint64_t(levels_));
    for (int level = levels_ - 1; level >= 0; --level) {
      refine(level, level == 0 ? kFineIterations : kCoarseIterations);
      stage.advance();
    }
  }

  // Pairs, and who stays.
  void link() {
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
    for (const std::uint32_t view : options_.fixed) result_.views[view].placement = ViewPlacement::kFixed;
    fix_parts();
    start_pairs();
  }

  // Each part needs one view that stays. A view without partners is a part by itself.
  void fix_parts() {
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

  // The scale at which each pair begins, from what it is off by as given.
  void start_pairs() {
    const std::vector<Posed> posed = posed_at(levels_ - 1);
    const Gate wide{capture_m_, capture_m_};
    parallel_for(context_, pairs_.size(), 1, [&](std::size_t k) {
      const Overlap& views = pairs_[k].views;
      std::vector<Match> all = find_matches(posed[views.a], posed[views.b], wide);
      const std::vector<Match> back = find_matches(posed[views.b], posed[views.a], wide);
      all.insert(all.end(), back.begin(), back.end());
      pairs_[k].start_m =
          all.size() < kFewestMatches ? scale_m_ : std::min(scale_m_, kStart * robust_spread(all, wide));
      pairs_[k].gate.distance_m = is_central(views.a) && is_central(views.b) ? typical_distance(all) : 0;
      pairs_[k].is_weak = all.size() < kFewestMatches;
    });
    double most = 0;
    for (const Pair& pair : pairs_) most = std::max(most, pair.start_m);
    scale_m_ = std::min(scale_m_, most);
  }

  static double typical_distance(const std::vector<Match>& matches) {
    std::vector<double> distances;
    for (const Match& match : matches) distances.push_back(double(match.distance_m));
    return middle(distances);
  }

  bool is_moving(std::size_t i) const { return result_.views[i].placement == ViewPlacement::kPlaced; }

  bool is_central(std::size_t i) const {
    return std::holds_alternative<PinholeSensor>(views_[i].sensor) ||
           std::holds_alternative<SphericalSensor>(views_[i].sensor);
  }

  // Closest points, where projection is a poor guide: for sensors without one centre, whose rays graze what others see
  // well, and for pairs that it finds too little of.
  std::vector<std::optional<KdTree>> make_trees(int level) const {
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

  // At one level, from the present scale to the finest that the level can tell.
  void refine(int level, int iterations) {
    const double finest = level > 0 ? kFinestScale * spacing_at(level) : 0;
    if (scale_m_ < finest) return;
    const std::vector<std::optional<KdTree>> trees = make_trees(level);
    for (int iteration = 0; iteration < iterations; ++iteration) {
      if (!step(level, trees, on_the_way())) continue;
      if (scale_m_ <= finest || scale_m_ < kNegligible * typical_noise()) break;
      scale_m_ = std::max(finest, kClosing * scale_m_);
    }
    if (level == 0) refine_with_all(trees);
  }

  std::size_t on_the_way() const {
    return std::max(kOnTheWayEach, kOnTheWay * n_ / (2 * std::max<std::size_t>(1, pairs_.size())));
  }

  // Coarse levels see motions as certain that the finest knows nothing of: what views moved along those is taken back.
  void refine_with_all(const std::vector<std::optional<KdTree>>& trees) {
    share_spots(trees);
    bool is_taken_back = false;
    for (int iteration = 0; iteration < kLastIterations; ++iteration) {
      if (!step(0, trees, kAll)) continue;
      if (is_taken_back || slid_.empty()) return;
      move_views(slid_);
      is_taken_back = true;
    }
  }

  // What all views know of each spot, so that what many show does not count many times. Poses hardly move from here on.
  void share_spots(const std::vector<std::optional<KdTree>>& trees) {
    std::vector<Posed> posed = posed_at(0);
    for (std::size_t i = 0; i < n_; ++i)
      if (trees[i] && !is_central(i)) posed[i].tree = &*trees[i];
    spots_ = find_spots(posed, gated_pairs(), context_);
  }

  std::vector<GatedPair> gated_pairs() const {
    std::vector<GatedPair> out;
    for (const Pair& pair : pairs_)
      if (!pair.is_dropped && pair.sums.matches > 0) out.push_back({pair.views.a, pair.views.b, pair.gate});
    return out;
  }

  // Poses and lines together, from the poses as given: lines that are off by degrees hold poses off as well.
  bool calibrate_lines() {
    StageScope stage(context_, "calibrate lines", kLineRounds);
    const std::vector<PlacedView> reached = result_.views;
    LineAngles angles;
    angles.reach_m = kLineReach * capture_m_;
    for (int round = 0; round < kLineRounds && step_lines(angles); ++round) stage.advance();
    const bool has_found =
        std::any_of(angles.firmness.begin(), angles.firmness.end(), [](double held) { return held > 0; });
    if (!has_found) result_.views = reached;
    // Where planes put the views is what later results are judged against.
    for (std::size_t i = 0; i < n_ && has_found; ++i) corrected_[i].T_world_view = result_.views[i].T_world_view;
    return has_found;
  }

  // Whether lines are still moving.
  bool step_lines(LineAngles& angles) {
    std::vector<LineView> views(n_);
    for (std::size_t i = 0; i < n_; ++i)
      views[i] = {&views_[i], !is_moving(i), center_of(i), std::max(pyramids_[i].radius_m, 1e-9)};
    const LineStep found = find_line_angles(views, posed_at(0), capture_m_, angles, context_);
    move_views(found.motion);
    for (std::size_t i = 0; i < n_; ++i) result_.views[i].line_offset_rad = angles.offsets_rad[i];
    if (std::any_of(angles.firmness.begin(), angles.firmness.end(), [](double held) { return held > 0; })) {
      correct_views();
      make_pyramids();
    }
    return !found.is_last;
  }

  // Poses are held while offsets are found, and the other way round.
  void calibrate() {
    StageScope stage(context_, "calibrate", kCalibrations);
    for (int round = 0; round < kCalibrations; ++round) {
      if (!add_range_offsets(views_, posed_at(0), gated_pairs(), kJudged, result_.corrections, context_)) break;
      correct_views();
      make_pyramids();
      step(0, make_trees(0), kJudged);
      stage.advance();
    }
    if (!corrected_.empty()) refine_with_all(make_trees(0));
  }

  void correct_views() {
    if (corrected_.empty()) corrected_.assign(given_.begin(), given_.end());
    parallel_for(context_, n_, 1, [&](std::size_t i) {
      const std::vector<double>& lines = result_.views[i].line_offset_rad;
      if (!lines.empty()) corrected_[i].sensor = corrected(std::get<SphericalSensor>(given_[i].sensor), lines);
      const auto found = result_.corrections.find(given_[i].sensor_id);
      if (found != result_.corrections.end()) corrected_[i].range = corrected(given_[i].range, found->second);
    });
    views_ = corrected_;
  }

  // Whether the views have hardly moved.
  bool step(int level, const std::vector<std::optional<KdTree>>& trees, std::size_t surfels) {
    associate_all(level, trees, surfels);
    std::vector<Vector6d> total(n_);
    for (std::size_t i = 0; i < n_; ++i) total[i] = motion_since_given(i);
    NetworkStep found = solve(false, level > 0 ? kCertainOnTheWay : kCertain, &total);
    slid_ = std::move(found.slid);
    const double moved = move_views(found.motion);
    ++result_.report.iterations;
    return moved <= kArrived * std::hypot(scale_m_, typical_noise());
  }

  void associate_all(int level, const std::vector<std::optional<KdTree>>& trees, std::size_t surfels) {
    std::vector<Posed> posed = posed_at(level);
    for (std::size_t i = 0; i < n_; ++i)
      if (trees[i]) posed[i].tree = &*trees[i];
    for (std::size_t i = 0; i < n_ && surfels == kAll && !spots_.empty(); ++i) posed[i].spots = &spots_[i];
    parallel_for(context_, pairs_.size(), 1, [&](std::size_t k) {
      if (!pairs_[k].is_dropped) associate(pairs_[k], posed, surfels);
    });
  }

  // Rotation, and translation of the centre.
  Vector6d motion_since_given(std::size_t i) const {
    const Eigen::Isometry3d &now = result_.views[i].T_world_view, &given = views_[i].T_world_view;
    const Eigen::AngleAxisd turn(Eigen::Matrix3d(now.linear() * given.linear().transpose()));
    Vector6d motion;
    motion << turn.angle() * turn.axis(), center_of(i) - given * pyramids_[i].center_in_view;
    return motion;
  }

  Eigen::Vector3d center_of(std::size_t i) const { return result_.views[i].T_world_view * pyramids_[i].center_in_view; }

  void associate(Pair& pair, const std::vector<Posed>& posed, std::size_t surfels) const {
    Posed a = posed[pair.views.a], b = posed[pair.views.b];
    if (!pair.is_weak && is_central(pair.views.a)) a.tree = nullptr;
    if (!pair.is_weak && is_central(pair.views.b)) b.tree = nullptr;
    pair.gate.scale_m = std::min(scale_m_, pair.start_m);
    const std::vector<Match> a_in_b = find_matches(a, b, pair.gate, thinning(*a.image, surfels)),
                             b_in_a = find_matches(b, a, pair.gate, thinning(*b.image, surfels));
    pair.sums = {};
    pair.center = 0.5 * (center_of(pair.views.a) + center_of(pair.views.b));
    if (a_in_b.size() + b_in_a.size() < kFewestMatches) return;
    measure_spread(pair, a_in_b, b_in_a);
    add_geometry(a, b, a_in_b, pair.gate, pair.center, 1, pair.sums);
    add_geometry(b, a, b_in_a, pair.gate, pair.center, -1, pair.sums);
    add_color(a, b, a_in_b, pair.gate, pair.center, 1, pair.sums);
    add_color(b, a, b_in_a, pair.gate, pair.center, -1, pair.sums);
  }

  // What the residuals show beyond the noise: a scale that the pair keeps when the scene's has become smaller.
  void measure_spread(Pair& pair, const std::vector<Match>& a_in_b, const std::vector<Match>& b_in_a) const {
    std::vector<Match> all = a_in_b;
    all.insert(all.end(), b_in_a.begin(), b_in_a.end());
    std::vector<double> noises, variances;
    for (const Match& match : all) {
      const double relative = pair.gate.relative_distance(match);
      noises.push_back(double(match.variance_m2));
      variances.push_back(double(match.variance_m2) / (relative * relative));
    }
    const double spread = robust_spread(all, pair.gate);
    pair.noise_m = std::sqrt(middle(noises));
    const double unexplained = std::sqrt(std::max(0.0, spread * spread - middle(variances)));
    pair.gate.unexplained_m = std::min({scale_m_, pair.start_m, unexplained});
  }

  double spacing_at(int level) const {
    std::vector<double> spacings;
    for (std::size_t i = 0; i < n_; ++i) spacings.push_back(image(i, level).spacing_m);
    return middle(spacings);
  }

  double typical_noise() const {
    std::vector<double> noises;
    for (const Pair& pair : pairs_)
      if (!pair.is_dropped && pair.sums.matches > 0) noises.push_back(pair.noise_m);
    return middle(noises);
  }

  std::vector<NetworkView> network_views() const {
    std::vector<NetworkView> out(n_);
    for (std::size_t i = 0; i < n_; ++i) out[i] = {!is_moving(i), center_of(i), std::max(pyramids_[i].radius_m, 1e-9)};
    return out;
  }

  NetworkStep solve(bool with_covariance, double least_certainty = kCertain,
                    const std::vector<Vector6d>* total = nullptr) {
    std::vector<NetworkPair> network;
    std::vector<PairSums> scaled;
    scaled.reserve(pairs_.size());
    const double factor = with_covariance ? 1 / (kCountedTwice * std::max(1.0, result_.report.variance_factor)) : 1.0;
    for (const Pair& pair : pairs_) {
      if (pair.is_dropped || pair.sums.matches == 0) continue;
      scaled.push_back(pair.sums);
      scaled.back().H *= factor;
      scaled.back().feigned *= factor;
      network.push_back({pair.views.a, pair.views.b, pair.center, &scaled.back()});
    }
    return solve_network(network_views(), network, {capture_m_, least_certainty, with_covariance, total}, context_);
  }

  // The longest way that any point of any view went.
  double move_views(const std::vector<Vector6d>& motion) {
    double longest = 0;
    for (std::size_t i = 0; i < n_; ++i) {
      if (!is_moving(i)) continue;
      const Eigen::Vector3d turn = motion[i].head<3>(), shift = motion[i].tail<3>();
      const Eigen::Vector3d center = center_of(i);
      const double angle = turn.norm();
      Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
      if (angle > 0) T.linear() = Eigen::AngleAxisd(angle, turn / angle).toRotationMatrix();
      T.translation() = center + shift - T.linear() * center;
      Eigen::Isometry3d& pose = result_.views[i].T_world_view;
      pose = T * pose;
      pose.linear() = Eigen::Quaterniond(pose.linear()).normalized().toRotationMatrix();
      longest = std::max(longest, shift.norm() + pyramids_[i].radius_m * angle);
    }
    return longest;
  }

  // ---- what came of it

  struct Agreement {
    PairResidual residual;
    double gain = 0;
  };

  // Of a pair under given poses: all matches within the capture range, and how well they fit by the final gate.
  Agreement agreement(const Pair& pair, const Posed& a, const Posed& b) const {
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

  // Compares with the poses as given. Views and pairs that got worse are left out, and the rest is refined once more.
  void judge() {
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

  static bool is_worse(double before, double after) { return after < before - kChance * std::sqrt(before); }

  // Whether anything was left out that was not before.
  bool refuse(const std::vector<Agreement>& before, const std::vector<Agreement>& after) {
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

  // Whether views would fall apart without the pair.
  bool is_needed(std::size_t k) const {
    std::vector<Overlap> links;
    for (std::size_t i = 0; i < pairs_.size(); ++i)
      if (i != k && !pairs_[i].is_dropped && pairs_[i].sums.matches > 0) links.push_back(pairs_[i].views);
    const std::vector<std::uint32_t> part = linked_parts(links, n_);
    return part[pairs_[k].views.a] != part[pairs_[k].views.b];
  }

  bool is_lost(std::size_t i) const {
    const Vector6d motion = motion_since_given(i);
    return std::max(motion.tail<3>().norm(), pyramids_[i].radius_m * motion.head<3>().norm()) > capture_m_;
  }

  void leave(std::size_t i, const std::string& problem) {
    result_.views[i].placement = ViewPlacement::kRefused;
    result_.views[i].problem = problem;
    result_.views[i].T_world_view = views_[i].T_world_view;
    for (std::size_t k = 0; k < pairs_.size(); ++k)
      if (pairs_[k].views.a == i || pairs_[k].views.b == i) drop(k, "one of its views was left where it was");
  }

  void drop(std::size_t k, const std::string& problem) {
    if (pairs_[k].is_dropped) return;
    pairs_[k].is_dropped = true;
    result_.report.pairs[k].problem = problem;
  }

  void report_pairs(const std::vector<Agreement>& before, const std::vector<Agreement>& after) {
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

  void finish() {
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

  // From a motion about a centre, rotation first, to one about the view's origin, translation first.
  static PoseCovariance about_origin(const Matrix6d& covariance, const Eigen::Vector3d& d) {
    Matrix6d A = Matrix6d::Zero();
    A.topRightCorner<3, 3>().setIdentity();
    A.topLeftCorner<3, 3>() << 0, d.z(), -d.y(), -d.z(), 0, d.x(), d.y(), -d.x(), 0;  // t + ω × d
    A.bottomLeftCorner<3, 3>().setIdentity();
    return A * covariance * A.transpose();
  }

  Sliding describe(const SlidingMode& mode) const {
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

  const std::span<const View> given_;
  std::span<const View> views_;  // as given, or without what their sensors are off by
  std::vector<View> corrected_;
  const std::span<const NoiseModel> noise_;
  const PictureOf& pictures_;
  const RegisterOptions& options_;
  Context& context_;
  const std::size_t n_;
  RegisterResult result_;
  std::vector<bool> is_symmetric_in_range_;
  std::vector<SurfelPyramid> pyramids_;
  int levels_ = 0;
  double capture_m_ = 0;
  double scale_m_ = 0;
  std::vector<Vector6d> slid_;  // what takes back the motion along what the last step found undetermined
  std::vector<Pair> pairs_;
  std::vector<std::vector<Spot>> spots_;  // of the finest level, once views are nearly in place
};

}  // namespace

const char* name_of(ViewPlacement placement) {
  constexpr std::array<const char*, 4> kNames = {"fixed", "placed", "unlinked", "refused"};
  return kNames[std::size_t(placement)];
}

RegisterResult register_views(std::span<const View> views, std::span<const NoiseModel> noise, const PictureOf& pictures,
                              const RegisterOptions& options, Context& context) {
  return Registrar(views, noise, pictures, options, context).run();
}

}  // namespace lapseam
