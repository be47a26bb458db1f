#pragma once

// The smooth stage alone, from files to files.

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "lapseam/smooth.h"
#include "lapseam/view.h"

namespace lapseam {

class Context;

struct SmoothSceneOptions {
  SmoothOptions smooth{};
  /// Leave out views that cannot be loaded, with a warning, instead of failing.
  bool skip_bad_views = false;
};

/// One view that was smoothed.
struct SmoothedView {
  std::string name;
  std::uint64_t samples = 0;           ///< before and after
  double remaining_sigma_factor = 1;   ///< what is left of the noise, as a factor on sigma; median over samples
  double median_abs_shift_sigmas = 0;  ///< how far samples were moved along their rays, in sigmas; median
};

struct SmoothSceneReport {
  std::vector<SmoothedView> views;
  std::vector<std::string> views_left_out;
};

/// Smooths all range images of a scene into folder/range/*.exr and writes folder/scene.json: same poses, same sensors,
/// the colour images where they are. Each view states what is left of its noise: what one would estimate from a
/// smoothed image is too little, since its neighbours share their errors. Nothing of the scene is overwritten: a folder
/// that holds its manifest or range images is refused. Holds as many views in memory as there are threads, and for a
/// moment those that the noise is estimated from. Same bytes for any number of threads. Throws InvalidInput, IoError,
/// Cancelled.
SmoothSceneReport smooth_scene(const Scene& scene, const std::filesystem::path& folder,
                               const SmoothSceneOptions& options, Context& context);

}  // namespace lapseam
