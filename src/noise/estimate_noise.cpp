#include <algorithm>
#include <cmath>
#include <cstddef>
#include <vector>

#include "core/parallel.h"
#include "lapseam/error.h"
#include "lapseam/noise.h"
#include "lapseam/noise_measurement.h"
#include "noise/conditions.h"
#include "noise/fit_noise.h"
#include "noise/noise_symmetry.h"
#include "noise/robust_sigma.h"
#include "noise/roughness.h"

namespace lapseam {
namespace {

constexpr int kTilesPerView = 64;
// Enough for one part in a hundred in every bin; more views give fewer tiles each.
constexpr int kTilesInAll = 4096, kFewestTilesPerView = 8;

// Bins of equal ratio of ranges, none narrower or with fewer samples.
constexpr int kBins = 24;
constexpr double kNarrowestBin = 1.03;
constexpr std::size_t kFewestPerBin = 200, kFewestInAll = 30;

// A value rounded to steps is off by this part of a step.
const double kFromStep = 1 / std::sqrt(12.0);
// From here on a mean over neighbours is no better than one of them.
constexpr double kMostCorrelated = 4;
// A float holds a value to half a unit in the last of 24 bits.
constexpr double kFloatStep = 1.0 / (1 << 24);

constexpr int kConditionPasses = 6;

// Without enough samples next to one another, half a percent of the range: between a good and a bad depth camera.
constexpr double kUnknownNoise = 0.005;

// Every so many samples are looked at for steps of rounding.
constexpr std::size_t kRangesPerView = 20'000, kRangesInAll = 400'000;

struct Samples {
  std::vector<Roughness> roughness;
  std::vector<float> ranges;
};

Samples sample_view(const View& view, int tiles, std::size_t range_count) {
  Samples out;
  out.roughness = measure_roughness(view, tiles);
  const std::size_t stride = std::max<std::size_t>(1, view.range.size() / range_count);
  for (std::size_t i = 0; i < view.range.size(); i += stride)
    if (view.range.pixels[i] > 0) out.ranges.push_back(view.range.pixels[i]);
  return out;
}

Samples sample_views(std::span<const View* const> views, Context& context) {
  const int n = int(views.size());
  const int tiles = std::clamp(kTilesInAll / n, kFewestTilesPerView, kTilesPerView);
  const std::size_t range_count = std::max<std::size_t>(1000, std::min(kRangesPerView, kRangesInAll / views.size()));
  std::vector<Samples> per_view(views.size());
  parallel_for(context, views.size(), 1,
               [&](std::size_t i) { per_view[i] = sample_view(*views[i], tiles, range_count); });
  Samples all;
  for (const Samples& s : per_view) {
    all.roughness.insert(all.roughness.end(), s.roughness.begin(), s.roughness.end());
    all.ranges.insert(all.ranges.end(), s.ranges.begin(), s.ranges.end());
  }
  return all;
}

// The step that values between two ranges were rounded to, 0 if none shows. sorted: all sampled ranges. Steps may grow
// with range: `share` says which of them, 0 the smallest, 1 the largest.
double step_between(const std::vector<float>& sorted, float from, float to, double share) {
  const auto begin = std::lower_bound(sorted.begin(), sorted.end(), from);
  const auto end = std::upper_bound(begin, sorted.end(), to);
  std::vector<float> gaps;
  for (auto it = begin; it != end && it + 1 != end; ++it)
    if (it[1] > it[0]) gaps.push_back(it[1] - it[0]);
  // Values that were not rounded hardly ever meet.
  if (gaps.empty() || 4 * gaps.size() > std::size_t(end - begin)) return 0;
  const auto at = gaps.begin() + std::ptrdiff_t(share * double(gaps.size() - 1));
  std::nth_element(gaps.begin(), at, gaps.end());
  return double(*at);
}

struct Bins {
  std::vector<NoiseBin> bins;
  double correlation = 1;
};

Bins make_bins(std::vector<Roughness>& samples, const std::vector<float>& sorted_ranges) {
  std::sort(samples.begin(), samples.end(), [](const Roughness& a, const Roughness& b) {
    return a.range != b.range ? a.range < b.range : a.residual_m < b.residual_m;
  });
  const float low = samples.front().range, high = samples.back().range;
  const double ratio = std::max(std::pow(double(high) / double(low), 1.0 / kBins), kNarrowestBin);
  const std::size_t fewest = std::min(kFewestPerBin, samples.size());
  Bins out;
  double correlation = 0, samples_in_all = 0;
  std::vector<float> sizes;
  std::size_t begin = 0;
  for (int k = 1; k <= kBins; ++k) {
    const auto limit = float(double(low) * std::pow(ratio, k));
    std::size_t end = begin;
    while (end < samples.size() && (k == kBins || samples[end].range < limit)) ++end;
    // Too few stay for the next bin; what is left over at the end goes to none.
    if (end - begin < fewest) continue;
    sizes.clear();
    for (std::size_t i = begin; i < end; ++i) sizes.push_back(std::abs(samples[i].residual_m));
    const double step = step_between(sorted_ranges, samples[begin].range, samples[end - 1].range, 0.5);
    const double middle = double(samples[begin + (end - begin) / 2].range);
    const double least = std::max(step * kFromStep, middle * kFloatStep), rough = robust_sigma(sizes);
    const double excess = step > 0 ? step * kFromStep / std::max(rough, middle * kFloatStep) : 1;
    out.bins.push_back({middle, std::max(rough, least), double(end - begin)});
    correlation += double(end - begin) * std::clamp(excess * excess, 1.0, kMostCorrelated);
    samples_in_all += double(end - begin);
    begin = end;
  }
  if (samples_in_all > 0) out.correlation = correlation / samples_in_all;
  return out;
}

}  // namespace

NoiseModel estimate_noise(std::span<const View* const> views, Context& context) {
  NoiseModel noise = measure_noise(views, context).model;
  const std::vector<const NoiseModel*> of_views(views.size(), &noise);
  noise.is_symmetric_in_range = is_symmetric_in_range(views, of_views, context);
  return noise;
}

NoiseMeasurement measure_noise(std::span<const View* const> views, Context& context) {
  if (views.empty()) throw InvalidInput({}, {}, "noise", "no view to estimate it from");
  Samples samples = sample_views(views, context);
  std::sort(samples.ranges.begin(), samples.ranges.end());
  if (samples.ranges.empty()) throw InvalidInput({}, views.front()->name, "noise", "no sample to estimate it from");

  const auto middle = double(samples.ranges[samples.ranges.size() / 2]);
  Bins found;
  NoiseModel noise{.s1 = kUnknownNoise};
  if (samples.roughness.size() >= kFewestInAll) {
    found = make_bins(samples.roughness, samples.ranges);
    if (!found.bins.empty()) noise = fit_noise(found.bins);
    // What incidence and intensity make worse is taken out of the residuals, and the rest looked at again.
    for (int pass = 0; pass < kConditionPasses && !found.bins.empty(); ++pass) {
      noise.pointing_rad = fit_pointing(samples.roughness, noise);
      fit_intensity(samples.roughness, noise);
      if (noise.pointing_rad == 0 && noise.intensity_power == 0) {
        found = make_bins(samples.roughness, samples.ranges);  // not what was left for a condition that is none
        noise = fit_noise(found.bins);
        break;
      }
      std::vector<Roughness> rest = without_conditions(samples.roughness, noise);
      if (rest.size() < kFewestInAll) break;
      const NoiseModel conditions = noise;
      found = make_bins(rest, samples.ranges);
      noise = fit_noise(found.bins);
      noise.pointing_rad = conditions.pointing_rad;
      noise.intensity_power = conditions.intensity_power;
      noise.intensity_reference = conditions.intensity_reference;
    }
  }
  const double step = step_between(samples.ranges, samples.ranges.front(), samples.ranges.back(), 0.1);
  noise.floor_m = std::max(step * kFromStep, middle * kFloatStep);
  noise.correlation = found.correlation;
  return {noise, std::move(found.bins)};
}

}  // namespace lapseam
