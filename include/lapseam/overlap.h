#pragma once

// Finding and removing the overlap of a new view with the model. After Sun, Dumont, Abidi 2000, §2.2.

#include <cstdint>
#include <memory>
#include <span>

#include "lapseam/patch.h"

namespace lapseam {

class Context;

struct OverlapOptions {
  /// Two surfaces closer than this many standard deviations of their distance are one.
  double noise_factor = 2.5;
  /// How far views are off by their poses and calibration, metres (estimate_registration_error); widens the tolerance.
  double registration_error_m = 0;
  /// Remove triangles that another view measured to be empty space (moved things, phantom surfaces, flying pixels).
  bool remove_seen_through = true;
};

struct OverlapCounts {
  std::uint64_t tested = 0;                ///< projections of a triangle into another view that fell inside its frame
  std::uint64_t removed_old = 0;           ///< model triangles that lost to the new view
  std::uint64_t removed_new = 0;           ///< new triangles that lost to the model
  std::uint64_t removed_seen_through = 0;  ///< triangles, old or new, that another view saw through
};

/// Whether a view measured clearly behind a world point, in every sample around it: the point is in empty space.
/// False where the view has no samples, or the point is outside its frame.
bool is_seen_through(const Patch& patch, const Eigen::Vector3d& point_world_m, const OverlapOptions& options);

/// The overlap between a growing model and the views that are added to it, one after another. Keeps what is worth
/// keeping between two views: where each view can look, and where each still has triangles.
class OverlapRemoval {
 public:
  explicit OverlapRemoval(const OverlapOptions& options = {});
  ~OverlapRemoval();

  /// Takes patches.back() into the model, which is all patches before it; call once for each new patch. Alive bits
  /// change, nothing else does. First every model triangle is projected into the new view and compared with the new
  /// triangles it overlaps there; then every new triangle that is left is projected into each older view and compared
  /// with what is alive there, since overlap depends on the view. The less confident goes; about equal confidence keeps
  /// the model's. Decisions of one pass read the state before it, so the result does not depend on threads. Cost: about
  /// 0.3 µs per triangle and view that can see it.
  OverlapCounts add(std::span<Patch> patches, Context& context);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// Kills connected pieces of a view's alive triangles that are smaller than `smallest` and were cut out by overlap:
/// confetti between two views that are about equally good. Pieces that the view saw as they are stay. Returns the
/// triangles killed.
std::uint64_t remove_islands(std::span<Patch> patches, std::uint64_t smallest, Context& context);

}  // namespace lapseam
