// Based on: G. Barequet, M. Sharir, Filling Gaps in the Boundary of a Polyhedron, 1995 (dynamic programming over
// chains); P. Liepa, Filling Holes in Meshes, 2003 (folds before area); W. Zhao, S. Gao, H. Lin, A robust hole-filling
// algorithm for triangular mesh, 2007 (sharpest corners first).

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <queue>
#include <unordered_set>

#include "sew_meshes/loops.h"

namespace lapseam {
namespace {

struct Cost {
  float worst = std::numeric_limits<float>::infinity();
  float sum = std::numeric_limits<float>::infinity();
  bool operator<(const Cost& o) const { return worst != o.worst ? worst < o.worst : sum < o.sum; }
};

/// The best triangulation of a loop, again and again, without triangles that turned out to be impossible.
class LoopSolver {
 public:
  LoopSolver(const LiveMesh& mesh, const Loop& loop, LoopGoal goal)
      : mesh_(mesh), loop_(loop), n_(loop.size()), goal_(goal), position_(n_), across_(n_) {
    for (std::size_t i = 0; i < n_; ++i) {
      position_[i] = mesh.position(loop[i]).cast<double>();
      across_[i] = mesh.area_normal(mesh.find(loop[i], loop[(i + 1) % n_])).stableNormalized().cast<float>();
    }
    mark_existing_edges();
  }

  /// Places in the loop (k, i, j) of each triangle; empty: there is no triangulation left.
  std::vector<std::array<std::size_t, 3>> solve() {
    best_.assign(n_ * n_, Cost{});
    split_.assign(n_ * n_, 0);
    normal_.assign(n_ * n_, Eigen::Vector3f::Zero());
    for (std::size_t i = 0; i + 1 < n_; ++i) {
      best_[i * n_ + i + 1] = {0, 0};
      normal_[i * n_ + i + 1] = across_[i];
    }
    for (std::size_t length = 2; length < n_; ++length)
      for (std::size_t i = 0; i + length < n_; ++i) solve_chain(i, i + length);
    std::vector<std::array<std::size_t, 3>> triangles;
    if (std::isinf(best_[n_ - 1].worst)) return triangles;
    std::vector<std::pair<std::size_t, std::size_t>> chains = {{0, n_ - 1}};
    while (!chains.empty()) {
      const auto [i, j] = chains.back();
      chains.pop_back();
      if (j - i < 2) continue;
      const std::size_t k = split_[i * n_ + j];
      triangles.push_back({k, i, j});
      chains.emplace_back(i, k);
      chains.emplace_back(k, j);
    }
    return triangles;
  }

  void forbid(const std::array<std::size_t, 3>& t) { forbidden_.insert(key(t[0], t[1], t[2])); }
  Triangle triangle(const std::array<std::size_t, 3>& t) const { return {loop_[t[0]], loop_[t[1]], loop_[t[2]]}; }

 private:
  std::uint64_t key(std::size_t k, std::size_t i, std::size_t j) const { return (k * n_ + i) * n_ + j; }

  /// A diagonal may not be an edge that exists already.
  void mark_existing_edges() {
    is_edge_.assign(n_ * n_, 0);
    for (std::size_t i = 0; i < n_; ++i)
      for (std::size_t j = i + 2; j < n_; ++j)
        if (!(i == 0 && j + 1 == n_))
          is_edge_[i * n_ + j] =
              mesh_.find(loop_[i], loop_[j]) != kInvalidIndex || mesh_.find(loop_[j], loop_[i]) != kInvalidIndex;
  }

  static float turn(const Eigen::Vector3f& a, const Eigen::Vector3f& b) { return 0.5f * (1 - a.dot(b)); }

  void solve_chain(std::size_t i, std::size_t j) {
    if (is_edge_[i * n_ + j]) return;
    const bool is_outline = i == 0 && j + 1 == n_;
    Cost& best = best_[i * n_ + j];
    for (std::size_t k = i + 1; k < j; ++k) {
      const Cost &left = best_[i * n_ + k], &right = best_[k * n_ + j];
      Cost cost = {std::max(left.worst, right.worst), left.sum + right.sum};
      if (!(cost < best)) continue;
      const Eigen::Vector3d ki = position_[i] - position_[k], kj = position_[j] - position_[k];
      const Eigen::Vector3d area2 = ki.cross(kj);
      const double length = area2.norm();
      if (!(length > 0)) continue;
      const Eigen::Vector3f normal = (area2 / length).cast<float>();
      float fold = std::max(turn(normal, normal_[i * n_ + k]), turn(normal, normal_[k * n_ + j]));
      if (is_outline) fold = std::max(fold, turn(normal, across_[n_ - 1]));
      if (goal_ == LoopGoal::kArea) {
        cost = {std::max(cost.worst, fold), cost.sum + float(length)};
      } else {
        const double sides[3] = {ki.squaredNorm(), kj.squaredNorm(), (ki - kj).squaredNorm()};
        const double longest = std::max({sides[0], sides[1], sides[2]});
        const double shortest = std::min({sides[0], sides[1], sides[2]});
        const double middle = sides[0] + sides[1] + sides[2] - longest - shortest;
        const float shape = std::max(0.0f, 1 - float(length / std::sqrt(longest * middle)) / 0.8660254f);
        cost = {std::max({cost.worst, shape, fold}), cost.sum + shape + fold};
      }
      if (!(cost < best) || (!forbidden_.empty() && forbidden_.contains(key(k, i, j)))) continue;
      best = cost;
      split_[i * n_ + j] = k;
      normal_[i * n_ + j] = normal;
    }
  }

  const LiveMesh& mesh_;
  const Loop& loop_;
  std::size_t n_;
  LoopGoal goal_;
  std::vector<Eigen::Vector3d> position_;
  std::vector<Eigen::Vector3f> across_;  // of each edge, the unit normal of the triangle on its other side
  std::vector<std::uint8_t> is_edge_;
  std::vector<Cost> best_;
  std::vector<std::size_t> split_;
  std::vector<Eigen::Vector3f> normal_;
  std::unordered_set<std::uint64_t> forbidden_;  // membership only
};

/// Adds the triangles one by one. Those that do not fit are forbidden, and all are taken back.
bool try_to_add(LiveMesh& mesh, TriangleCheck& check, LoopSolver& solver,
                const std::vector<std::array<std::size_t, 3>>& triangles, const TriangleRule& rule, TriangleTag tag) {
  bool is_possible = true;
  for (const auto& t : triangles)
    if (!check.is_valid(solver.triangle(t), rule)) {
      solver.forbid(t);
      is_possible = false;
    }
  if (!is_possible) return false;
  std::vector<std::uint32_t> added;
  for (const auto& t : triangles) {
    if (!check.is_valid(solver.triangle(t), rule)) {
      solver.forbid(t);
      for (const std::uint32_t id : added) mesh.remove(id);
      return false;
    }
    added.push_back(check.add(solver.triangle(t), tag));
  }
  return true;
}

bool close_whole(LiveMesh& mesh, TriangleCheck& check, const Loop& loop, LoopGoal goal, const TriangleRule& rule,
                 TriangleTag tag, LoopEffort effort) {
  LoopSolver solver(mesh, loop, goal);
  const std::size_t attempts =
      std::clamp<std::size_t>(6000 / loop.size(), 30, 300) / (effort == LoopEffort::kQuick ? 4 : 1);
  for (std::size_t attempt = 0; attempt < attempts; ++attempt) {
    const auto triangles = solver.solve();
    if (triangles.empty()) return false;
    if (try_to_add(mesh, check, solver, triangles, rule, tag)) return true;
  }
  return false;
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
