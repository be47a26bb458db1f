#pragma once

// Which views overlap, and which of those pairs tie the network.

#include <cstdint>
#include <span>
#include <vector>

#include "lapseam/context.h"
#include "register/associate.h"

namespace lapseam {

struct Overlap {
  std::uint32_t a = 0, b = 0;  ///< a < b
  double share = 0;            ///< of the surfels of the one that lie on the other, the larger of both
};

/// All pairs that share at least kLeastOverlap of a view, by a, then b. views: posed, at a coarse level.
std::vector<Overlap> find_overlaps(std::span<const Posed> views, double capture_m, Context& context);

/// Of each view's partners, so many, from the best to the poorest in even steps: near ones tie tightly, far ones keep
/// long chains from bending. What links parts together stays.
std::vector<Overlap> select_pairs(const std::vector<Overlap>& all, std::size_t views, std::size_t most_partners);

/// The part that each view belongs to: its smallest member.
std::vector<std::uint32_t> linked_parts(const std::vector<Overlap>& pairs, std::size_t views);

}  // namespace lapseam
