#include "lapseam/smooth.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "core/parallel.h"

namespace lapseam {
namespace {

// Half of the directions; each stands for a pair of opposite taps.
constexpr std::array<std::array<int, 2>, 4> kDirections = {{{1, 0}, {0, 1}, {1, 1}, {1, -1}}};

// A pair's mean may differ from the centre by this many standard deviations of that difference.
constexpr float kAgreement = 2.5f;

// Before the passes: a sample is brought to within kTamed sigmas of the median of its eight neighbours, if it is not
// farther than kSpeck from it (then it is not noise but a thin thing, or a speck for the next stage to judge). Without
// this, one sample in eighty would disagree with every pair around it and stay a spike on a smooth surface.
constexpr float kTamed = 1.5f;
constexpr float kSpeck = 5.0f;
constexpr std::size_t kFewestNeighbors = 6;

// After the first pass samples share measurements: the variance of a mean is this many times what it would be if they
// did not (1D kernels [1 1 1] ∗ [1 0 1 0 1] ∗ …, squared: between 2.1 and 2.4 per pass).
constexpr float kCorrelation = 2.25f;

// Pairs whose rays are not symmetric about the centre ray (staggered grids) would shear slopes; in samples.
constexpr float kLargestAsymmetry_px = 0.05f;

struct Grid {
  int width, height;
  bool wraps;
  const MeasuredGridSensor* measured;  // null for regular sensors
};

bool is_symmetric(const Grid& grid, std::size_t a, std::size_t b, std::size_t centre) {
  if (!grid.measured) return true;
  const auto& warp = grid.measured->warp;
  return (warp[a] + warp[b] - 2.0f * warp[centre]).cwiseAbs().maxCoeff() < kLargestAsymmetry_px;
}

// The mean of two samples at angles ±a on a circle around a scanner lies at cos(a) of the plane's inverse range.
float pair_correction(const Sensor& sensor, int du, int dv) {
  const auto* spherical = std::get_if<SphericalSensor>(&sensor);
  if (!spherical) return 1.0f;
  const auto step = [](const std::vector<double>& table) {
    return table.size() > 1 ? std::abs(table.back() - table.front()) / double(table.size() - 1) : 0.0;
  };
  const double a = du * step(spherical->azimuth_rad), b = dv * step(spherical->elevation_rad);
  return float(1.0 / std::cos(std::hypot(a, b)));
}

class Smoother {
 public:
  Smoother(const View& view, const NoiseModel& noise)
      : grid_{view.range.width, view.range.height, wraps(view.sensor), std::get_if<MeasuredGridSensor>(&view.sensor)},
        is_central_(!grid_.measured && !std::holds_alternative<OrthographicSensor>(view.sensor)),
        sensor_(view.sensor),
        value_(view.range.size()),
        sigma_(view.range.size()) {
    for (std::size_t i = 0; i < value_.size(); ++i) {
      const float r = view.range.pixels[i];
      if (!(r > 0)) continue;
      const auto s = float(noise.sigma(double(r)));
      value_[i] = is_central_ ? 1.0f / r : r;
      sigma_[i] = is_central_ ? s / (r * r) : s;
    }
    initial_sigma_ = sigma_;
  }

  // Tames outliers against the median of the neighbours.
  void tame_outliers(Context& context) {
    std::vector<float> value = value_;
    parallel_blocks(context, std::size_t(grid_.height), 16, [&](std::size_t begin, std::size_t end) {
      for (std::size_t v = begin; v != end; ++v)
        for (int u = 0; u < grid_.width; ++u) tame_sample(u, int(v), value);
    });
    value_.swap(value);
  }

  // One pass at one tap distance, from value_/sigma_ into fresh buffers.
  void pass(int distance, Context& context) {
    std::vector<float> value = value_, sigma = sigma_;
    std::array<float, 4> correction;
    for (std::size_t k = 0; k < 4; ++k)
      correction[k] = pair_correction(sensor_, kDirections[k][0] * distance, kDirections[k][1] * distance);
    parallel_blocks(context, std::size_t(grid_.height), 16, [&](std::size_t begin, std::size_t end) {
      for (std::size_t v = begin; v != end; ++v)
        for (int u = 0; u < grid_.width; ++u) smooth_sample(u, int(v), distance, correction, value, sigma);
    });
    value_.swap(value);
    sigma_.swap(sigma);
  }

