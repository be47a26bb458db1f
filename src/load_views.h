#pragma once

// The views of a scene in memory, with the noise of each: what every pipeline begins with.

#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "lapseam/context.h"
#include "lapseam/noise_measurement.h"
#include "lapseam/register.h"
#include "lapseam/view.h"

namespace lapseam {

struct LoadOptions {
  int hold_out = 0;             ///< leave out every Nth view, from the first; 0: none
  bool skip_bad_views = false;  ///< leave out views that cannot be loaded, with a warning, instead of failing
};

struct LoadedViews {
  std::vector<View> views;
  std::vector<std::uint32_t> source_index;  ///< of each view, its index in the scene
  std::vector<std::string> left_out;        ///< names
};
/// Throws InvalidInput, IoError, Cancelled; also when no view is left.
LoadedViews load_views(const Scene& scene, const LoadOptions& options, Context& context);

/// Reads a view's picture when asked. Both must outlive it.
PictureOf pictures_of(const Scene& scene, const LoadedViews& loaded);

/// Fixed views count as the scene does; what was loaded counts by itself. Throws InvalidInput for one that was not.
std::vector<std::uint32_t> places_of(const std::vector<std::uint32_t>& fixed, const LoadedViews& loaded,
                                     const Scene& scene);

struct SensorNoise {
  NoiseModel noise;
  bool is_given = false;             ///< by the scene, not estimated
  NoiseMeasurement measured;         ///< what would be estimated
  std::vector<std::size_t> members;  ///< places of its views
};
struct ViewNoise {
  std::map<std::string, SensorNoise> sensors;  ///< by id
  std::vector<NoiseModel> of_view;
};
/// One model per sensor: what the scene says of its first view that says something, else estimated.
ViewNoise estimate_view_noise(const Scene& scene, const LoadedViews& loaded, Context& context);
/// Those that the noise of the view does not depend on.
void drop_unused_intensities(const std::vector<NoiseModel>& noise, std::vector<View>& views);

}  // namespace lapseam
