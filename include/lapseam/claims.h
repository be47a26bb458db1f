#pragma once

// Which view measured each spot best. After Sun, Dumont, Abidi 2000, §2.2: overlap is found by projecting into the other
// view, and the less confident measurement goes; here for samples, and for all views at once.

#include <cstdint>
#include <span>
#include <vector>

#include "lapseam/overlap.h"
#include "lapseam/patch.h"

namespace lapseam {

class Context;

/// What all views together say of one sample.
enum class Claim : std::uint8_t {
  kNone = 0,     ///< no sample, or no triangle uses it
  kYields = 1,   ///< another view measured this spot better
  kBest = 2,     ///< no other view did
  kPhantom = 3,  ///< another view looked through it
};

struct ClaimOptions {
  OverlapOptions overlap{};
  /// Pieces of fewer samples, won or lost amidst another view's, go to their surroundings.
  std::uint64_t smallest_island = 100;
};

struct ClaimCounts {
  std::uint64_t best = 0, yields = 0, phantom = 0, islands = 0;  ///< samples
};

/// One image of Claim per patch. Every sample is projected into every view that can see it; it yields to a view that
/// measured the same surface there with more confidence. Equal confidence: the earlier view. Deterministic. counts: one
/// per patch, or empty.
std::vector<Image<std::uint8_t>> claim_samples(std::span<Patch> patches, const ClaimOptions& options,
                                               std::span<ClaimCounts> counts, Context& context);

}  // namespace lapseam
