// Based on: V. Lempitsky, D. Ivanov, Seamless Mosaicing of Image-Based Texture Maps, 2007, for the energy; M. Waechter,
// N. Moehrle, M. Goesele, Let There Be Color!, 2014, for the smoothness term; D. Thuerck, M. Waechter, S. Widmer et
// al., A Fast, Massively Parallel Solver for Large, Irregular Pairwise Markov Random Fields, 2016, for minimising it
// over trees.

#include "texture/choose_images.h"

#include <algorithm>
#include <cmath>
#include <map>

#include "core/disjoint_sets.h"
#include "lapseam/context.h"

namespace lapseam {
namespace {

// A pixel of border between images that agree costs as much as this many pixels shown e times coarser than need be: an
// image takes over where it is better by δ (natural logarithm) in a region of a radius over 2 · 4 / δ pixels.
constexpr float kBorderCost = 4;
// A difference of this many levels between the two images makes a border cost twice as much.
constexpr float kDifference = 4;
// Where nothing is known of the difference.
constexpr float kUnknownDifference = 12;
// What a region costs by being one more: about the padding that a chart needs.
constexpr float kRegionCost = 1500;
constexpr int kSweeps = 5, kMergingRounds = 3;
constexpr std::uint8_t kNoSlot = 255;

class Labelling {
 public:
  Labelling(const Mesh& mesh, const Cells& cells, const Candidates& candidates, const std::vector<SharedEdge>& edges,
            Context& context)
      : candidates_(candidates), context_(context), slot_(cells.count(), kNoSlot), weight_(candidates.area_px) {
    for (std::size_t i = 0; i < slot_.size(); ++i) start_with_best(i);
    join_cells(mesh, cells, edges);
  }

  std::vector<std::uint32_t> run() {
    std::vector<std::uint32_t> left_over;
    for (int sweep = 0; sweep < kSweeps; ++sweep) {
      context_.throw_if_cancelled();
      left_over = grow_forest(left_over, sweep % 2 != 0);
      minimise_forest();
    }
    for (int round = 0; round < kMergingRounds; ++round) {
      context_.throw_if_cancelled();
      if (merge_regions() == 0) break;
    }
    return labels();
  }

 private:
  struct Border {
    std::uint32_t a, b;
    float cost;  // where the images agree
  };

  void start_with_best(std::size_t i) {
    const CandidateList& list = candidates_.of_cell[i];
    float lowest = 3e38f;
    for (std::uint8_t k = 0; k < list.size() && list[k].view != kInvalidIndex; ++k)
      if (list[k].cost < lowest) lowest = list[k].cost, slot_[i] = k;
  }

  /// Borders of cells, and for each cell those that it has.
  void join_cells(const Mesh& mesh, const Cells& cells, const std::vector<SharedEdge>& edges) {
    const std::vector<std::uint32_t> cell = cell_of_triangles(cells);
    for (const SharedEdge& edge : edges) {
      const std::uint32_t a = std::min(cell[edge.a], cell[edge.b]), b = std::max(cell[edge.a], cell[edge.b]);
      if (a == b || slot_[a] == kNoSlot || slot_[b] == kNoSlot) continue;
      const Triangle& t = mesh.triangles[edge.a];
      const float length_m =
          (mesh.positions_m[t[edge.corner_a]] - mesh.positions_m[t[(edge.corner_a + 1u) % 3]]).norm();
      borders_.push_back(
          {a, b, kBorderCost * length_m * 0.5f * (candidates_.density_px[a] + candidates_.density_px[b])});
    }
    std::stable_sort(borders_.begin(), borders_.end(),
                     [](const Border& x, const Border& y) { return x.a != y.a ? x.a < y.a : x.b < y.b; });
    std::size_t kept = 0;
    for (const Border& border : borders_) {
      if (kept > 0 && borders_[kept - 1].a == border.a && borders_[kept - 1].b == border.b)
        borders_[kept - 1].cost += border.cost;
      else
        borders_[kept++] = border;
    }
    borders_.resize(kept);
    side_begin_.assign(slot_.size() + 1, 0);
    for (const Border& border : borders_) ++side_begin_[border.a + 1], ++side_begin_[border.b + 1];
    for (std::size_t i = 0; i < slot_.size(); ++i) side_begin_[i + 1] += side_begin_[i];
    sides_.resize(2 * borders_.size());
    std::vector<std::uint32_t> next(side_begin_.begin(), side_begin_.end() - 1);
    for (std::uint32_t e = 0; e < borders_.size(); ++e) {
      sides_[next[borders_[e].a]++] = e;
      sides_[next[borders_[e].b]++] = e;
    }
  }

  std::span<const std::uint32_t> sides(std::uint32_t i) const {
    return {sides_.data() + side_begin_[i], sides_.data() + side_begin_[i + 1]};
  }

  std::uint32_t other_side(std::uint32_t cell, std::uint32_t e) const {
    return borders_[e].a == cell ? borders_[e].b : borders_[e].a;
  }
  std::uint32_t view_of(std::uint32_t i, std::uint8_t slot) const { return candidates_.of_cell[i][slot].view; }

