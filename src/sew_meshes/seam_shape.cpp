// Better triangles in the seam, without new vertices: edges are turned, and short ones are taken out.

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "core/parallel.h"
#include "lapseam/context.h"
#include "sew_meshes/seam_shape.h"

namespace lapseam {
namespace {

constexpr int kPasses = 8;
constexpr double kGain = 1e-3;  // of the smaller sine, so that flips end
// Sine of 10.5°. What is better is left to flips: with 20°, collapses leave fans of triangles just under 10°.
constexpr double kSliver = 0.182;
constexpr double kGood = 0.5;  // sine of 30°: nothing to gain from here on
constexpr double kFlatCosine = 0.5;
constexpr double kBentCosine = 0;
constexpr std::size_t kAtOnce = 1024;  // triangles

}  // namespace

double SeamShape::sine_of(const Triangle& t) const {
  return smallest_sine(mesh_.position(t[0]), mesh_.position(t[1]), mesh_.position(t[2]));
}

/// On rough surfaces folds are everywhere: what comes may be as sharp as the sharpest of what goes.
TriangleRule SeamShape::rule_for(std::span<const std::uint32_t> old) const {
  TriangleRule rule{.fold_cosine = kBentCosine, .facing_cosine = kBentCosine};
  for (const std::uint32_t t : old) {
    rule.fold_cosine = std::max(most_bent_cosine_, std::min(rule.fold_cosine, check_.fold_of(mesh_.triangle(t))));
    rule.facing_cosine = std::max(most_bent_cosine_, std::min(rule.facing_cosine, check_.facing_of(mesh_.triangle(t))));
  }
  return rule;
}

/// Tried on a draft: the mesh stays as it is.
bool SeamShape::is_possible(const std::optional<Change>& change) const {
  if (!change) return false;
  const TriangleRule rule = rule_for(change->old);
  LiveMesh draft = LiveMesh::draft_of(mesh_);
  TriangleCheck check(draft, check_);
  for (const std::uint32_t t : change->old) draft.remove(t);
  return std::all_of(change->wanted.begin(), change->wanted.end(), [&](const Triangle& t) {
    if (!check.is_valid(t, rule)) return false;
    check.add(t, TriangleTag::kSeam);
    return true;
  });
}

/// Whether nothing came or went in this phase at any corner of what would go.
bool SeamShape::is_as_before(const Change& change) const {
  return std::all_of(change.old.begin(), change.old.end(),
                     [&](std::uint32_t t) { return last_change(mesh_.triangle(t)) != phase_; });
}

bool SeamShape::meets_new_ones(const Triangle& t) const {
  return new_boxes_.find(box_of(mesh_, t), [&](std::uint32_t id) {
    return mesh_.is_alive(id) && do_triangles_cross(mesh_.positions(), t, mesh_.triangle(id));
  });
}

/// All or nothing. What was possible when the phase began still is, unless something new is in the way.
bool SeamShape::make(const std::optional<Change>& change, bool was_possible) {
  if (!change) return false;
  const bool is_known = was_possible && is_as_before(*change);
  const auto is_in_the_way = [&](const Triangle& t) { return !check_.meets_condition(t) || meets_new_ones(t); };
  if (is_known && std::any_of(change->wanted.begin(), change->wanted.end(), is_in_the_way)) return false;
  const TriangleRule rule = is_known ? TriangleRule{} : rule_for(change->old);
  for (const std::uint32_t t : change->old) mesh_.remove(t);
  std::vector<std::uint32_t> added;
  for (const Triangle& t : change->wanted) {
    if (!is_known && !check_.is_valid(t, rule)) {
      for (const std::uint32_t id : added) mesh_.remove(id);
      for (const std::uint32_t id : change->old) mesh_.restore(id);
      return false;
    }
    added.push_back(check_.add(t, TriangleTag::kSeam));
  }
  for (const std::uint32_t id : added) new_boxes_.add({box_of(mesh_, mesh_.triangle(id)), id});
  for (const std::uint32_t t : change->old)
    for (const std::uint32_t v : mesh_.triangle(t)) last_change_[v] = phase_;
  return true;
}

/// Nothing around has changed since it was last looked at for this: what could not be done then cannot be done now.
bool SeamShape::is_settled(const Triangle& t) const { return last_change(t) + 2 < phase_; }

/// Where the worse one of two seam triangles gets better when the edge between them is turned. With a measured triangle
/// on one side, only if a sliver goes and none comes.
std::optional<SeamShape::Change> SeamShape::find_flip(std::uint32_t a, std::uint32_t b) const {
  const std::uint32_t left = mesh_.find(a, b), right = mesh_.find(b, a);
  if (left == kInvalidIndex || right == kInvalidIndex) return {};
  const double before = std::min(sine_of(mesh_.triangle(left)), sine_of(mesh_.triangle(right)));
  if (before > kGood) return {};
  const std::uint32_t c = mesh_.apex(left, a, b), d = mesh_.apex(right, a, b);
  const Triangle first = {a, d, c}, second = {d, b, c};
  const double after = std::min(sine_of(first), sine_of(second));
  const bool is_all_seam = mesh_.tag(left) == TriangleTag::kSeam && mesh_.tag(right) == TriangleTag::kSeam;
  if (is_all_seam ? after < before + kGain : before > kSliver || after < kSliver) return {};
  const Eigen::Vector3d n = mesh_.area_normal(first), m = mesh_.area_normal(second);
  if (n.dot(m) < kFlatCosine * n.norm() * m.norm()) return {};
  if (mesh_.find(c, d) != kInvalidIndex || mesh_.find(d, c) != kInvalidIndex) return {};
  return Change{{left, right}, {first, second}};
}

/// Bit k: from corner k.
std::uint8_t SeamShape::edges_to_flip(std::uint32_t t) const {
  const Triangle& c = mesh_.triangle(t);
  std::uint8_t edges = 0;
  for (std::size_t k = 0; k < 3; ++k) edges |= std::uint8_t(is_possible(find_flip(c[k], c[(k + 1) % 3])) << k);
  return edges;
}

/// Moves the corners of all triangles at `from` to `to`, if fewer slivers are left in the seam by it.
std::optional<SeamShape::Change> SeamShape::find_collapse(std::uint32_t from, std::uint32_t to) const {
  if (mesh_.is_on_border(from)) return {};
  Change change;
  mesh_.for_each_around(from, [&](std::uint32_t t) { change.old.push_back(t); });
  std::sort(change.old.begin(), change.old.end());
  std::size_t before = 0, after = 0;
  double worst_before = 1, worst_after = 1;
  for (const std::uint32_t t : change.old) {
    Triangle c = mesh_.triangle(t);
    before += mesh_.tag(t) == TriangleTag::kSeam && sine_of(c) < kSliver;
    worst_before = std::min(worst_before, sine_of(c));
    if (c[0] == to || c[1] == to || c[2] == to) continue;
    const Eigen::Vector3d normal = mesh_.area_normal(c);
    std::replace(c.begin(), c.end(), from, to);
    const Eigen::Vector3d moved = mesh_.area_normal(c);
    if (!(moved.dot(normal) > kFlatCosine * moved.norm() * normal.norm())) return {};
    after += sine_of(c) < kSliver;
    worst_after = std::min(worst_after, sine_of(c));
    change.wanted.push_back(c);
  }
  // Two triangles go; if more did, the vertices are joined by more than an edge.
  if (change.old.size() != change.wanted.size() + 2 || after >= before || worst_after < worst_before) return {};
  return change;
}

std::array<std::uint32_t, 2> SeamShape::shortest_edge(const Triangle& t) const {
  std::array<std::uint32_t, 2> shortest{};
  double length = 3e38;
  for (std::size_t k = 0; k < 3; ++k) {
    const std::uint32_t a = t[k], b = t[(k + 1) % 3];
    const double side = double((mesh_.position(a) - mesh_.position(b)).norm());
    if (side < length) length = side, shortest = {a, b};
  }
  return shortest;
}

bool SeamShape::is_due(std::uint32_t t) const {
  return mesh_.is_alive(t) && mesh_.tag(t) == TriangleTag::kSeam && !is_settled(mesh_.triangle(t));
}

bool SeamShape::is_needle(std::uint32_t t) const { return is_due(t) && sine_of(mesh_.triangle(t)) < kSliver; }

// What is possible is found out for all triangles at once, each for itself; then it is done one after the other, and
// what changed since, at one of a triangle's corners, is looked at once more.
std::uint64_t SeamShape::flip_edges(std::uint32_t first) {
  const auto end = std::uint32_t(mesh_.triangle_count());
  std::vector<std::uint8_t> edges(end - first, 0);
  parallel_for(context_, end - first, kAtOnce, [&](std::size_t i) {
    if (const auto t = first + std::uint32_t(i); is_due(t)) edges[i] = edges_to_flip(t);
  });
  std::uint64_t flips = 0;
  for (std::uint32_t t = first; t < end; ++t) {
    if (!is_due(t)) continue;
    const Triangle c = mesh_.triangle(t);
    for (std::size_t k = 0; k < 3 && mesh_.is_alive(t); ++k)
      if (const bool was_possible = edges[t - first] >> k & 1; was_possible || last_change(c) == phase_)
        flips += make(find_flip(c[k], c[(k + 1) % 3]), was_possible);
  }
  return flips;
}

std::uint64_t SeamShape::collapse_needles(std::uint32_t first) {
  const auto end = std::uint32_t(mesh_.triangle_count());
  std::vector<std::uint8_t> ways(end - first, 0);  // bit 0: from the first end of the shortest edge, bit 1: the other
  parallel_for(context_, end - first, kAtOnce, [&](std::size_t i) {
    const auto t = first + std::uint32_t(i);
    if (!is_needle(t)) return;
    const auto [a, b] = shortest_edge(mesh_.triangle(t));
    ways[i] = is_possible(find_collapse(a, b)) ? 1 : is_possible(find_collapse(b, a)) ? 2 : 0;
  });
  std::uint64_t collapses = 0;
  for (std::uint32_t t = first; t < end; ++t) {
    if (!is_needle(t)) continue;
    const Triangle c = mesh_.triangle(t);
    const std::uint8_t possible = ways[t - first];
    if (!possible && last_change(c) != phase_) continue;
    const auto [a, b] = shortest_edge(c);
    collapses += make(find_collapse(a, b), possible & 1) || make(find_collapse(b, a), possible & 2);
  }
  return collapses;
}

void SeamShape::begin_phase() {
  ++phase_;
  new_boxes_ = {};
}

SeamShape::Changes SeamShape::improve(std::uint32_t first) {
  Changes all;
  last_change_.assign(mesh_.vertex_count(), 0);
  phase_ = 0;
  for (int pass = 0; pass < kPasses; ++pass) {
    context_.throw_if_cancelled();
    begin_phase();
    const std::uint64_t flips = flip_edges(first);
    begin_phase();
    const std::uint64_t collapses = collapse_needles(first);
    all.flips += flips;
    all.collapses += collapses;
    if (flips + collapses == 0) break;
  }
  return all;
}

}  // namespace lapseam
