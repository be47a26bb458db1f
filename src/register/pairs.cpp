#include "register/pairs.h"

#include <algorithm>

#include "core/disjoint_sets.h"
#include "core/parallel.h"

namespace lapseam {
namespace {

// Pairs that share less than this of both views tell little, and mostly wrong.
constexpr double kLeastOverlap = 0.05;
// Surfels of a view that are looked up in each other view.
constexpr std::size_t kProbes = 300;

}  // namespace

std::vector<Overlap> find_overlaps(std::span<const Posed> views, double capture_m, Context& context) {
  const std::size_t n = views.size();
  std::vector<double> share(n * n);
  const Gate gate{capture_m, capture_m};
  parallel_for(context, n, 1, [&](std::size_t a) {
    const std::size_t stride = std::max<std::size_t>(1, views[a].image->usable.size() / kProbes);
    const std::size_t looked_up = (views[a].image->usable.size() + stride - 1) / stride;
    for (std::size_t b = 0; b < n; ++b) {
      if (a == b) continue;
      const std::size_t found = find_matches(views[a], views[b], gate, stride).size();
      share[a * n + b] = looked_up > 0 ? double(found) / double(looked_up) : 0;
    }
  });
  std::vector<Overlap> out;
  for (std::size_t a = 0; a < n; ++a)
    for (std::size_t b = a + 1; b < n; ++b) {
      const double larger = std::max(share[a * n + b], share[b * n + a]);
      if (larger >= kLeastOverlap) out.push_back({std::uint32_t(a), std::uint32_t(b), larger});
    }
  return out;
}

std::vector<Overlap> select_pairs(const std::vector<Overlap>& all, std::size_t views, std::size_t most_partners) {
  std::vector<std::uint32_t> order(all.size());  // best first
  for (std::size_t i = 0; i < all.size(); ++i) order[i] = std::uint32_t(i);
  std::sort(order.begin(), order.end(), [&](std::uint32_t x, std::uint32_t y) {
    return all[x].share != all[y].share ? all[x].share > all[y].share : x < y;
  });
  std::vector<std::vector<std::uint32_t>> pairs_of(views);
  std::vector<bool> is_kept(all.size(), false);
  DisjointSets sets(views);
  for (const std::uint32_t i : order) {
    pairs_of[all[i].a].push_back(i);
    pairs_of[all[i].b].push_back(i);
    if (sets.find(all[i].a) == sets.find(all[i].b)) continue;
    sets.unite(all[i].a, all[i].b);
    is_kept[i] = true;
  }
  for (const auto& candidates : pairs_of) {
    const std::size_t count = std::min(candidates.size(), most_partners);
    for (std::size_t k = 0; k < count; ++k) is_kept[candidates[k * candidates.size() / count]] = true;
  }
  std::vector<Overlap> out;
  for (std::size_t i = 0; i < all.size(); ++i)
    if (is_kept[i]) out.push_back(all[i]);
  return out;
}

std::vector<std::uint32_t> linked_parts(const std::vector<Overlap>& pairs, std::size_t views) {
  DisjointSets sets(views);
  for (const Overlap& pair : pairs) sets.unite(pair.a, pair.b);
  std::vector<std::uint32_t> out(views);
  for (std::uint32_t i = 0; i < views; ++i) out[i] = sets.find(i);
  return out;
}

}  // namespace lapseam
