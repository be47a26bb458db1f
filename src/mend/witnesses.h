#pragma once

// What all views together say of a place in space: surface, or nothing there.

#include <Eigen/Core>
#include <cstdint>
#include <limits>
#include <optional>
#include <span>
#include <vector>

#include "lapseam/overlap.h"
#include "lapseam/patch.h"
#include "overlap/view_projection.h"
#include "patch/by_view.h"
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

/// How many views say what of a place, each counting alike.
struct ViewCount {
  std::uint32_t surface = 0;  ///< measured a surface here that faces them
  std::uint32_t empty = 0;    ///< looked through here, from either side
};

/// Answers are const and thread-safe. The patches must outlive it.
class Witnesses {
 public:
  Witnesses(std::span<const Patch> patches, const Eigen::Vector3d& origin_m, const OverlapOptions& options);

  /// Views that may see something of a sphere.
  std::vector<std::uint32_t> find_views(const Eigen::Vector3f& center, float radius_m) const;
  /// normal: unit, of the surface that is asked about. error_m: how far it may be off along it. size_m: how large it
  /// is. Where it is no larger than what a range may be off by, a view that measured a surface much less slanted says
  /// nothing: between a thing and a wall close behind it, such a piece would be as near to both as they are.
  Hearing ask(std::span<const std::uint32_t> views, const Eigen::Vector3f& point, const Eigen::Vector3f& normal,
              float error_m, float size_m) const;
  /// The same question, put to the vote: what a view measured farther off than half of what noise and poses may do is
  /// not this surface. Ranges count as they are, also beside steps.
  ViewCount count(std::span<const std::uint32_t> views, const Eigen::Vector3f& point, const Eigen::Vector3f& normal,
                  float error_m) const;
  /// Whether a view looks along a surface, so that its ranges say little of it. normal: unit, to either side.
  bool is_edge_on(std::uint32_t view, const Eigen::Vector3f& point, const Eigen::Vector3f& normal) const;
  /// Between questions: gives range images back if a memory budget asks for it.
  void relieve() const { lapseam::relieve(patches_.front()); }
  /// Noise of the sample that a vertex was made from, along its ray.
  float sigma_of(std::uint32_t view, std::uint32_t pixel) const;

 private:
  // A place in a view.
  struct Look {
    CanvasPoint at;
    int u = 0, v = 0;  // of the pixel
    std::size_t pixel = 0;
    float measured_m = 0;   // range
    float tolerance_m = 0;  // along the ray
    float cosine = 0;       // of the ray to the normal that is asked about; positive: faces the view
    float behind_m() const { return measured_m - at.r; }
  };

  /// Nothing where the view measured nothing.
  std::optional<Look> look(const ViewCanvas& canvas, const Eigen::Vector3f& point, const Eigen::Vector3f& normal,
                           float error_m) const;
  static bool is_too_steep(const ViewCanvas& canvas, const Look& look, float size_m);
  /// Whether all around lies behind the place by more than so many tolerances.
  static bool is_looked_through(const ViewCanvas& canvas, const Look& look, float error_m, float clearance);

  std::span<const Patch> patches_;
  std::vector<ViewCanvas> canvases_;
  std::vector<ViewCone> cones_;
};

}  // namespace lapseam
