#include "noise/conditions.h"

#include <algorithm>
#include <cmath>

#include "noise/robust_sigma.h"

namespace lapseam {
namespace {

constexpr std::size_t kConditionBins = 12, kFewestPerCondition = 200, kFewestConditions = 4;
// The relative error of a bin's standard deviation, as in fit_noise.
constexpr double kSigmaChance = 1.8, kSigmaShape = 0.03;
// What a condition must explain, in squared standard errors.
constexpr double kConditionCost = 9;
constexpr double kLargestPower = 2;

// A sample under a condition (how slanted, how bright), and how large its residual is against what is expected.
struct Conditioned {
  float condition, size;
};
struct ConditionBin {
  double condition, sigma, relative_error;
};

// Bins of about as many samples each, by `mean` of the condition. Those of one condition are never parted.
template <typename Mean>
std::vector<ConditionBin> make_condition_bins(std::vector<Conditioned>& samples, const Mean& mean) {
  std::sort(samples.begin(), samples.end(), [](const Conditioned& a, const Conditioned& b) {
    return a.condition != b.condition ? a.condition < b.condition : a.size < b.size;
  });
  std::vector<ConditionBin> bins;
  const std::size_t n = samples.size(), fewest = std::max(n / kConditionBins, kFewestPerCondition);
  for (std::size_t begin = 0; begin + fewest <= n;) {
    std::size_t end = begin + fewest;
    while (end < n && samples[end].condition == samples[end - 1].condition) ++end;
    std::vector<float> sizes;
    double sum = 0;
    for (std::size_t i = begin; i < end; ++i) {
      sizes.push_back(samples[i].size);
      sum += mean(double(samples[i].condition)) / double(end - begin);
    }
    const double sigma = robust_sigma(sizes);
    if (sigma > 0) bins.push_back({sum, sigma, std::hypot(kSigmaChance / std::sqrt(double(end - begin)), kSigmaShape)});
    begin = end;
  }
  return bins;
}

struct Line {
  double level = 0, slope = 0;
  double explained = 0;  ///< by the slope, in squared standard errors
};

// Weighted least squares.
class LineFit {
 public:
  void add(double x, double y, double error) {
    const double weight = 1 / (error * error);
    w_ += weight, x_ += weight * x, y_ += weight * y, xx_ += weight * x * x, xy_ += weight * x * y;
  }
  Line solve() const {
    const double spread = xx_ - x_ * x_ / w_, covariance = xy_ - x_ * y_ / w_;
    if (!(spread > 0)) return {};
    const double slope = covariance / spread;
    return {(y_ - slope * x_) / w_, slope, slope * covariance};
  }

 private:
  double w_ = 0, x_ = 0, y_ = 0, xx_ = 0, xy_ = 0;
};

double sigma_at_intensity(const NoiseModel& noise, const Roughness& r) {
  return noise.sigma(double(r.range)) * (r.intensity > 0 ? noise.intensity_factor(r.intensity) : 1);
}

// What of a sample's standard deviation is left where the surface faces the sensor.
double facing_share(const NoiseModel& noise, const Roughness& r) {
  const double facing = sigma_at_intensity(noise, r), slanted = noise.pointing_rad * std::max(0.0, double(r.slope_m));
  return facing / std::hypot(facing, slanted);
}

}  // namespace

double fit_pointing(std::span<const Roughness> samples, const NoiseModel& noise) {
  std::vector<Conditioned> relative;
  for (const Roughness& r : samples) {
    if (r.slope_m < 0) continue;
    const auto sigma = float(sigma_at_intensity(noise, r));
    relative.push_back({r.slope_m / sigma, std::abs(r.residual_m) / sigma});
  }
  const auto bins = make_condition_bins(relative, [](double slope) { return slope * slope; });
  if (bins.size() < kFewestConditions) return 0;
  // variance = level + pointing² · slope²: the level is what the model of ranges is off by.
  LineFit fit;
  for (const ConditionBin& bin : bins) {
    const double variance = bin.sigma * bin.sigma;
    fit.add(bin.condition, variance, 2 * bin.relative_error * variance);
  }
  const Line line = fit.solve();
  return line.slope > 0 && line.level > 0 && line.explained > kConditionCost ? std::sqrt(line.slope) : 0;
}

void fit_intensity(std::span<const Roughness> samples, NoiseModel& noise) {
  noise.intensity_power = 0;
  std::vector<Conditioned> relative;
  double logs = 0;
  for (const Roughness& r : samples) {
    if (r.intensity == 0 || (noise.pointing_rad > 0 && r.slope_m < 0)) continue;
    const double facing = std::abs(double(r.residual_m)) * facing_share(noise, r) / noise.sigma(double(r.range));
    relative.push_back({float(r.intensity), float(facing)});
    logs += std::log(double(r.intensity));
  }
  const auto bins = make_condition_bins(relative, [](double intensity) { return std::log(intensity); });
  if (bins.size() < kFewestConditions) return;
  LineFit fit;
  for (const ConditionBin& bin : bins) fit.add(bin.condition, std::log(bin.sigma), bin.relative_error);
  const Line line = fit.solve();
  if (!(line.slope < 0 && line.explained > kConditionCost)) return;
  noise.intensity_power = std::min(-line.slope, kLargestPower);
  noise.intensity_reference = std::exp(logs / double(relative.size()));
}

std::vector<Roughness> without_conditions(std::span<const Roughness> samples, const NoiseModel& noise) {
  std::vector<Roughness> out;
  for (Roughness r : samples) {
    if (noise.pointing_rad > 0 && r.slope_m < 0) continue;
    if (noise.intensity_power > 0 && r.intensity == 0) continue;
    const double factor = r.intensity > 0 ? noise.intensity_factor(r.intensity) : 1;
    r.residual_m *= float(facing_share(noise, r) / factor);
    out.push_back(r);
  }
  return out;
}

}  // namespace lapseam
