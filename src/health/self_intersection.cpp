// Bounding boxes in Morton order under a tree of fixed arity: leaves are compared with leaves, then their triangles,
// then exact predicates decide.

#include "health/self_intersection.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "core/parallel.h"
#include "health/incidence.h"
#include "health/predicates.h"
#include "spatial/box.h"

namespace lapseam {
namespace {

constexpr std::size_t kLeafSize = 8;
constexpr std::size_t kArity = 4;

class Finder {
 public:
  Finder(std::span<const Eigen::Vector3f> positions_m, std::span<const Triangle> triangles, Context& context)
      : positions_m_(positions_m), triangles_(triangles), context_(context) {
    sort_triangles();
    build_tree();
  }

  SelfIntersections find() {
    SelfIntersections result;
    result.is_meeting.assign(triangles_.size(), 0);
    if (order_.empty()) return result;
    using Pairs = std::vector<std::array<std::uint32_t, 2>>;
    result.pairs = parallel_reduce(
        context_, levels_[0].size(), 64, Pairs(),
        [&](std::size_t begin, std::size_t end, Pairs pairs) {
          for (std::size_t leaf = begin; leaf < end; ++leaf) visit_leaf(leaf, pairs);
          return pairs;
        },
        [](Pairs first, const Pairs& second) {
          first.insert(first.end(), second.begin(), second.end());
          return first;
        });
    std::sort(result.pairs.begin(), result.pairs.end());
    for (const auto& pair : result.pairs)
      for (const std::uint32_t t : pair) result.is_meeting[t] = 1;
    for (const std::uint8_t is_meeting : result.is_meeting) result.triangles += is_meeting;
    return result;
  }

 private:
  std::array<Eigen::Vector3f, 3> corners(std::uint32_t t) const {
    return {positions_m_[triangles_[t][0]], positions_m_[triangles_[t][1]], positions_m_[triangles_[t][2]]};
  }

  bool has_area(std::uint32_t t) const {
    const auto c = corners(t);
    return !has_repeated_vertex(triangles_[t]) && dominant_plane(c[0], c[1], c[2]) >= 0;
  }

  void sort_triangles() {
    Box bounds;
    for (const Eigen::Vector3f& p : positions_m_) bounds.extend(p);
    const double size = std::max(1e-30, (bounds.high.cast<double>() - bounds.low.cast<double>()).maxCoeff());
    struct Entry {
      std::uint64_t code;
      std::uint32_t triangle;
    };
    std::vector<Entry> entries(triangles_.size());
    parallel_for(context_, triangles_.size(), 4096, [&](std::size_t i) {
      const auto t = std::uint32_t(i);
      if (!has_area(t)) {
        entries[i] = {~0ull, t};
        return;
      }
      const auto c = corners(t);
      const Eigen::Vector3d sum = c[0].cast<double>() + c[1].cast<double>() + c[2].cast<double>();
      std::uint64_t code = 0;
      for (int k = 0; k < 3; ++k) {
        const double x = (sum[k] / 3 - double(bounds.low[k])) / size * 2097151.0;
        code |= spread_bits(std::uint64_t(std::clamp(x, 0.0, 2097151.0))) << k;
      }
      entries[i] = {code, t};
    });
    parallel_sort(context_, entries.begin(), entries.end(), [](const Entry& a, const Entry& b) {
      return a.code != b.code ? a.code < b.code : a.triangle < b.triangle;
    });
    while (!entries.empty() && entries.back().code == ~0ull) entries.pop_back();
    order_.resize(entries.size());
    for (std::size_t i = 0; i < entries.size(); ++i) order_[i] = entries[i].triangle;
  }

  void build_tree() {
    boxes_.resize(order_.size());
    parallel_for(context_, order_.size(), 4096, [&](std::size_t i) {
      for (const Eigen::Vector3f& p : corners(order_[i])) boxes_[i].extend(p);
    });
    for (std::size_t below = 0; levels_.empty() || levels_.back().size() > 1;) {
      const std::vector<Box>& children = levels_.empty() ? boxes_ : levels_.back();
      const std::size_t arity = levels_.empty() ? kLeafSize : kArity;
      below = children.size();
      std::vector<Box> level((below + arity - 1) / arity);
      parallel_for(context_, level.size(), 1024, [&](std::size_t i) {
        for (std::size_t k = i * arity; k < std::min(below, (i + 1) * arity); ++k) level[i].extend(children[k]);
      });
      levels_.push_back(std::move(level));
    }
  }

  /// Pairs between this leaf and itself or later ones.
  void visit_leaf(std::size_t leaf, std::vector<std::array<std::uint32_t, 2>>& pairs) {
    struct Node {
      std::size_t level, index;
    };
    std::array<Node, 64> stack;  // at most kArity − 1 more per level, and 2^32 triangles make 15 levels
    std::size_t size = 0;
    stack[size++] = {levels_.size() - 1, 0};
    const Box& box = levels_[0][leaf];
    while (size > 0) {
      const Node node = stack[--size];
      if (!levels_[node.level][node.index].overlaps(box)) continue;
      if (node.level == 0) {
        compare_leaves(leaf, node.index, pairs);
        continue;
      }
      const std::size_t below = node.level - 1;
      const std::size_t first = node.index * kArity;
      const std::size_t last = std::min(first + kArity, levels_[below].size());
      const std::size_t leaf_at_level = leaf >> (2 * below);  // kArity = 4
      for (std::size_t child = std::max(first, leaf_at_level); child < last; ++child) stack[size++] = {below, child};
    }
  }

  void compare_leaves(std::size_t leaf, std::size_t other, std::vector<std::array<std::uint32_t, 2>>& pairs) {
    const std::size_t end = std::min((leaf + 1) * kLeafSize, order_.size());
    const std::size_t other_end = std::min((other + 1) * kLeafSize, order_.size());
    for (std::size_t i = leaf * kLeafSize; i < end; ++i) {
      if (!boxes_[i].overlaps(levels_[0][other])) continue;
      for (std::size_t j = std::max(i + 1, other * kLeafSize); j < other_end; ++j) {
        if (!boxes_[i].overlaps(boxes_[j]) || !do_meet(order_[i], order_[j])) continue;
        pairs.push_back({std::min(order_[i], order_[j]), std::max(order_[i], order_[j])});
      }
    }
  }

  bool do_meet(std::uint32_t t, std::uint32_t s) const {
    const auto a = corners(t), b = corners(s);
    std::size_t shared = 0, in_a = 0, in_b = 0;
    for (std::size_t i = 0; i < 3; ++i)
      for (std::size_t j = 0; j < 3; ++j)
        if (triangles_[t][i] == triangles_[s][j]) ++shared, in_a = i, in_b = j;
    if (shared == 0) return do_triangles_meet(a, b);
    if (shared > 1) return false;
    return do_segment_and_triangle_meet(a[(in_a + 1) % 3], a[(in_a + 2) % 3], b) ||
           do_segment_and_triangle_meet(b[(in_b + 1) % 3], b[(in_b + 2) % 3], a);
  }

  std::span<const Eigen::Vector3f> positions_m_;
  std::span<const Triangle> triangles_;
  Context& context_;
  std::vector<std::uint32_t> order_;      ///< triangles of some area, in Morton order
  std::vector<Box> boxes_;                ///< of the triangles in that order
  std::vector<std::vector<Box>> levels_;  ///< leaves first; the last level is the root
};

}  // namespace

SelfIntersections find_self_intersections(std::span<const Eigen::Vector3f> positions_m,
                                          std::span<const Triangle> triangles, Context& context) {
  return Finder(positions_m, triangles, context).find();
}

}  // namespace lapseam
