#pragma once

// Boxes that can be searched while more of them are added.

#include <cstdint>
#include <vector>

#include "spatial/box.h"

namespace lapseam {

struct BoxEntry {
  Box box;
  std::uint32_t id = 0;
};

/// Trees of doubling size, so that adding costs O(log² n) on average and a search visits O(log n) trees. Based on:
/// J. Bentley, J. Saxe, Decomposable Searching Problems, 1980. Nothing is taken out: callers skip what is gone.
class BoxForest {
 public:
  /// In any order; one large call is cheaper than many small ones.
  void add(std::vector<BoxEntry> entries);
  void add(const BoxEntry& entry);
  /// Calls visit(id) for every box that overlaps, touching included, until it returns true; returns whether it did.
  template <class Visit>
  bool find(const Box& box, const Visit& visit) const {
    for (const BoxEntry& entry : pending_)
      if (entry.box.overlaps(box) && visit(entry.id)) return true;
    for (const Tree& tree : trees_)
      if (tree.find(box, visit)) return true;
    return false;
  }

 private:
  static constexpr std::size_t kArity = 4;

  /// Entries in Morton order under levels of boxes of four children each.
  struct Tree {
    std::vector<BoxEntry> entries;
    std::vector<std::vector<Box>> levels;  // the lowest first; the last is the root

    explicit Tree(std::vector<BoxEntry> unsorted);
    template <class Visit>
    bool find(const Box& box, const Visit& visit) const {
      return find_below(levels.size(), 0, box, visit);
    }
    template <class Visit>
    bool find_below(std::size_t level, std::size_t index, const Box& box, const Visit& visit) const {
      if (level == 0) return entries[index].box.overlaps(box) && visit(entries[index].id);
      if (!levels[level - 1][index].overlaps(box)) return false;
      const std::size_t count = level == 1 ? entries.size() : levels[level - 2].size();
      for (std::size_t child = index * kArity; child < count && child < (index + 1) * kArity; ++child)
        if (find_below(level - 1, child, box, visit)) return true;
      return false;
    }
  };

  std::vector<Tree> trees_;  // the largest first
  std::vector<BoxEntry> pending_;
};

}  // namespace lapseam
