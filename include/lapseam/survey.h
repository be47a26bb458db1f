#pragma once

// What a scene holds and how well its views fit together, before anything is made of it.

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "lapseam/noise_measurement.h"
#include "lapseam/view.h"

namespace lapseam {

class Context;

struct SurveyOptions {
  bool with_pairs = true;  ///< compare every view with every other
  /// Samples of each view that are looked up in the other views.
  int samples_per_view = 1000;
  /// Range images are kept while all views are read up to this size; the rest is read once more for the pairs.
  std::uint64_t keep_bytes = std::uint64_t(1) << 30;
};

struct ViewSurvey {
  std::string name;
  std::string sensor_id;
  std::string sensor_kind;  ///< see kind_name
  int width = 0, height = 0;
  std::uint64_t samples = 0;    ///< valid ones
  double valid_share = 0;       ///< of the pixels, 0 to 1
  MissingSamples missing = {};  ///< why the other pixels have none
  double range_min_m = 0, range_median_m = 0, range_max_m = 0;
  double spacing_m = 0;  ///< median distance between neighbouring samples of a surface that faces the sensor
  std::string problem;   ///< why the view cannot be used; empty: it can, and all above is filled
  bool is_usable() const { return problem.empty(); }
};

struct SensorSurvey {
  std::string sensor_id;
  std::uint64_t views = 0;          ///< usable ones
  NoiseModel noise;                 ///< estimated from the range images
  std::vector<NoiseBin> bins;       ///< what that was fitted to
  std::optional<NoiseModel> given;  ///< what the scene says, of its first view that says something
};

/// View a seen by view b. Disagreement is signed, across b's surface, as closest points would have it (along the ray, a
/// grazing look magnifies it): positive where a's surface lies behind b's.
struct PairSurvey {
  std::uint32_t a = 0, b = 0;  ///< indices into Survey::views
  double overlap = 0;          ///< share of a's samples that lie on b's surface, within noise and spacing
  std::uint64_t compared = 0;  ///< samples that the next three come from: where both are smooth and face alike
  double median_m = 0, median_absolute_m = 0, p90_absolute_m = 0;
};

/// How far overlapping views disagree beyond their noise, across the surface. Zero where the noise explains it.
struct RegistrationError {
  double median_m = 0, p90_m = 0;  ///< over the pairs
  std::uint64_t pairs = 0;         ///< that overlap enough to tell
};

/// Which pairs of views disagree, and by how much all together: a badly placed station shows at once.
struct Disagreement {
  std::vector<PairSurvey> pairs;  ///< those with any overlap, by a, then b
  /// Between a sample of one view and the surface of another: median of all that were compared, so that a pair counts
  /// by what it shares.
  double distance_m = 0;
  RegistrationError error;
};

struct Survey {
  std::vector<ViewSurvey> views;      ///< as in the scene
  std::vector<SensorSurvey> sensors;  ///< by id, of usable views
  std::vector<PairSurvey> pairs;      ///< those with any overlap, by a, then b
  double distance_m = 0;              ///< as Disagreement has it
  RegistrationError registration;
  std::uint64_t usable_views() const;
};

/// Reads all views, in parallel. A view that cannot be read is described, not thrown. Deterministic. Without the
/// reading, a hundred views take about a second on two cores.
Survey survey(const Scene& scene, const SurveyOptions& options, Context& context);

/// views and their noise, one each. Deterministic; 60 µs per ordered pair of views that overlap.
Disagreement survey_disagreement(std::span<const View> views, std::span<const NoiseModel> noise, Context& context);
/// As JSON text, with the views' names.
std::string to_json(const Disagreement& disagreement, const std::vector<std::string>& names);
/// Of that, the error alone.
RegistrationError estimate_registration_error(std::span<const View> views, std::span<const NoiseModel> noise,
                                              Context& context);

}  // namespace lapseam
