// Based on: V. Lempitsky, D. Ivanov, Seamless Mosaicing of Image-Based Texture Maps, 2007, for the energy; M. Waechter,
// N. Moehrle, M. Goesele, Let There Be Color!, 2014, for the smoothness term; Y. Boykov, O. Veksler, R. Zabih, Fast
// Approximate Energy Minimization via Graph Cuts, 2001, for minimising it.

#include "texture/choose_images.h"

#include <algorithm>
#include <cmath>
#include <map>

#include "core/disjoint_sets.h"
#include "lapseam/context.h"
#include "texture/min_cut.h"

namespace lapseam {
namespace {

// A pixel of border between images that agree costs as much as this many pixels shown e times coarser than need be: an
// image takes over where it is better by δ (natural logarithm) in a region of a radius over 2 · 8 / δ pixels.
constexpr float kBorderCost = 8;
// A difference of this many levels between the two images makes a border cost twice as much.
constexpr float kDifference = 4;
// Where nothing is known of the difference.
constexpr float kUnknownDifference = 12;
// What a region costs by being one more: about the padding that a chart needs.
constexpr float kRegionCost = 1500;
constexpr int kCycles = 2, kMergingRounds = 3;
constexpr std::uint8_t kNoSlot = 255;

class Labelling {
 public:
  Labelling(const Mesh& mesh, const Cells& cells, const Candidates& candidates, const std::vector<SharedEdge>& edges,
            Context& context)
      : candidates_(candidates),
        context_(context),
        slot_(cells.count(), kNoSlot),
        weight_(candidates.area_px),
        node_(cells.count(), kInvalidIndex) {
    for (std::size_t i = 0; i < slot_.size(); ++i) start_with_best(i);
    join_cells(mesh, cells, edges);
  }

  std::vector<std::uint32_t> run() {
    list_cells();
    for (int cycle = 0; cycle < kCycles; ++cycle)
      for (const auto& [view, cells] : cells_of_view_) {
        context_.throw_if_cancelled();
        expand(view, cells);
      }
    for (int round = 0; round < kMergingRounds; ++round) {
      context_.throw_if_cancelled();
      if (merge_regions() == 0) break;
    }
    return labels();
  }

 private:
  void start_with_best(std::size_t i) {
    const std::span<const Candidate> list = candidates_.of(i);
    float lowest = 3e38f;
    for (std::uint8_t k = 0; k < list.size(); ++k)
      if (list[k].cost < lowest) lowest = list[k].cost, slot_[i] = k;
  }

  void join_cells(const Mesh& mesh, const Cells& cells, const std::vector<SharedEdge>& edges) {
    std::vector<std::uint8_t> is_seen(slot_.size());
    std::transform(slot_.begin(), slot_.end(), is_seen.begin(),
                   [](std::uint8_t k) { return std::uint8_t(k != kNoSlot); });
    borders_ = find_borders(mesh, cells, edges, is_seen);
    for (const CellBorder& border : borders_.all)
      border_cost_.push_back(kBorderCost * border.length_m * 0.5f *
                             (candidates_.density_px[border.a] + candidates_.density_px[border.b]));
  }

  std::uint32_t view_of(std::uint32_t i, std::uint8_t slot) const { return candidates_.of(i)[slot].view; }

  void list_cells() {
    for (std::uint32_t i = 0; i < slot_.size(); ++i)
      for (const Candidate& candidate : candidates_.of(i)) cells_of_view_[candidate.view].push_back(i);
  }

  std::uint8_t slot_of(std::uint32_t i, std::uint32_t view) const {
    const std::span<const Candidate> list = candidates_.of(i);
    const auto found = std::lower_bound(list.begin(), list.end(), view,
                                        [](const Candidate& candidate, std::uint32_t v) { return candidate.view < v; });
    return found != list.end() && found->view == view ? std::uint8_t(found - list.begin()) : kNoSlot;
  }

