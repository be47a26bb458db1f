// Based on: G. Barequet, M. Sharir, Filling Gaps in the Boundary of a Polyhedron, 1995 (dynamic programming over
// chains); P. Liepa, Filling Holes in Meshes, 2003 (folds before area); W. Zhao, S. Gao, H. Lin, A robust hole-filling
// algorithm for triangular mesh, 2007 (sharpest corners first).

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <queue>
#include <unordered_set>
#include <utility>

#include "sew_meshes/loops.h"

namespace lapseam {
namespace {

struct Cost {
  float open_m = std::numeric_limits<float>::infinity();  ///< length of outline that is left
  float worst = std::numeric_limits<float>::infinity();
  float sum = std::numeric_limits<float>::infinity();
  bool operator<(const Cost& o) const {
    if (open_m != o.open_m) return open_m < o.open_m;
    return worst != o.worst ? worst < o.worst : sum < o.sum;
  }
};

enum class Remainder {
  kNone,    ///< all of the loop is triangulated, or nothing
  kAllowed  ///< parts of it may stay open
};

/// The best triangulation of a loop, again and again, without triangles that turned out to be impossible.
class LoopSolver {
 public:
  LoopSolver(const LiveMesh& mesh, const TriangleCheck& check, const Loop& loop, LoopGoal goal, Remainder remainder,
             const TriangleRule& rule)
      : mesh_(mesh),
        check_(check),
        rule_(rule),
        loop_(loop),
        n_(loop.size()),
        goal_(goal),
        remainder_(remainder),
        sharpest_turn_(0.5f * (1 - float(rule.fold_cosine)) + kRounding),
        position_(n_),
        across_(n_) {
    for (std::size_t i = 0; i < n_; ++i) {
      position_[i] = mesh.position(loop[i]).cast<double>();
      across_[i] = mesh.area_normal(mesh.find(loop[i], loop[(i + 1) % n_])).stableNormalized().cast<float>();
    }
    mark_existing_edges();
    from_.assign(n_ * n_, Cost{});
    to_.assign(n_ * n_, Cost{});
    split_.assign(n_ * n_, kNowhere);
    normal_.assign(n_ * n_, Eigen::Vector3f::Zero());
    is_stale_.assign(n_ * n_, 0);
    if (remainder_ == Remainder::kAllowed) {
      length_m_.resize(n_ * n_);
      for (std::size_t i = 0; i < n_; ++i)
        for (std::size_t j = i; j < n_; ++j)
          length_m_[i * n_ + j] = length_m_[j * n_ + i] = float((position_[j] - position_[i]).norm());
      part_m_.assign(n_ * n_, std::numeric_limits<float>::infinity());
      way_m_ = rest_m_ = part_m_;
      first_.assign(n_ * n_, 0);
    }
    for (std::size_t i = 0; i + 1 < n_; ++i) {
      normal_[i * n_ + i + 1] = across_[i];
      if (remainder_ == Remainder::kAllowed) way_m_[i * n_ + i + 1] = length_m_[i * n_ + i + 1];
      set_cost(i, i + 1, {0, 0, 0});
    }
    for (std::size_t i = 0; i + 2 < n_; ++i) is_stale_[i * n_ + i + 2] = 1;
  }

  /// Places in the loop (k, i, j) of each triangle; empty: there is no triangulation left. Chains that contain nothing
  /// forbidden since the last time keep what was found.
  std::vector<std::array<std::size_t, 3>> solve() {
    for (std::size_t length = 2; length < n_; ++length)
      for (std::size_t i = 0; i + length < n_; ++i) {
        const std::size_t j = i + length;
        std::uint8_t& is_stale = is_stale_[i * n_ + j];
        is_stale |= std::uint8_t(is_stale_[(i + 1) * n_ + j] | is_stale_[i * n_ + j - 1]);
        if (is_stale) solve_chain(i, j);
      }
    std::fill(is_stale_.begin(), is_stale_.end(), std::uint8_t(0));
    std::vector<std::array<std::size_t, 3>> triangles;
    if (std::isinf(from_[n_ - 1].open_m)) return triangles;
    std::vector<std::pair<std::size_t, std::size_t>> chains = {{0, n_ - 1}};
    while (!chains.empty()) {
      const auto [i, j] = chains.back();
      chains.pop_back();
      if (j - i < 2) continue;
      const std::size_t k = split_[i * n_ + j];
      if (k == kOpen) {
        follow_way(i, j, chains);
        continue;
      }
      triangles.push_back({k, i, j});
      chains.emplace_back(i, k);
      chains.emplace_back(k, j);
    }
    return triangles;
  }

