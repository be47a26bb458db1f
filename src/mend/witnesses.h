#pragma once

// What all views together say of a place in space: surface, or nothing there.

#include <Eigen/Core>
#include <cstdint>
#include <limits>
#include <span>
#include <vector>

#include "lapseam/overlap.h"
#include "lapseam/patch.h"
#include "overlap/view_projection.h"
#include "sew/view_canvas.h"

namespace lapseam {

/// How noisy a range is to the best view that says so; infinite: none does.
struct Hearing {
  float surface_sigma_m = std::numeric_limits<float>::infinity();  ///< measured a surface here that faces it
  float empty_sigma_m = std::numeric_limits<float>::infinity();    ///< looked through here, from either side

  /// A view that looked through, and whose noise is clearly smaller than that of any that saw a surface.
  bool is_empty() const;
  bool is_surface() const { return surface_sigma_m < std::numeric_limits<float>::infinity() && !is_empty(); }
};

/// Answers are const and thread-safe. The patches must outlive it.
class Witnesses {
 public:
  Witnesses(std::span<const Patch> patches, const Eigen::Vector3d& origin_m, const OverlapOptions& options);

  /// Views that may see something of a sphere.
  std::vector<std::uint32_t> find_views(const Eigen::Vector3f& center, float radius_m) const;
  /// normal: unit, of the surface that is asked about. error_m: how far it may be off along it.
  Hearing ask(std::span<const std::uint32_t> views, const Eigen::Vector3f& point, const Eigen::Vector3f& normal,
              float error_m) const;
  /// Whether a view looks along a surface, so that its ranges say little of it. normal: unit, to either side.
  bool is_edge_on(std::uint32_t view, const Eigen::Vector3f& point, const Eigen::Vector3f& normal) const;
  /// Noise of the sample that a vertex was made from, along its ray.
  float sigma_of(std::uint32_t view, std::uint32_t pixel) const;

 private:
  void hear(const ViewCanvas& canvas, const Eigen::Vector3f& point, const Eigen::Vector3f& normal, float error_m,
            Hearing& hearing) const;

  std::span<const Patch> patches_;
  std::vector<ViewCanvas> canvases_;
  std::vector<ViewCone> cones_;
};

}  // namespace lapseam