  /// Lets one view take over any of the cells that it is a candidate of, at once, such that the sum falls the most.
  void expand(std::uint32_t view, const std::vector<std::uint32_t>& cells) {
    std::vector<std::uint32_t> active;
    std::vector<std::uint8_t> new_slot;
    for (const std::uint32_t i : cells) {
      if (view_of(i, slot_[i]) == view) continue;
      node_[i] = std::uint32_t(active.size());
      active.push_back(i);
      new_slot.push_back(slot_of(i, view));
    }
    MinCut cut(active.size());
    for (std::uint32_t k = 0; k < active.size(); ++k) {
      const std::uint32_t i = active[k];
      const std::span<const Candidate> list = candidates_.of(i);
      cut.add_cost(k, double(weight_[i] * (list[new_slot[k]].cost - list[slot_[i]].cost)));
      for (const std::uint32_t e : borders_.of(i)) {
        const std::uint32_t other = borders_.across(i, e), m = node_[other];
        if (m == kInvalidIndex)
          cut.add_cost(k, double(pair_cost(e, i, new_slot[k], other, slot_[other]) -
                                 pair_cost(e, i, slot_[i], other, slot_[other])));
        else if (i < other)
          add_link(cut, e, k, m, i, new_slot[k], other, new_slot[m]);
      }
    }
    const std::vector<std::uint8_t> is_taken = cut.solve();
    for (std::uint32_t k = 0; k < active.size(); ++k) {
      if (is_taken[k]) slot_[active[k]] = new_slot[k];
      node_[active[k]] = kInvalidIndex;
    }
  }

  /// The border between two cells that the view may take over, each by itself or both.
  void add_link(MinCut& cut, std::uint32_t e, std::uint32_t k, std::uint32_t m, std::uint32_t i, std::uint8_t new_slot,
                std::uint32_t other, std::uint8_t new_other) const {
    const auto neither = double(pair_cost(e, i, slot_[i], other, slot_[other]));
    const auto first = double(pair_cost(e, i, new_slot, other, slot_[other]));
    // Where it costs less to pass over two borders than over one, the cut cannot say so: then it overrates the one, and
    // finds less of a gain than there is, never a loss.
    const double second = std::max(double(pair_cost(e, i, slot_[i], other, new_other)), neither - first);
    cut.add_cost(k, first - neither);
    cut.add_cost(m, -first);
    cut.add_link(k, m, first + second - neither, 0);
  }

  /// How differently two images show a cell; negative when it is not known.
  float difference(std::uint32_t i, std::uint8_t slot, std::uint32_t other_view) const {
    const Rgb8 own = candidates_.of(i)[slot].color;
    const std::uint8_t other_slot = slot_of(i, other_view);
    if (other_slot == kNoSlot) return -1;
    const Rgb8 other = candidates_.of(i)[other_slot].color;
    const auto square = [](int x, int y) { return float((x - y) * (x - y)); };
    return std::sqrt((square(own.r, other.r) + square(own.g, other.g) + square(own.b, other.b)) / 3);
  }

  /// Of a border between cells that show these candidates.
  float pair_cost(std::uint32_t e, std::uint32_t i, std::uint8_t slot, std::uint32_t other,
                  std::uint8_t other_slot) const {
    const std::uint32_t view = view_of(i, slot), other_view = view_of(other, other_slot);
    if (view == other_view) return 0;
    const float here = difference(i, slot, other_view), there = difference(other, other_slot, view);
    const float d = here < 0 && there < 0 ? kUnknownDifference : std::max(here, there);
    return border_cost_[e] * (1 + d / kDifference);
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
    for (const CellBorder& border : borders_.all)
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
      for (const std::uint32_t e : borders_.of(i)) {
        const std::uint32_t other = borders_.across(i, e);
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
    for (const std::uint32_t i : region) slot_[i] = slot_of(i, best_view);
    return true;
  }

  /// Of another view over the present one for a region; some value over the limit when it is more than that.
  float extra_cost(const std::vector<std::uint32_t>& region, std::uint32_t view, float limit) const {
    float sum = 0;
    for (const std::uint32_t i : region) {
      const std::span<const Candidate> list = candidates_.of(i);
      const std::uint8_t slot = slot_of(i, view);
      if (slot == kNoSlot) return 3e38f;
      sum += weight_[i] * (list[slot].cost - list[slot_[i]].cost);
      if (sum > limit + 1e4f) return sum;
    }
    return sum;
  }

  const Candidates& candidates_;
  Context& context_;
  std::vector<std::uint8_t> slot_;
  const std::vector<float>& weight_;  // pixels of the best image
  CellBorders borders_;
  std::vector<float> border_cost_;                                     // where the images agree
  std::map<std::uint32_t, std::vector<std::uint32_t>> cells_of_view_;  // that it is a candidate of
  std::vector<std::uint32_t> node_;                                    // of each cell in the cut at hand
};

}  // namespace

std::vector<std::uint32_t> choose_images(const Mesh& mesh, const Cells& cells, const Candidates& candidates,
                                         const std::vector<SharedEdge>& edges, Context& context) {
  return Labelling(mesh, cells, candidates, edges, context).run();
}

}  // namespace lapseam