  SmoothResult result(const View& view) const {
    SmoothResult out;
    out.range = view.range;
    std::vector<float> factors;
    for (std::size_t i = 0; i < value_.size(); ++i) {
      if (!(view.range.pixels[i] > 0)) continue;
      out.range.pixels[i] = is_central_ ? 1.0f / value_[i] : value_[i];
      factors.push_back(sigma_[i] / initial_sigma_[i]);
    }
    if (!factors.empty()) {
      const auto middle = factors.begin() + std::ptrdiff_t(factors.size() / 2);
      std::nth_element(factors.begin(), middle, factors.end());
      out.remaining_sigma_factor = double(*middle);
    }
    return out;
  }

 private:
  void tame_sample(int u, int v, std::vector<float>& value) const {
    const std::size_t centre = std::size_t(v) * std::size_t(grid_.width) + std::size_t(u);
    const float s = sigma_[centre];
    if (!(s > 0)) return;
    std::array<float, 8> around;
    std::size_t n = 0;
    for (std::size_t k = 0; k < 4; ++k) {  // in pairs, so that a slanted plane's median is its centre
      const std::size_t a = neighbor(u + kDirections[k][0], v + kDirections[k][1]);
      const std::size_t b = neighbor(u - kDirections[k][0], v - kDirections[k][1]);
      if (a == kNone || b == kNone || !(sigma_[a] > 0) || !(sigma_[b] > 0) || !is_symmetric(grid_, a, b, centre))
        continue;
      around[n++] = value_[a];
      around[n++] = value_[b];
    }
    if (n < kFewestNeighbors) return;
    std::sort(around.begin(), around.begin() + std::ptrdiff_t(n));
    const float median = 0.5f * (around[(n - 1) / 2] + around[n / 2]);
    const float deviation = value_[centre] - median;
    if (std::abs(deviation) < kSpeck * s) value[centre] = median + std::clamp(deviation, -kTamed * s, kTamed * s);
  }

  void smooth_sample(int u, int v, int distance, const std::array<float, 4>& correction, std::vector<float>& value,
                     std::vector<float>& sigma) const {
    const std::size_t centre = std::size_t(v) * std::size_t(grid_.width) + std::size_t(u);
    const float x = value_[centre], s = sigma_[centre];
    if (!(s > 0)) return;
    float sum = 0, weight_sum = 0, variance_sum = 0;
    for (std::size_t k = 0; k < 4; ++k) {
      const std::size_t a = neighbor(u + kDirections[k][0] * distance, v + kDirections[k][1] * distance);
      const std::size_t b = neighbor(u - kDirections[k][0] * distance, v - kDirections[k][1] * distance);
      if (a == kNone || b == kNone || !(sigma_[a] > 0) || !(sigma_[b] > 0)) continue;
      if (!is_symmetric(grid_, a, b, centre)) continue;
      const float mean = 0.5f * (value_[a] + value_[b]) * correction[k];
      const float mean_variance = 0.25f * (sigma_[a] * sigma_[a] + sigma_[b] * sigma_[b]);
      const float residual = mean - x;
      const float limit = kAgreement * kAgreement * (mean_variance + s * s);
      if (residual * residual > limit) continue;
      const float t = 1.0f - residual * residual / limit;  // Tukey's biweight
      const float w = t * t / mean_variance;
      sum += w * mean;
      weight_sum += w;
      variance_sum += w * w * mean_variance;
    }
    const float own = 1.0f / (s * s);
    const float total = weight_sum + own;
    value[centre] = (sum + own * x) / total;
    const float correlation = distance > 1 ? kCorrelation : 1.0f;
    sigma[centre] = std::min(s, std::sqrt(correlation * (variance_sum + own) / (total * total)));
  }

  static constexpr std::size_t kNone = ~std::size_t(0);
  std::size_t neighbor(int u, int v) const {
    if (v < 0 || v >= grid_.height) return kNone;
    if (u < 0 || u >= grid_.width) {
      if (!grid_.wraps) return kNone;
      u = (u + grid_.width) % grid_.width;
    }
    return std::size_t(v) * std::size_t(grid_.width) + std::size_t(u);
  }

  Grid grid_;
  bool is_central_;
  const Sensor& sensor_;
  std::vector<float> value_, sigma_, initial_sigma_;
};

}  // namespace

SmoothResult smooth(const View& view, const NoiseModel& noise, const SmoothOptions& options, Context& context) {
  Smoother smoother(view, noise);
  if (options.reach_px > 0) smoother.tame_outliers(context);
  for (int distance = 1; distance <= options.reach_px; distance *= 2) smoother.pass(distance, context);
  return smoother.result(view);
}

}  // namespace lapseam
