#pragma once

// Where the samples of one view fall in another, and what the other measured there.

#include <cstdint>
#include <vector>

#include "survey/view_probe.h"

namespace lapseam {

/// One sample of a on the smooth surface of b.
struct SampleDisagreement {
  double along_ray_m;  ///< a's range in b's image less b's
  double cosine;       ///< between b's normal and ray
  double sigma_m;      ///< what noise makes of along_ray_m
  double across_m;     ///< a's distance from b's surface, along b's normal; positive behind it
};

struct ViewComparison {
  std::uint64_t in_frame = 0;    ///< of a's samples, those that fall on a pixel of b
  std::uint64_t on_surface = 0;  ///< of these, those near enough to what b measured
  std::vector<SampleDisagreement> disagreements;
};

ViewComparison compare_views(const ViewProbe& a, const View& b, const NoiseModel& noise_b, const ViewProbe& probe_b);

/// By nth_element; 0 for none. share in [0, 1].
double quantile(std::vector<double>& values, double share);

}  // namespace lapseam
