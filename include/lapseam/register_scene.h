#pragma once

// Registration from a scene to a scene, and what to tell of it.

#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "lapseam/register.h"
#include "lapseam/survey.h"

namespace lapseam {

class Context;

struct RegisterSceneOptions {
  RegisterOptions registration{};  ///< its fixed views count as the scene does
  /// Views that cannot be loaded keep their poses, with a warning, instead of failing.
  bool skip_bad_views = false;
  /// Folder that range images without what their sensor is off by go to, with registration.calibrate.
  std::filesystem::path corrected_ranges{};
};

struct RegisterSceneReport {
  std::vector<std::string> names;  ///< of the views that were registered; pairs count these
  std::vector<std::string> views_left_out;
  std::vector<PlacedView> views;
  RegisterReport registration;
  std::map<std::string, RangeCorrection> corrections;  ///< by sensor id
  std::vector<std::string> unrounded;  ///< sensors whose ranges were whole steps, and were smoothed within those
  Disagreement disagreement_before, disagreement_after;
};

struct RegisterSceneResult {
  Scene scene;  ///< with new poses, covariances of those, and corrected range images where there are
  RegisterSceneReport report;
};

/// Loads the views and their pictures, estimates the noise, registers; writes range images only where sensors are
/// calibrated: of depth cameras that give whole disparities, these are smoothed first, no sample beyond the step that
/// it was rounded to. Same results for any number of threads. Throws InvalidInput, IoError, Cancelled.
RegisterSceneResult register_scene(const Scene& scene, const RegisterSceneOptions& options, Context& context);

/// The report with the context's stages and warnings, as JSON text.
std::string to_json(const RegisterSceneReport& report, const Context& context);
/// Capture range, placements and covariances, pairs, and what nothing determines, as JSON text.
std::string to_json(const RegisterReport& report, const std::vector<PlacedView>& views,
                    const std::vector<std::string>& names);
/// Views × views, before and after: how far each pair disagrees; as SVG text.
std::string to_svg(const RegisterSceneReport& report);

}  // namespace lapseam