  /// Whether a triangle may stand in the mesh as it is now. If not, it is forbidden.
  bool test(const std::array<std::size_t, 3>& t) {
    const bool is_valid = check_.is_valid(triangle(t), rule_);
    if (is_valid) {
      allowed_.insert(key(t));
    } else {
      forbidden_.insert(key(t));
      is_stale_[t[1] * n_ + t[2]] = 1;
    }
    return is_valid;
  }

  /// From now on, triangles are tested before they count, up to so many of them; the rest are left out.
  void test_first(std::size_t most_tests) {
    tests_left_ = most_tests;
    does_test_first_ = true;
    std::fill(is_stale_.begin(), is_stale_.end(), std::uint8_t(1));
  }
  Triangle triangle(const std::array<std::size_t, 3>& t) const { return {loop_[t[0]], loop_[t[1]], loop_[t[2]]}; }

 private:
  std::uint64_t key(const std::array<std::size_t, 3>& t) const { return (t[0] * n_ + t[1]) * n_ + t[2]; }

  /// A diagonal may not be an edge that exists already.
  void mark_existing_edges() {
    is_edge_.assign(n_ * n_, 0);
    std::vector<std::pair<std::uint32_t, std::size_t>> places(n_);
    for (std::size_t i = 0; i < n_; ++i) places[i] = {loop_[i], i};
    std::sort(places.begin(), places.end());
    for (std::size_t i = 0; i < n_; ++i)
      mesh_.for_each_around(loop_[i], [&](std::uint32_t t) {
        for (const std::uint32_t v : mesh_.triangle(t)) {
          const auto place = std::lower_bound(places.begin(), places.end(), std::pair(v, std::size_t{0}));
          if (place == places.end() || place->first != v) continue;
          const std::size_t j = place->second;
          if (j >= i + 2 && !(i == 0 && j + 1 == n_)) is_edge_[i * n_ + j] = 1;
        }
      });
  }

  static float turn(const Eigen::Vector3f& a, const Eigen::Vector3f& b) { return 0.5f * (1 - a.dot(b)); }

  /// At the edge that a chain ends in; none where what is across is left open.
  float fold_across(std::size_t i, std::size_t j, const Eigen::Vector3f& normal) const {
    return split_[i * n_ + j] == kOpen ? 0 : turn(normal, normal_[i * n_ + j]);
  }

  void solve_chain(std::size_t i, std::size_t j) {
    const bool may_stay_open = remainder_ == Remainder::kAllowed;
    if (may_stay_open) find_way(i, j);
    // What was best the last time, or for the chain without its last edge, is tried first: most others are worse at
    // first sight.
    std::size_t guess = split_[i * n_ + j];
    if (!is_between(guess, i, j)) guess = split_[i * n_ + j - 1];
    Cost best;
    split_[i * n_ + j] = kNowhere;
    if (!is_edge_[i * n_ + j]) {
      if (may_stay_open) {
        best = {way_m_[i * n_ + j] + length_m_[i * n_ + j], 0, 0};
        split_[i * n_ + j] = kOpen;
      }
      if (is_between(guess, i, j)) try_triangle(guess, i, j, best);
      for (std::size_t k = i + 1; k < j; ++k) try_triangle(k, i, j, best);
    }
    set_cost(i, j, best);
  }

  static bool is_between(std::size_t k, std::size_t i, std::size_t j) { return k > i && k < j; }

