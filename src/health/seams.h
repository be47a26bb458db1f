#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <span>

#include "health/incidence.h"
#include "lapseam/seam_health.h"

namespace lapseam {

/// A mesh with tags whose incidence is known, welded or not.
struct TaggedSurface {
  std::span<const Eigen::Vector3f> positions_m;
  std::span<const Triangle> triangles;
  std::span<const TriangleTag> tag;
  std::span<const std::uint32_t> view;
  /// 1 where a triangle meets another; empty: not checked.
  std::span<const std::uint8_t> is_meeting;
};

SeamHealth measure_seams(const TaggedSurface& surface, const Incidence& incidence, std::uint64_t island_triangles,
                         Context& context);

}  // namespace lapseam
