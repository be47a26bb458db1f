// Better triangles in the seam, without new vertices: edges are turned, and short ones are taken out.

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "core/parallel.h"
#include "lapseam/context.h"
#include "sew_meshes/seam_shape.h"

namespace lapseam {
namespace {

constexpr std::uint8_t kPasses = 8;
constexpr double kGain = 1e-3;  // of the smaller sine, so that flips end
// Sine of 10.5°. What is better is left to flips: with 20°, collapses leave fans of triangles just under 10°.
constexpr double kSliver = 0.182;
constexpr double kGood = 0.5;  // sine of 30°: nothing to gain from here on
constexpr double kFlatCosine = 0.5;
constexpr double kBentCosine = 0;

}  // namespace

double SeamShape::sine_of(const Triangle& t) const {
  return smallest_sine(mesh_.position(t[0]), mesh_.position(t[1]), mesh_.position(t[2]));
}

/// On rough surfaces folds are everywhere: what comes may be as sharp as the sharpest of what goes.
TriangleRule SeamShape::rule_for(const std::vector<std::uint32_t>& old) const {
  TriangleRule rule{.fold_cosine = kBentCosine, .facing_cosine = kBentCosine};
  for (const std::uint32_t t : old) {
    rule.fold_cosine = std::max(most_bent_cosine_, std::min(rule.fold_cosine, check_.fold_of(mesh_.triangle(t))));
    rule.facing_cosine = std::max(most_bent_cosine_, std::min(rule.facing_cosine, check_.facing_of(mesh_.triangle(t))));
  }
  return rule;
}

/// All or nothing.
bool SeamShape::replace(const std::vector<std::uint32_t>& old, const std::vector<Triangle>& wanted) {
  const TriangleRule rule = rule_for(old);
  for (const std::uint32_t t : old) mesh_.remove(t);
  std::vector<std::uint32_t> added;
  for (const Triangle& t : wanted) {
    if (!check_.is_valid(t, rule)) {
      for (const std::uint32_t id : added) mesh_.remove(id);
      for (const std::uint32_t id : old) mesh_.restore(id);
      return false;
    }
    added.push_back(check_.add(t, TriangleTag::kSeam));
  }
  for (const std::uint32_t t : old)
    for (const std::uint32_t v : mesh_.triangle(t)) last_change_[v] = pass_;
  return true;
}

/// Nothing around changed in this pass or the one before: what could not be done then cannot be done now.
bool SeamShape::is_settled(const Triangle& t) const { return last_change(t) + 1 < pass_; }

std::array<Triangle, 2> SeamShape::turned(std::uint32_t left, std::uint32_t right, std::uint32_t a,
                                          std::uint32_t b) const {
  const std::uint32_t c = mesh_.apex(left, a, b), d = mesh_.apex(right, a, b);
  return {Triangle{a, d, c}, Triangle{d, b, c}};
}

/// Whether the worse one of two seam triangles gets better when the edge between them is turned. With a measured
/// triangle on one side, only if a sliver goes and none comes. Depends on nothing but the triangles around
/// the two that share it.
bool SeamShape::gains_by_flip(std::uint32_t a, std::uint32_t b) const {
  const std::uint32_t left = mesh_.find(a, b), right = mesh_.find(b, a);
  if (left == kInvalidIndex || right == kInvalidIndex) return false;
  const double before = std::min(sine_of(mesh_.triangle(left)), sine_of(mesh_.triangle(right)));
  if (before > kGood) return false;
  const auto [first, second] = turned(left, right, a, b);
  const double after = std::min(sine_of(first), sine_of(second));
  const bool is_all_seam = mesh_.tag(left) == TriangleTag::kSeam && mesh_.tag(right) == TriangleTag::kSeam;
  if (is_all_seam ? after < before + kGain : before > kSliver || after < kSliver) return false;
  const Eigen::Vector3d n = mesh_.area_normal(first), m = mesh_.area_normal(second);
  if (n.dot(m) < kFlatCosine * n.norm() * m.norm()) return false;
  const std::uint32_t c = first[2], d = first[1];
  return mesh_.find(c, d) == kInvalidIndex && mesh_.find(d, c) == kInvalidIndex;
}

bool SeamShape::flip(std::uint32_t a, std::uint32_t b) {
  if (!gains_by_flip(a, b)) return false;
  const std::uint32_t left = mesh_.find(a, b), right = mesh_.find(b, a);
  const auto [first, second] = turned(left, right, a, b);
  return replace({left, right}, {first, second});
}

/// Bit k: from corner k.
std::uint8_t SeamShape::edges_to_flip(std::uint32_t t) const {
  const Triangle& c = mesh_.triangle(t);
  std::uint8_t edges = 0;
  for (std::size_t k = 0; k < 3; ++k) edges |= std::uint8_t(gains_by_flip(c[k], c[(k + 1) % 3]) << k);
  return edges;
}

/// Moves the corners of all triangles at `from` to `to`, if fewer slivers are left in the seam by it.
bool SeamShape::collapse(std::uint32_t from, std::uint32_t to) {
  if (mesh_.is_on_border(from)) return false;
  std::vector<std::uint32_t> old;
  mesh_.for_each_around(from, [&](std::uint32_t t) { old.push_back(t); });
  std::sort(old.begin(), old.end());
  std::vector<Triangle> wanted;
  std::size_t before = 0, after = 0;
  double worst_before = 1, worst_after = 1;
  for (const std::uint32_t t : old) {
    Triangle c = mesh_.triangle(t);
    before += mesh_.tag(t) == TriangleTag::kSeam && sine_of(c) < kSliver;
    worst_before = std::min(worst_before, sine_of(c));
    if (c[0] == to || c[1] == to || c[2] == to) continue;
    const Eigen::Vector3d normal = mesh_.area_normal(c);
    std::replace(c.begin(), c.end(), from, to);
    const Eigen::Vector3d moved = mesh_.area_normal(c);
    if (!(moved.dot(normal) > kFlatCosine * moved.norm() * normal.norm())) return false;
    after += sine_of(c) < kSliver;
    worst_after = std::min(worst_after, sine_of(c));
    wanted.push_back(c);
  }
  // Two triangles go; if more did, the vertices are joined by more than an edge.
  if (old.size() != wanted.size() + 2 || after >= before || worst_after < worst_before) return false;
  return replace(old, wanted);
}

// What gains is found out for all at once; what changed since, at one of a triangle's corners, once more.
std::uint64_t SeamShape::flip_edges(std::uint32_t first) {
  const auto end = std::uint32_t(mesh_.triangle_count());
  const auto is_due = [&](std::uint32_t t) {
    return mesh_.is_alive(t) && mesh_.tag(t) == TriangleTag::kSeam && !is_settled(mesh_.triangle(t));
  };
  std::vector<std::uint8_t> edges(end - first, 0);
  parallel_for(context_, end - first, 1024, [&](std::size_t i) {
    if (const auto t = first + std::uint32_t(i); is_due(t)) edges[i] = edges_to_flip(t);
  });
  std::uint64_t flips = 0;
  for (std::uint32_t t = first; t < end; ++t) {
    if (!is_due(t)) continue;
    const Triangle c = mesh_.triangle(t);
    for (std::size_t k = 0; k < 3 && mesh_.is_alive(t); ++k)
      if (edges[t - first] >> k & 1 || last_change(c) == pass_) flips += flip(c[k], c[(k + 1) % 3]);
  }
  return flips;
}

std::uint64_t SeamShape::collapse_needles(std::uint32_t first) {
  std::uint64_t collapses = 0;
  const auto end = std::uint32_t(mesh_.triangle_count());
  for (std::uint32_t t = first; t < end; ++t) {
    if (!mesh_.is_alive(t) || mesh_.tag(t) != TriangleTag::kSeam) continue;
    const Triangle c = mesh_.triangle(t);
    if (is_settled(c) || sine_of(c) >= kSliver) continue;
    std::size_t shortest = 0;
    double length = 3e38;
    for (std::size_t k = 0; k < 3; ++k) {
      const double side = double((mesh_.position(c[k]) - mesh_.position(c[(k + 1) % 3])).norm());
      if (side < length) length = side, shortest = k;
    }
    const std::uint32_t a = c[shortest], b = c[(shortest + 1) % 3];
    collapses += collapse(a, b) || collapse(b, a);
  }
  return collapses;
}

SeamShape::Changes SeamShape::improve(std::uint32_t first) {
  Changes all;
  last_change_.assign(mesh_.vertex_count(), 0);
  for (pass_ = 1; pass_ <= kPasses; ++pass_) {
    context_.throw_if_cancelled();
    const std::uint64_t flips = flip_edges(first), collapses = collapse_needles(first);
    all.flips += flips;
    all.collapses += collapses;
    if (flips + collapses == 0) break;
  }
  return all;
}

}  // namespace lapseam