  void try_triangle(std::size_t k, std::size_t i, std::size_t j, Cost& best) {
    const Cost &left = from_[i * n_ + k], &right = to_[j * n_ + k];
    Cost cost = {left.open_m + right.open_m, std::max(left.worst, right.worst), left.sum + right.sum};
    if (!(cost < best)) return;
    const Eigen::Vector3d ki = position_[i] - position_[k], kj = position_[j] - position_[k];
    const Eigen::Vector3d area2 = ki.cross(kj);
    const double length = area2.norm();
    if (!(length > 0)) return;
    const Eigen::Vector3f normal = (area2 / length).cast<float>();
    float fold = std::max(fold_across(i, k, normal), fold_across(k, j, normal));
    if (i == 0 && j + 1 == n_) fold = std::max(fold, turn(normal, across_[n_ - 1]));
    if (fold > sharpest_turn_) return;
    if (goal_ == LoopGoal::kArea) {
      cost = {cost.open_m, std::max(cost.worst, fold), cost.sum + float(length)};
    } else {
      const double sides[3] = {ki.squaredNorm(), kj.squaredNorm(), (ki - kj).squaredNorm()};
      const double longest = std::max({sides[0], sides[1], sides[2]});
      const double shortest = std::min({sides[0], sides[1], sides[2]});
      const double middle = sides[0] + sides[1] + sides[2] - longest - shortest;
      const float shape = std::max(0.0f, 1 - float(length / std::sqrt(longest * middle)) / 0.8660254f);
      cost = {cost.open_m, std::max({cost.worst, shape, fold}), cost.sum + shape + fold};
    }
    if (!(cost < best) || !is_possible({k, i, j})) return;
    best = cost;
    split_[i * n_ + j] = k;
    normal_[i * n_ + j] = normal;
  }

  bool is_possible(const std::array<std::size_t, 3>& t) {
    if (forbidden_.contains(key(t))) return false;
    if (!does_test_first_ || allowed_.contains(key(t))) return true;
    return tests_left_ > 0 && (--tests_left_, test(t));
  }

  void set_cost(std::size_t i, std::size_t j, const Cost& cost) {
    from_[i * n_ + j] = to_[j * n_ + i] = cost;
    if (remainder_ == Remainder::kNone) return;
    part_m_[i * n_ + j] = length_m_[i * n_ + j] + cost.open_m;
    rest_m_[j * n_ + i] = std::min(way_m_[i * n_ + j], part_m_[i * n_ + j]);
  }

  /// The outline that is left of a chain whose end edge has a hole behind it: from vertex to vertex along the loop, or
  /// across parts of it that are filled; with what is left within those.
  void find_way(std::size_t i, std::size_t j) {
    using Lengths = Eigen::Map<const Eigen::ArrayXf>;
    const auto between = Eigen::Index(j - i - 1);
    const auto sum = Lengths(&part_m_[i * n_ + i + 1], between) + Lengths(&rest_m_[j * n_ + i + 1], between);
    const float least = sum.minCoeff();
    Eigen::Index first = 0;
    while (first + 1 < between && sum[first] != least) ++first;
    way_m_[i * n_ + j] = least;
    first_[i * n_ + j] = i + 1 + std::size_t(first);
  }

  /// Adds the filled parts along the way to the chains.
  void follow_way(std::size_t i, std::size_t j, std::vector<std::pair<std::size_t, std::size_t>>& chains) const {
    for (std::size_t k = first_[i * n_ + j];; k = first_[i * n_ + j]) {
      chains.emplace_back(i, k);
      i = k;
      if (j <= i + 1) return;
      if (part_m_[i * n_ + j] < way_m_[i * n_ + j]) {
        chains.emplace_back(i, j);
        return;
      }
    }
  }

  static constexpr float kRounding = 1e-5f;
  // In place of a split: the chain stays open; there is no triangulation of it.
  static constexpr std::size_t kOpen = std::numeric_limits<std::size_t>::max(), kNowhere = 0;

