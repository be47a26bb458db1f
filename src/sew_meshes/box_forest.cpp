#include "sew_meshes/box_forest.h"

#include <algorithm>
#include <utility>

namespace lapseam {
namespace {

constexpr std::size_t kPending = 64;  // boxes that are searched one by one

}  // namespace

BoxForest::Tree::Tree(std::vector<BoxEntry> unsorted) {
  Box bounds;
  for (const BoxEntry& entry : unsorted) bounds.extend(entry.box);
  const double size = std::max(1e-30, (bounds.high.cast<double>() - bounds.low.cast<double>()).maxCoeff());
  std::vector<std::pair<std::uint64_t, std::uint32_t>> order(unsorted.size());
  for (std::uint32_t i = 0; i < unsorted.size(); ++i) {
    const Eigen::Vector3d center = 0.5 * (unsorted[i].box.low.cast<double>() + unsorted[i].box.high.cast<double>());
    const Eigen::Vector3d place = (center - bounds.low.cast<double>()) / size * 2097151.0;
    order[i] = {0, i};
    for (int k = 0; k < 3; ++k) order[i].first |= spread_bits(std::uint64_t(std::clamp(place[k], 0.0, 2097151.0))) << k;
  }
  std::sort(order.begin(), order.end());
  entries.reserve(unsorted.size());
  for (const auto& [code, i] : order) entries.push_back(unsorted[i]);
  std::vector<Box> children(entries.size());
  for (std::size_t i = 0; i < entries.size(); ++i) children[i] = entries[i].box;
  do {
    std::vector<Box> level((children.size() + kArity - 1) / kArity);
    for (std::size_t i = 0; i < children.size(); ++i) level[i / kArity].extend(children[i]);
    levels.push_back(level);
    children = std::move(level);
  } while (children.size() > 1);
}

void BoxForest::add(std::vector<BoxEntry> entries) {
  if (entries.empty()) return;
  // Smaller trees are merged into the new one, so that each is at least twice as large as the next.
  while (!trees_.empty() && trees_.back().entries.size() < 2 * entries.size()) {
    entries.insert(entries.end(), trees_.back().entries.begin(), trees_.back().entries.end());
    trees_.pop_back();
  }
  trees_.emplace_back(std::move(entries));
}

void BoxForest::add(const BoxEntry& entry) {
  pending_.push_back(entry);
  if (pending_.size() < kPending) return;
  add(std::exchange(pending_, {}));
}

}  // namespace lapseam
