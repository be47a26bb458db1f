// Joint registration of many range images, coarse to fine. After K. Pulli, Multiview registration for large data sets,
// 1999, and S. Krishnan et al., 2005 (all views at once); the parts are in associate.cpp and network.cpp.

#include "lapseam/register.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "core/parallel.h"
#include "lapseam/error.h"
#include "register/brightness.h"
#include "register/registrar.h"

namespace lapseam {
namespace {

// Surfels of a view at the finest level: more add time and little else, since each is a mean of many samples.
constexpr std::size_t kMostSurfels = 25'000;
// Share of what a view sees that its points may be off by.
constexpr double kCaptureShare = 0.1;
constexpr int kCoarseIterations = 30, kFineIterations = 12;
// Views that move less than this share of the scale have arrived, and the scale is halved: what is left of surfaces
// that were off farther is told from what never fits (graduated non-convexity: Blake and Zisserman 1987).
constexpr double kArrived = 0.1, kClosing = 0.5;
// A scale below this share of the noise is no different from none.
constexpr double kNegligible = 0.25;
// Of the distance between surfels: edges are known no better, so that the next level has to go on.
constexpr double kFinestScale = 1.0 / 16;
constexpr int kLastIterations = 4;

}  // namespace

Registrar::Registrar(std::span<const View> views, std::span<const NoiseModel> noise, const PictureOf& pictures,
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

RegisterResult Registrar::run() {
  result_.views.resize(n_);
  for (std::size_t i = 0; i < n_; ++i) result_.views[i].T_world_view = views_[i].T_world_view;
  if (n_ == 0) return std::move(result_);
  make_pyramids();
  set_capture_range();
  link();
  refine_all();
  if (options_.calibrate && calibrate_lines()) {
    link();
    descend(0);  // planes have put views nearly in place; coarse levels would slide along them
    refine_with_all(make_trees(0));
  }
  if (options_.calibrate) calibrate();
  mend_misplaced();
  StageScope stage(context_, "judge registration");
  judge();
  finish();
  return std::move(result_);
}

void Registrar::make_pyramids() {
  StageScope stage(context_, "surfels", n_);
  pyramids_.resize(n_);
  brightness_.resize(n_);
  parallel_for(context_, n_, 1, [&](std::size_t i) {
    BrightnessAt& brightness = brightness_[i];
    if (!brightness && options_.use_color && pictures_)
      if (const auto picture = pictures_(i)) brightness = make_brightness(*picture);
    pyramids_[i] = make_surfels(views_[i], noise_[i], kMostSurfels, brightness);
    stage.advance();
  });
}

void Registrar::set_capture_range() {
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

const SurfelImage& Registrar::image(std::size_t i, int level) const {
  const auto& levels = pyramids_[i].levels;
  return levels[std::min(std::size_t(level), levels.size() - 1)];
}

std::vector<Posed> Registrar::posed_at(int level) const {
  std::vector<Posed> out(n_);
  for (std::size_t i = 0; i < n_; ++i)
    out[i] = {&image(i, level), &views_[i].sensor, nullptr, &pyramids_[i].box_in_view, result_.views[i].T_world_view};
  return out;
}

void Registrar::refine_all() {
  StageScope stage(context_, "register", std::uint64_t(levels_));
  for (int level = levels_ - 1; level >= 0; --level) {
    descend(level);
    stage.advance();
  }
  refine_with_all(make_trees(0));
}

bool Registrar::is_moving(std::size_t i) const { return result_.views[i].placement == ViewPlacement::kPlaced; }

bool Registrar::is_central(std::size_t i) const { return lapseam::is_central(views_[i].sensor); }

void Registrar::descend(int level) {
  const double finest = level > 0 ? kFinestScale * spacing_at(level) : 0;
  const int iterations = level > 0 ? kCoarseIterations : kFineIterations;
  if (scale_m_ < finest) return;
  const std::vector<std::optional<KdTree>> trees = make_trees(level);
  for (int iteration = 0; iteration < iterations; ++iteration) {
    if (!step(level, trees, on_the_way_)) continue;
    if (scale_m_ <= finest || scale_m_ < kNegligible * typical_noise()) break;
    scale_m_ = std::max(finest, kClosing * scale_m_);
  }
}

void Registrar::refine_with_all(const std::vector<std::optional<KdTree>>& trees) {
  share_spots(trees);
  bool is_taken_back = false;
  for (int iteration = 0; iteration < kLastIterations; ++iteration) {
    if (!step(0, trees, kAll)) continue;
    if (is_taken_back || slid_.empty()) return;
    move_views(slid_);
    is_taken_back = true;
  }
}

void Registrar::share_spots(const std::vector<std::optional<KdTree>>& trees) {
  std::vector<Posed> posed = posed_at(0);
  for (std::size_t i = 0; i < n_; ++i)
    if (trees[i] && !is_central(i)) posed[i].tree = &*trees[i];
  spots_ = find_spots(posed, gated_pairs(), context_);
}

bool Registrar::step(int level, const std::vector<std::optional<KdTree>>& trees, std::size_t surfels) {
  associate_all(level, trees, surfels);
  std::vector<Vector6d> total(n_);
  for (std::size_t i = 0; i < n_; ++i) total[i] = motion_since_given(i);
  NetworkStep found = solve(false, level > 0 ? kCertainOnTheWay : kCertain, &total);
  slid_ = std::move(found.slid);
  const double moved = move_views(found.motion);
  ++result_.report.iterations;
  return moved <= kArrived * std::hypot(scale_m_, typical_noise());
}

void Registrar::associate_all(int level, const std::vector<std::optional<KdTree>>& trees, std::size_t surfels) {
  std::vector<Posed> posed = posed_at(level);
  for (std::size_t i = 0; i < n_; ++i)
    if (trees[i]) posed[i].tree = &*trees[i];
  for (std::size_t i = 0; i < n_ && surfels == kAll && !spots_.empty(); ++i) {
    posed[i].spots = &spots_[i];
    if (brightness_[i]) posed[i].brightness = &brightness_[i];
  }
  parallel_for(context_, pairs_.size(), 1, [&](std::size_t k) {
    if (!pairs_[k].is_dropped) associate(pairs_[k], posed, surfels);
  });
}

Vector6d Registrar::motion_since_given(std::size_t i) const {
  const Eigen::Isometry3d &now = result_.views[i].T_world_view, &given = views_[i].T_world_view;
  const Eigen::AngleAxisd turn(Eigen::Matrix3d(now.linear() * given.linear().transpose()));
  Vector6d motion;
  motion << turn.angle() * turn.axis(), center_of(i) - given * pyramids_[i].center_in_view;
  return motion;
}

Eigen::Vector3d Registrar::center_of(std::size_t i) const {
  return result_.views[i].T_world_view * pyramids_[i].center_in_view;
}

void Registrar::associate(Pair& pair, const std::vector<Posed>& posed, std::size_t surfels) const {
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

void Registrar::measure_spread(Pair& pair, const std::vector<Match>& a_in_b, const std::vector<Match>& b_in_a) const {
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

double Registrar::spacing_at(int level) const {
  std::vector<double> spacings;
  for (std::size_t i = 0; i < n_; ++i) spacings.push_back(image(i, level).spacing_m);
  return middle(spacings);
}

double Registrar::typical_noise() const {
  std::vector<double> noises;
  for (const Pair& pair : pairs_)
    if (!pair.is_dropped && pair.sums.matches > 0) noises.push_back(pair.noise_m);
  return middle(noises);
}

std::vector<NetworkView> Registrar::network_views() const {
  std::vector<NetworkView> out(n_);
  for (std::size_t i = 0; i < n_; ++i) {
    out[i] = {!is_moving(i), center_of(i), std::max(pyramids_[i].radius_m, 1e-9)};
    if (known_.empty()) continue;
    out[i].known = known_[i];
    out[i].away = motion_since_given(i);
  }
  return out;
}

NetworkStep Registrar::solve(bool with_covariance, double least_certainty, const std::vector<Vector6d>* total) {
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

double Registrar::move_views(const std::vector<Vector6d>& motion) {
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

const char* name_of(ViewPlacement placement) {
  constexpr std::array<const char*, 4> kNames = {"fixed", "placed", "unlinked", "refused"};
  return kNames[std::size_t(placement)];
}

std::string warning_about(const std::string& name, const PlacedView& view) {
  if (view.problem.empty()) return {};
  const bool is_left = view.placement != ViewPlacement::kPlaced;
  return "view " + name + (is_left ? " was left where it was: " : " may be misplaced: ") + view.problem;
}

RegisterResult register_views(std::span<const View> views, std::span<const NoiseModel> noise, const PictureOf& pictures,
                              const RegisterOptions& options, Context& context) {
  return Registrar(views, noise, pictures, options, context).run();
}

}  // namespace lapseam