  const LiveMesh& mesh_;
  const TriangleCheck& check_;
  const TriangleRule& rule_;
  const Loop& loop_;
  std::size_t n_;
  LoopGoal goal_;
  Remainder remainder_;
  float sharpest_turn_;
  std::vector<Eigen::Vector3d> position_;
  std::vector<Eigen::Vector3f> across_;  // of each edge, the unit normal of the triangle on its other side
  std::vector<std::uint8_t> is_edge_;
  // Of each chain the best, by its first and by its last vertex: the loops over what is between run along memory.
  std::vector<Cost> from_, to_;
  std::vector<std::size_t> split_;
  std::vector<Eigen::Vector3f> normal_;
  std::vector<std::uint8_t> is_stale_;
  bool does_test_first_ = false;
  std::size_t tests_left_ = 0;
  std::unordered_set<std::uint64_t> forbidden_, allowed_;  // membership only
  // Where parts may stay open, of each chain: the length of its end edge; what is left open with that edge, without it,
  // and the less of both (by last vertex); where the first part of the way without it ends.
  std::vector<float> length_m_, part_m_, way_m_, rest_m_;
  std::vector<std::size_t> first_;
};

/// Adds the triangles one by one. Those that do not fit are forbidden, and all are taken back.
bool try_to_add(LiveMesh& mesh, TriangleCheck& check, LoopSolver& solver,
                const std::vector<std::array<std::size_t, 3>>& triangles, TriangleTag tag) {
  bool is_possible = true;
  for (const auto& t : triangles) is_possible &= solver.test(t);
  if (!is_possible) return false;
  std::vector<std::uint32_t> added;
  for (const auto& t : triangles) {
    if (!solver.test(t)) {  // it meets one of those before it
      for (const std::uint32_t id : added) mesh.remove(id);
      return false;
    }
    added.push_back(check.add(solver.triangle(t), tag));
  }
  return true;
}

/// Whether an edge has no third vertex with which it would make a triangle: then nothing closes the loop.
bool has_edge_without_triangle(const TriangleCheck& check, const Loop& loop, const TriangleRule& rule) {
  const std::size_t n = loop.size();
  for (std::size_t i = 0; i < n; ++i) {
    bool is_found = false;
    for (std::size_t step = 1; step + 1 < n && !is_found; ++step) {
      // Vertices near along the loop first, from both sides: most triangles have one of them.
      const std::size_t away = (step + 1) / 2;
      const std::size_t k = (step % 2 == 1 ? i + 1 + away : i + n - away) % n;
      is_found = check.may_fit({loop[(i + 1) % n], loop[i], loop[k]}, rule);
    }
    if (!is_found) return true;
  }
  return false;
}

// Of parts of a loop there is always some triangulation that would be better: those are tested that would be best, then
// triangles before they count, so few that the longest loops take no more than ten times as long.
constexpr std::size_t kGuesses = 8, kMostTests = 10000;
constexpr std::size_t kAttemptsAfterTests = 3;  // tested triangles may still meet each other

/// Returns how many triangles it took; 0: nothing has changed.
std::size_t add_triangulation(LiveMesh& mesh, TriangleCheck& check, LoopSolver& solver, std::size_t attempts,
                              TriangleTag tag) {
  for (std::size_t attempt = 0; attempt < attempts; ++attempt) {
    const auto triangles = solver.solve();
    if (triangles.empty()) return 0;
    if (try_to_add(mesh, check, solver, triangles, tag)) return triangles.size();
  }
  return 0;
}

bool close_whole(LiveMesh& mesh, TriangleCheck& check, const Loop& loop, LoopGoal goal, const TriangleRule& rule,
                 TriangleTag tag, LoopEffort effort) {
  if (has_edge_without_triangle(check, loop, rule)) return false;
  LoopSolver solver(mesh, check, loop, goal, Remainder::kNone, rule);
  const std::size_t attempts =
      std::clamp<std::size_t>(6000 / loop.size(), 30, 300) / (effort == LoopEffort::kQuick ? 4 : 1);
  return add_triangulation(mesh, check, solver, attempts, tag) > 0;
}

/// Cuts corners of a loop until `target` are left or none can be cut; the sharpest first.
class EarCutter {
 public:
  EarCutter(LiveMesh& mesh, TriangleCheck& check, const Loop& loop, const TriangleRule& rule, TriangleTag tag)
      : mesh_(mesh), check_(check), loop_(loop), rule_(rule), tag_(tag), next_(loop.size()), previous_(loop.size()) {
    for (std::size_t i = 0; i < loop.size(); ++i) {
      next_[i] = (i + 1) % loop.size();
      previous_[(i + 1) % loop.size()] = i;
    }
  }