  /// Cells such that each touches at most the one that it grew from, of those that were there before: the graph of
  /// those chosen has no cycle, and its minimum is found exactly. Returns those left over, to come first next time.
  std::vector<std::uint32_t> grow_forest(const std::vector<std::uint32_t>& first, bool from_the_end) {
    const auto n = std::uint32_t(slot_.size());
    forest_.clear();
    parent_.assign(n, kNoEdge);
    std::vector<std::uint8_t> state(n, 0);  // 1: chosen, 2: left over
    std::vector<std::uint32_t> left_over;
    const auto try_choose = [&](std::uint32_t i) {
      if (state[i] != 0 || slot_[i] == kNoSlot) return;
      std::uint32_t parent = kNoEdge;
      int chosen_neighbours = 0;
      for (const std::uint32_t e : sides(i))
        if (state[other_side(i, e)] == 1) parent = e, ++chosen_neighbours;
      state[i] = chosen_neighbours <= 1 ? 1 : 2;
      if (state[i] == 2) return left_over.push_back(i);
      parent_[i] = parent;
      forest_.push_back(i);
    };
    for (const std::uint32_t i : first) try_choose(i);
    std::size_t next = 0;
    for (std::uint32_t k = 0; k < n; ++k) {
      try_choose(from_the_end ? n - 1 - k : k);
      for (; next < forest_.size(); ++next) {
        const std::uint32_t grown = forest_[next];
        for (const std::uint32_t e : sides(grown)) try_choose(other_side(grown, e));
      }
    }
    return left_over;
  }

  /// Dynamic programming from the leaves to the roots and back.
  void minimise_forest() {
    std::vector<std::array<float, kMostCandidates>>& cost = cost_;
    cost.resize(slot_.size());
    for (const std::uint32_t i : forest_) set_own_cost(i, cost[i]);
    for (auto i = forest_.rbegin(); i != forest_.rend(); ++i) {
      if (parent_[*i] == kNoEdge) continue;
      const std::uint32_t parent = other_side(*i, parent_[*i]);
      for (std::uint8_t k = 0; k < kMostCandidates && view_of(parent, k) != kInvalidIndex; ++k) {
        cost[parent][k] += cheapest(*i, cost[*i], parent, k);
      }
    }
    for (const std::uint32_t i : forest_) {
      std::uint8_t best = 0;
      const bool has_parent = parent_[i] != kNoEdge;
      const std::uint32_t above = has_parent ? other_side(i, parent_[i]) : 0;
      float lowest = 3e38f;
      for (std::uint8_t k = 0; k < kMostCandidates && view_of(i, k) != kInvalidIndex; ++k) {
        const float total = cost[i][k] + (has_parent ? pair_cost(parent_[i], i, k, above, slot_[above]) : 0);
        if (total < lowest) lowest = total, best = k;
      }
      slot_[i] = best;
    }
  }

  /// Of a cell and all that grows from it, when its parent shows its candidate k.
  float cheapest(std::uint32_t i, const std::array<float, kMostCandidates>& cost, std::uint32_t parent,
                 std::uint8_t k) const {
    const std::uint32_t view = view_of(parent, k);
    // Every border costs at least this much: what is dearer than the best so far need not be looked at more closely.
    const float least = borders_[parent_[i]].cost;
    float lowest = 3e38f;
    for (std::uint8_t j = 0; j < kMostCandidates && view_of(i, j) != kInvalidIndex; ++j)
      if (view_of(i, j) == view) lowest = cost[j];
    for (std::uint8_t j = 0; j < kMostCandidates && view_of(i, j) != kInvalidIndex; ++j)
      if (cost[j] + least < lowest) lowest = std::min(lowest, cost[j] + pair_cost(parent_[i], i, j, parent, k));
    return lowest;
  }

  /// What the cell costs by itself and beside neighbours that stay as they are.
  void set_own_cost(std::uint32_t i, std::array<float, kMostCandidates>& cost) const {
    cost.fill(3e38f);
    for (std::uint8_t k = 0; k < kMostCandidates && view_of(i, k) != kInvalidIndex; ++k) {
      cost[k] = weight_[i] * candidates_.of_cell[i][k].cost;
      for (const std::uint32_t e : sides(i)) {
        if (e == parent_[i]) continue;
        const std::uint32_t other = other_side(i, e);
        if (slot_[other] == kNoSlot || parent_[other] == e) continue;
        cost[k] += pair_cost(e, i, k, other, slot_[other]);
      }
    }
  }

  /// How differently two images show a cell; negative when it is not known.
  float difference(std::uint32_t i, std::uint8_t slot, std::uint32_t other_view) const {
    const Rgb8 own = candidates_.of_cell[i][slot].color;
    for (const Candidate& candidate : candidates_.of_cell[i]) {
      if (candidate.view != other_view) continue;
      const auto square = [](int x, int y) { return float((x - y) * (x - y)); };
      return std::sqrt(
          (square(own.r, candidate.color.r) + square(own.g, candidate.color.g) + square(own.b, candidate.color.b)) / 3);
    }
    return -1;
  }

