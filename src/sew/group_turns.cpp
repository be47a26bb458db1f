#include <algorithm>

#include "lapseam/sew.h"

namespace lapseam {

std::vector<std::vector<std::uint32_t>> group_turns(std::uint32_t views,
                                                    std::span<const std::array<std::uint32_t, 2>> overlapping,
                                                    std::size_t largest) {
  std::vector<std::uint8_t> overlaps(std::size_t(views) * views, 0);
  for (const auto& [a, b] : overlapping)
    overlaps[std::size_t(a) * views + b] = overlaps[std::size_t(b) * views + a] = 1;
  std::vector<std::vector<std::uint32_t>> groups;
  std::vector<std::uint8_t> is_taken(views, 0);
  for (std::uint32_t first = 0; first < views; ++first) {
    if (is_taken[first]) continue;
    std::vector<std::uint32_t>& group = groups.emplace_back(1, first);
    for (std::uint32_t next = first + 1; next < views && group.size() < largest; ++next) {
      const auto sees = [&](std::uint32_t other) { return overlaps[std::size_t(other) * views + next] != 0; };
      if (is_taken[next] || std::any_of(group.begin(), group.end(), sees)) continue;
      group.push_back(next);
      is_taken[next] = 1;
    }
  }
  return groups;
}

}  // namespace lapseam