  Loop cut(std::size_t target) {
    std::size_t left = loop_.size();
    for (std::size_t i = 0; i < loop_.size(); ++i) push(i);
    while (left > target && !queue_.empty()) {
      const Ear ear = queue_.top();
      queue_.pop();
      // Out of date: one of its neighbours was cut, and the corner is in the queue again.
      if (next_[ear.at] != ear.next || previous_[ear.at] != ear.previous) continue;
      const Triangle t = triangle(ear);
      if (!check_.is_valid(t, rule_)) continue;
      added_.push_back(check_.add(t, tag_));
      next_[ear.previous] = ear.next;
      previous_[ear.next] = ear.previous;
      next_[ear.at] = loop_.size();
      --left;
      push(ear.previous);
      push(ear.next);
    }
    Loop rest;
    std::size_t first = 0;
    while (next_[first] == loop_.size()) ++first;
    std::size_t i = first;
    do {
      rest.push_back(loop_[i]);
      i = next_[i];
    } while (i != first);
    return rest;
  }

  void take_back() {
    for (const std::uint32_t id : added_) mesh_.remove(id);
  }

 private:
  struct Ear {
    double cosine;
    std::size_t at, previous, next;
    bool operator<(const Ear& o) const { return cosine != o.cosine ? cosine < o.cosine : at > o.at; }
  };
  Triangle triangle(const Ear& ear) const { return {loop_[ear.at], loop_[ear.previous], loop_[ear.next]}; }

  void push(std::size_t i) {
    Ear ear = {0, i, previous_[i], next_[i]};
    const auto p = [&](std::size_t k) -> Eigen::Vector3d { return mesh_.position(loop_[k]).cast<double>(); };
    ear.cosine = (p(ear.previous) - p(i)).normalized().dot((p(ear.next) - p(i)).normalized());
    // A corner that the surface fills from behind is no ear: its triangle would face against its neighbours.
    if (std::isfinite(ear.cosine) && check_.does_fit(triangle(ear), rule_)) queue_.push(ear);
  }

  LiveMesh& mesh_;
  TriangleCheck& check_;
  const Loop& loop_;
  const TriangleRule& rule_;
  TriangleTag tag_;
  std::vector<std::size_t> next_, previous_;
  std::priority_queue<Ear> queue_;
  std::vector<std::uint32_t> added_;
};

}  // namespace

std::size_t fill_loop(LiveMesh& mesh, TriangleCheck& check, const Loop& loop, LoopGoal goal, const TriangleRule& rule,
                      TriangleTag tag) {
  if (loop.size() < 3 || loop.size() > kLargestWhole) return 0;
  LoopSolver solver(mesh, check, loop, goal, Remainder::kAllowed, rule);
  if (const std::size_t added = add_triangulation(mesh, check, solver, kGuesses, tag)) return added;
  solver.test_first(kMostTests);
  return add_triangulation(mesh, check, solver, kAttemptsAfterTests, tag);
}

std::size_t cut_ears(LiveMesh& mesh, TriangleCheck& check, const Loop& loop, const TriangleRule& rule,
                     TriangleTag tag) {
  EarCutter cutter(mesh, check, loop, rule, tag);
  return loop.size() - cutter.cut(3).size();
}

bool close_loop(LiveMesh& mesh, TriangleCheck& check, const Loop& loop, LoopGoal goal, const TriangleRule& rule,
                TriangleTag tag, LoopEffort effort) {
  if (loop.size() < 3) return false;
  if (loop.size() <= kLargestWhole) return close_whole(mesh, check, loop, goal, rule, tag, effort);
  TriangleRule gentle = rule;
  gentle.fold_cosine = std::max(rule.fold_cosine, 0.0);
  EarCutter cutter(mesh, check, loop, gentle, tag);
  const Loop rest = cutter.cut(kLargestWhole);
  if (rest.size() <= 2 * kLargestWhole && close_whole(mesh, check, rest, goal, rule, tag, effort)) return true;
  cutter.take_back();
  return false;
}

}  // namespace lapseam
