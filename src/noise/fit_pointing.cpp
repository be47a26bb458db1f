#include "noise/fit_pointing.h"

#include <algorithm>
#include <cmath>

#include "noise/robust_sigma.h"

namespace lapseam {
namespace {

constexpr std::size_t kSlopeBins = 12, kFewestPerSlope = 200, kFewestSlopes = 4;
// The relative error of a bin's variance: twice that of its standard deviation, as in fit_noise.
constexpr double kVarianceChance = 3.6, kVarianceShape = 0.06;
// What incidence must explain, in squared standard errors.
constexpr double kIncidenceCost = 9;

// Samples of about one slope, relative to their noise.
struct SlopeBin {
  double squared_slope, variance, weight;
};

std::vector<SlopeBin> make_slope_bins(std::span<const Roughness> samples, const NoiseModel& noise) {
  struct Relative {
    float slope, size;
  };
  std::vector<Relative> relative;
  for (const Roughness& r : samples) {
    if (r.slope_m < 0) continue;
    const auto sigma = float(noise.sigma(double(r.range)));
    relative.push_back({r.slope_m / sigma, std::abs(r.residual_m) / sigma});
  }
  std::sort(relative.begin(), relative.end(), [](const Relative& a, const Relative& b) {
    return a.slope != b.slope ? a.slope < b.slope : a.size < b.size;
  });
  std::vector<SlopeBin> bins;
  const std::size_t n = relative.size(), size = std::max(n / kSlopeBins, kFewestPerSlope);
  for (std::size_t begin = 0; begin + size <= n; begin += size) {
    std::vector<float> sizes;
    double squares = 0;
    for (std::size_t i = begin; i < begin + size; ++i) {
      sizes.push_back(relative[i].size);
      squares += double(relative[i].slope) * double(relative[i].slope) / double(size);
    }
    const double sigma = robust_sigma(sizes), variance = sigma * sigma;
    const double error = variance * std::hypot(kVarianceChance / std::sqrt(double(size)), kVarianceShape);
    if (error > 0) bins.push_back({squares, variance, 1 / (error * error)});
  }
  return bins;
}

}  // namespace

double fit_pointing(std::span<const Roughness> samples, const NoiseModel& noise) {
  const std::vector<SlopeBin> bins = make_slope_bins(samples, noise);
  if (bins.size() < kFewestSlopes) return 0;
  // variance = level + pointing² · slope²: the level is what the model of ranges is off by.
  double w = 0, x = 0, y = 0, xx = 0, xy = 0;
  for (const SlopeBin& bin : bins) {
    w += bin.weight;
    x += bin.weight * bin.squared_slope;
    y += bin.weight * bin.variance;
    xx += bin.weight * bin.squared_slope * bin.squared_slope;
    xy += bin.weight * bin.squared_slope * bin.variance;
  }
  const double spread = xx - x * x / w, covariance = xy - x * y / w;
  if (!(spread > 0 && covariance > 0)) return 0;
  const double squared_pointing = covariance / spread, level = (y - squared_pointing * x) / w;
  if (!(covariance * squared_pointing > kIncidenceCost && level > 0)) return 0;
  return std::sqrt(squared_pointing);
}

float facing_share(const NoiseModel& noise, const Roughness& sample) {
  const double facing = noise.sigma(double(sample.range)), slanted = noise.pointing_rad * double(sample.slope_m);
  return float(facing / std::hypot(facing, slanted));
}

}  // namespace lapseam