  /// Of a border between cells that show these candidates.
  float pair_cost(std::uint32_t e, std::uint32_t i, std::uint8_t slot, std::uint32_t other,
                  std::uint8_t other_slot) const {
    const std::uint32_t view = view_of(i, slot), other_view = view_of(other, other_slot);
    if (view == other_view) return 0;
    const float here = difference(i, slot, other_view), there = difference(other, other_slot, view);
    const float d = here < 0 && there < 0 ? kUnknownDifference : std::max(here, there);
    return borders_[e].cost * (1 + d / kDifference);
  }

  std::vector<std::uint32_t> labels() const {
    std::vector<std::uint32_t> out(slot_.size(), kInvalidIndex);
    for (std::uint32_t i = 0; i < out.size(); ++i)
      if (slot_[i] != kNoSlot) out[i] = view_of(i, slot_[i]);
    return out;
  }

  /// Root of each cell's connected region of one image.
  std::vector<std::uint32_t> regions() const {
    DisjointSets sets(slot_.size());
    for (const Border& border : borders_)
      if (view_of(border.a, slot_[border.a]) == view_of(border.b, slot_[border.b])) sets.unite(border.a, border.b);
    std::vector<std::uint32_t> root(slot_.size(), kInvalidIndex);
    for (std::uint32_t i = 0; i < root.size(); ++i)
      if (slot_[i] != kNoSlot) root[i] = sets.find(i);
    return root;
  }

  /// Whole regions go over to a neighbour's image where that saves more than it costs; small ones first.
  std::size_t merge_regions() {
    const std::vector<std::uint32_t> root = regions();
    std::vector<std::vector<std::uint32_t>> members(root.size());
    std::vector<std::uint32_t> order;
    std::vector<float> area(root.size(), 0);
    for (std::uint32_t i = 0; i < root.size(); ++i) {
      if (root[i] == kInvalidIndex) continue;
      if (root[i] == i) order.push_back(i);
      members[root[i]].push_back(i);
      area[root[i]] += weight_[i];
    }
    std::sort(order.begin(), order.end(),
              [&](std::uint32_t x, std::uint32_t y) { return area[x] != area[y] ? area[x] < area[y] : x < y; });
    std::size_t merged = 0;
    for (const std::uint32_t region : order) merged += try_merge(members[region]);
    return merged;
  }

  bool try_merge(const std::vector<std::uint32_t>& region) {
    const std::uint32_t own = view_of(region.front(), slot_[region.front()]);
    std::map<std::uint32_t, float> saved;  // border with each other view
    for (const std::uint32_t i : region)
      for (const std::uint32_t e : sides(i)) {
        const std::uint32_t other = other_side(i, e);
        if (slot_[other] != kNoSlot && view_of(other, slot_[other]) != own)
          saved[view_of(other, slot_[other])] += pair_cost(e, i, slot_[i], other, slot_[other]);
      }
    float best = 0;
    std::uint32_t best_view = kInvalidIndex;
    for (const auto& [view, border] : saved) {
      const float gain = border + kRegionCost - extra_cost(region, view, border + kRegionCost);
      if (gain > best) best = gain, best_view = view;
    }
    if (best_view == kInvalidIndex) return false;
    for (const std::uint32_t i : region)
      for (std::uint8_t k = 0; k < kMostCandidates; ++k)
        if (view_of(i, k) == best_view) slot_[i] = k;
    return true;
  }

  /// Of another view over the present one for a region; some value over the limit when it is more than that.
  float extra_cost(const std::vector<std::uint32_t>& region, std::uint32_t view, float limit) const {
    float sum = 0;
    for (const std::uint32_t i : region) {
      const CandidateList& list = candidates_.of_cell[i];
      const auto found =
          std::find_if(list.begin(), list.end(), [&](const Candidate& candidate) { return candidate.view == view; });
      if (found == list.end()) return 3e38f;
      sum += weight_[i] * (found->cost - list[slot_[i]].cost);
      if (sum > limit + 1e4f) return sum;
    }
    return sum;
  }

  const Candidates& candidates_;
  Context& context_;
  std::vector<std::uint8_t> slot_;
  const std::vector<float>& weight_;  // pixels of the best image
  std::vector<Border> borders_;
  std::vector<std::uint32_t> side_begin_, sides_;  // borders of each cell
  std::vector<std::array<float, kMostCandidates>> cost_;
  std::vector<std::uint32_t> forest_, parent_;  // parent_: the edge to it
};

}  // namespace

std::vector<std::uint32_t> choose_images(const Mesh& mesh, const Cells& cells, const Candidates& candidates,
                                         const std::vector<SharedEdge>& edges, Context& context) {
  return Labelling(mesh, cells, candidates, edges, context).run();
}

}  // namespace lapseam
