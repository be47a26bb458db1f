#pragma once

// Which view measured each spot best, and where the views agree that it is. After Sun, Dumont, Abidi 2000, §2.2:
// overlap is found by projecting into the other view, and the less confident measurement goes; here for samples instead
// of triangles, and for all views at once, so that the result does not depend on their order.

#include <cstdint>
#include <span>
#include <vector>

#include "lapseam/patch.h"

namespace lapseam {

class Context;

struct OverlapOptions {
  /// Two surfaces closer than this many standard deviations of their distance are one.
  double noise_factor = 2.5;
  /// How far two views part by their poses and calibration, metres (estimate_registration_error); widens the tolerance.
  double registration_error_m = 0;
  /// Leave out samples that more than half as many views measured to be empty space as measured a surface there, the
  /// sample's own among them (moved things, phantom surfaces, flying pixels).
  bool remove_seen_through = true;
  /// Move every sample along its ray to the inverse-variance mean of all views that measured its spot.
  bool consensus = true;
  /// Pieces of fewer samples, won or lost amidst another view's, go to their surroundings.
  std::uint64_t smallest_island = 100;
};

/// What all views together say of one sample.
enum class Claim : std::uint8_t {
  kNone = 0,     ///< no sample, or no triangle uses it
  kYields = 1,   ///< another view measured this spot better
  kBest = 2,     ///< no other view did
  kPhantom = 3,  ///< others looked through it, too many for those that agree
};

struct ClaimCounts {
  std::uint64_t best = 0, yields = 0, phantom = 0, islands = 0;  ///< samples
};

/// One image of Claim per patch. Samples are projected into every view that can see them and whose noise there is not
/// over twice theirs; a sample yields to a view that measured the same surface there with more confidence. Equal
/// confidence: the earlier view. On unbroken surface every fourth sample of every fourth row is asked for, and those
/// between follow the nearest; elsewhere each is. With options.consensus the patches' ranges, which should be smoothed
/// over such distances, move to the mean of what all agreeing views measured, as far off as half the noise and three
/// times the registration error, weighted by the inverse variance along the normal (see docs/method.md), interpolated
/// likewise. counts: one per patch, or empty. Deterministic; about 50 ns
/// per sample that is asked for and view that can see it.
std::vector<Image<std::uint8_t>> claim_samples(std::span<Patch> patches, const OverlapOptions& options,
                                               std::span<ClaimCounts> counts, Context& context);

}  // namespace lapseam
