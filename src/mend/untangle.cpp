#include "mend/untangle.h"

#include <algorithm>
#include <tuple>
#include <vector>

#include "health/self_intersection.h"

namespace lapseam {

std::uint64_t remove_self_intersections(Mesh& mesh, std::span<const float> vertex_error_m, Context& context) {
  const SelfIntersections found = find_self_intersections(mesh.positions_m, mesh.triangles, context);
  if (found.pairs.empty()) return 0;
  struct Meeting {
    std::uint32_t triangle;
    std::vector<std::uint32_t> others;
    bool is_seam = false;
    float error_m = 0;
  };
  std::vector<Meeting> meetings;
  std::vector<std::uint32_t> meeting_of(mesh.triangle_count(), kInvalidIndex);
  const auto note = [&](std::uint32_t t, std::uint32_t other) {
    if (meeting_of[t] == kInvalidIndex) {
      meeting_of[t] = std::uint32_t(meetings.size());
      const Triangle& c = mesh.triangles[t];
      meetings.push_back({t,
                          {},
                          mesh.triangle_tag[t] == TriangleTag::kSeam,
                          std::max({vertex_error_m[c[0]], vertex_error_m[c[1]], vertex_error_m[c[2]]})});
    }
    meetings[meeting_of[t]].others.push_back(other);
  };
  for (const auto& [a, b] : found.pairs) {
    note(a, b);
    note(b, a);
  }
  std::sort(meetings.begin(), meetings.end(), [](const Meeting& a, const Meeting& b) {
    return std::tuple(b.is_seam, b.others.size(), b.error_m, b.triangle) <
           std::tuple(a.is_seam, a.others.size(), a.error_m, a.triangle);
  });
  std::vector<std::uint8_t> keep(mesh.triangle_count(), 1);
  std::uint64_t removed = 0;
  for (const Meeting& meeting : meetings) {
    if (std::none_of(meeting.others.begin(), meeting.others.end(), [&](std::uint32_t t) { return keep[t] != 0; }))
      continue;
    keep[meeting.triangle] = 0;
    ++removed;
  }
  mesh = compact(mesh, keep);
  return removed;
}

}  // namespace lapseam
