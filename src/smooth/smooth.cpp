#include "lapseam/smooth.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

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

// Samples that the passes left with more than this share of their sigma (beside pixels without a sample, at borders of
// the image, steps and creases, or far off themselves) are settled afterwards by what the smoothed samples on a line
// through them say, on both sides or on one. Before, one in a hundred of these stayed a spike of over two sigmas.
constexpr float kUnsettled = 0.3f;
constexpr int kSettlings = 2;
// What agrees with a sample here has been smoothed, and errs less than the sample: the gate may be wider than above.
constexpr float kSettledAgreement = 3.5f;
// Once moved, a sample may be off by half the variance that it had.
constexpr float kMovedVariance = 0.5f;
// Smoothed neighbours share measurements with each other.
constexpr float kSharing = 3.0f;

// Beside steps, where pairs are few, smoothing leaves more of sigma than its median; compared with 1 to 0.15 in
// docs/method.md.
constexpr double kLeftAtSteps = 0.2;

// Pairs whose rays are not symmetric about the centre ray (staggered grids) would shear slopes; in samples.
constexpr float kLargestAsymmetry_px = 0.05f;

// A slope is taken over so many samples, and is no steeper (87°).
constexpr int kSlopeReach_px = 2;
constexpr double kSteepest = 20;

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

using Corrections = std::array<float, 4>;
Corrections corrections_at(const Sensor& sensor, int distance) {
  Corrections out;
  for (std::size_t k = 0; k < 4; ++k)
    out[k] = pair_correction(sensor, kDirections[k][0] * distance, kDirections[k][1] * distance);
  return out;
}

void order(float& a, float& b) {
  const float low = std::min(a, b);
  b = std::max(a, b);
  a = low;
}

// Mean of the two in the middle (Batcher's odd-even network, without what only orders the others).
float median_of_8(std::array<float, 8>& x) {
  for (const auto [a, b] : {std::array{0, 1},
                            {2, 3},
                            {4, 5},
                            {6, 7},
                            {0, 2},
                            {1, 3},
                            {4, 6},
                            {5, 7},
                            {1, 2},
                            {5, 6},
                            {0, 4},
                            {1, 5},
                            {2, 6},
                            {3, 7},
                            {2, 4},
                            {3, 5},
                            {3, 4}})
    order(x[std::size_t(a)], x[std::size_t(b)]);
  return 0.5f * (x[3] + x[4]);
}

// A weighted mean under way. Weights are relative to the sample's own, which is 1: their unit may be anything.
struct Mean {
  float sum = 0, weights = 0, variances = 0;

  // What is off by more than `limit`, squared, does not count; less, by Tukey's biweight.
  void add(bool is_there, float value, float variance, float residual, float limit, float own_variance) {
    const float t = 1.0f - residual * residual / limit;
    const float w = is_there && t > 0 ? t * t * own_variance / variance : 0.0f;
    sum += w * value;
    weights += w;
    variances += w * w * variance;
  }
};

class Smoother {
 public:
  /// guide: the image once smoothed, which tells the incidence; null where the noise does not depend on it.
  Smoother(const View& view, const NoiseModel& noise, const RangeImage* guide)
      : grid_{view.range.width, view.range.height, wraps(view.sensor), std::get_if<MeasuredGridSensor>(&view.sensor)},
        is_central_(lapseam::is_central(view.sensor)),
        is_skewed_(is_central_ && noise.is_symmetric_in_range),
        sensor_(view.sensor),
        correlation_(float(noise.correlation)),
        value_(view.range.size()),
        variance_(view.range.size()) {
    const SpacingLine spacing = spacing_line(view.sensor);
    for (std::size_t i = 0; i < value_.size(); ++i) {
      const float r = view.range.pixels[i];
      if (!(r > 0)) continue;
      auto s = float(noise.sigma(double(r)));
      if (!view.intensity.pixels.empty()) s *= float(noise.intensity_factor(view.intensity.pixels[i]));
      if (guide) s = std::hypot(s, float(noise.pointing_rad) * slope_at(*guide, i, spacing));
      const float sigma = is_central_ ? s / (r * r) : s;
      value_[i] = is_central_ ? 1.0f / r : r;
      variance_[i] = std::max(sigma * sigma, std::numeric_limits<float>::min());
    }
    initial_variance_ = variance_;
  }

  // Tames outliers against the median of the neighbours.
  void tame_outliers(Context& context) {
    for_all(context, [&](int u, int v, Pixels<float>& value, Pixels<float>&) { tame_sample(u, v, value); });
  }

  // One pass at one tap distance.
  void pass(int distance, Context& context) {
    const Corrections correction = corrections_at(sensor_, distance);
    next_value_ = value_;
    next_variance_ = variance_;
    parallel_blocks(context, std::size_t(grid_.height), 16, [&](std::size_t begin, std::size_t end) {
      for (int v = int(begin); v != int(end); ++v) smooth_row(v, distance, correction);
    });
    value_.swap(next_value_);
    variance_.swap(next_variance_);
  }

  // What had too few pairs that agree.
  void settle(Context& context) {
    const std::array<Corrections, 2> corrections = {corrections_at(sensor_, 1), corrections_at(sensor_, 2)};
    for_all(context, [&](int u, int v, Pixels<float>& value, Pixels<float>& variance) {
      settle_sample(u, v, corrections, value, variance);
    });
  }

  // Gives up the buffers on the way: those of a large image are most of what the stage needs.
  SmoothResult take_result(const View& view) {
    SmoothResult out;
    out.range.width = view.range.width;
    out.range.height = view.range.height;
    Pixels<float> factors = std::move(next_variance_);
    factors.clear();
    for (std::size_t i = 0; i < value_.size(); ++i) {
      if (!(view.range.pixels[i] > 0)) {
        value_[i] = view.range.pixels[i];
        continue;
      }
      const float left = variance_[i] / initial_variance_[i];
      if (is_central_) {
        const float r = 1.0f / value_[i];
        // The mean of inverse ranges is over that of the surface by their relative variance; a single one is not.
        value_[i] = is_skewed_ ? r * (1.0f + initial_variance_[i] * r * r * (1.0f - left)) : r;
      }
      factors.push_back(left);
    }
    out.range.pixels = std::move(value_);
    if (!factors.empty()) {
      const auto middle = factors.begin() + std::ptrdiff_t(factors.size() / 2);
      std::nth_element(factors.begin(), middle, factors.end());
      out.remaining_sigma_factor = std::sqrt(double(*middle));
    }
    return out;
  }

 private:
  // Range · tan(incidence), by how far the distance changes from sample to sample; in each direction on that side where
  // it changes less, so that a step is no slope.
  float slope_at(const RangeImage& guide, std::size_t i, const SpacingLine& spacing) const {
    const int u = int(i % std::size_t(grid_.width)), v = int(i / std::size_t(grid_.width));
    const double here = distance_at(guide, i);
    double squares = 0;
    for (const auto& [du, dv] : {std::pair{kSlopeReach_px, 0}, {0, kSlopeReach_px}}) {
      double least = std::numeric_limits<double>::infinity();
      for (const int sign : {1, -1})
        if (const std::size_t k = neighbor(u + sign * du, v + sign * dv); k != kNone && guide.pixels[k] > 0)
          least = std::min(least, std::abs(distance_at(guide, k) - here) / kSlopeReach_px);
      if (std::isfinite(least)) squares += least * least;
    }
    const auto r = double(guide.pixels[i]);
    return float(r * std::min(std::sqrt(squares) / spacing.at(r), kSteepest));
  }
  double distance_at(const RangeImage& guide, std::size_t i) const {
    const auto r = double(guide.pixels[i]);
    if (!is_central_) return r;
    return unproject(sensor_, double(i % std::size_t(grid_.width)), double(i / std::size_t(grid_.width)), r).norm();
  }

  // f(u, v, value, variance) for each pixel, from value_ and variance_ into fresh buffers.
  template <typename F>
  void for_all(Context& context, const F& f) {
    next_value_ = value_;
    next_variance_ = variance_;
    parallel_blocks(context, std::size_t(grid_.height), 16, [&](std::size_t begin, std::size_t end) {
      for (int v = int(begin); v != int(end); ++v)
        for (int u = 0; u < grid_.width; ++u) f(u, v, next_value_, next_variance_);
    });
    value_.swap(next_value_);
    variance_.swap(next_variance_);
  }

  void tame_sample(int u, int v, Pixels<float>& value) const {
    const std::size_t centre = index(u, v);
    if (!is_sample(centre)) return;
    std::array<float, 8> around;
    std::size_t n = 0;
    for (const auto& d : kDirections) {  // in pairs, so that a slanted plane's median is its centre
      const std::size_t a = neighbor(u + d[0], v + d[1]), b = neighbor(u - d[0], v - d[1]);
      if (!is_pair(a, b, centre)) continue;
      around[n++] = value_[a];
      around[n++] = value_[b];
    }
    if (n < kFewestNeighbors) return;
    if (n < around.size()) std::sort(around.begin(), around.begin() + std::ptrdiff_t(n));
    const float median = n == around.size() ? median_of_8(around) : 0.5f * (around[(n - 1) / 2] + around[n / 2]);
    const float deviation = value_[centre] - median, s = std::sqrt(variance_[centre]);
    if (std::abs(deviation) < kSpeck * s) value[centre] = median + std::clamp(deviation, -kTamed * s, kTamed * s);
  }

  // Most of an image is far from its borders, where neighbours need no looking for.
  void smooth_row(int v, int distance, const Corrections& correction) {
    const bool is_inner_row = !grid_.measured && v >= distance && v < grid_.height - distance;
    const int begin = is_inner_row ? std::min(distance, grid_.width) : grid_.width;
    const int end = std::max(begin, grid_.width - distance);
    for (int u = 0; u < begin; ++u) smooth_sample(u, v, distance, correction);
    if (begin < end) smooth_inner(index(begin, v), index(end - 1, v) + 1, distance, correction);
    for (int u = end; u < grid_.width; ++u) smooth_sample(u, v, distance, correction);
  }

  void smooth_inner(std::size_t begin, std::size_t end, int distance, const Corrections& correction) {
    const float* const value = value_.data();
    const float* const variance = variance_.data();
    float* const next_value = next_value_.data();
    float* const next_variance = next_variance_.data();
    std::array<std::ptrdiff_t, 4> offset;
    for (std::size_t k = 0; k < 4; ++k)
      offset[k] = std::ptrdiff_t(kDirections[k][1] * distance) * grid_.width + kDirections[k][0] * distance;
    const float correlation = correlation_at(distance);
    for (auto i = std::ptrdiff_t(begin); i < std::ptrdiff_t(end); ++i) {
      Mean mean;
      for (std::size_t k = 0; k < 4; ++k) {
        const std::ptrdiff_t a = i + offset[k], b = i - offset[k];
        add_pair(mean, variance[a] > 0 && variance[b] > 0, value[i], variance[i],
                 0.5f * (value[a] + value[b]) * correction[k], 0.25f * (variance[a] + variance[b]));
      }
      next_value[i] = (value[i] + mean.sum) / (1.0f + mean.weights);
      next_variance[i] = variance_left(mean, variance[i], correlation);
    }
  }

  void smooth_sample(int u, int v, int distance, const Corrections& correction) {
    const std::size_t centre = index(u, v);
    if (!is_sample(centre)) return;
    Mean mean;
    for (std::size_t k = 0; k < 4; ++k) {
      const int du = kDirections[k][0] * distance, dv = kDirections[k][1] * distance;
      const std::size_t a = neighbor(u + du, v + dv), b = neighbor(u - du, v - dv);
      if (!is_pair(a, b, centre)) continue;
      add_pair(mean, true, value_[centre], variance_[centre], 0.5f * (value_[a] + value_[b]) * correction[k],
               0.25f * (variance_[a] + variance_[b]));
    }
    next_value_[centre] = (value_[centre] + mean.sum) / (1.0f + mean.weights);
    next_variance_[centre] = variance_left(mean, variance_[centre], correlation_at(distance));
  }

  static void add_pair(Mean& mean, bool is_there, float own, float own_variance, float pair, float pair_variance) {
    mean.add(is_there, pair, pair_variance, pair - own, kAgreement * kAgreement * (pair_variance + own_variance),
             own_variance);
  }

  float correlation_at(int distance) const { return correlation_ * (distance > 1 ? kCorrelation : 1.0f); }
  static float variance_left(const Mean& mean, float own_variance, float correlation) {
    const float total = 1.0f + mean.weights;
    return std::min(own_variance, correlation * (own_variance + mean.variances) / (total * total));
  }

  // What the samples on a line through a pixel say about it.
  struct Guess {
    float value, variance;
  };
  struct Guesses {
    std::array<Guess, 16> items;
    std::size_t count = 0;
    void add(float value, float variance) { items[count++] = {value, variance}; }
  };

  Guesses guess_sample(int u, int v, const std::array<Corrections, 2>& correction) const {
    const std::size_t centre = index(u, v);
    Guesses out;
    for (std::size_t k = 0; k < 4; ++k) {
      const int du = kDirections[k][0], dv = kDirections[k][1];
      const std::array<std::size_t, 2> near = {neighbor(u + du, v + dv), neighbor(u - du, v - dv)};
      const std::array<std::size_t, 2> far = {neighbor(u + 2 * du, v + 2 * dv), neighbor(u - 2 * du, v - 2 * dv)};
      for (std::size_t d = 0; d < 2; ++d) {
        const auto [a, b] = d == 0 ? near : far;
        if (is_pair(a, b, centre))
          out.add(0.5f * (value_[a] + value_[b]) * correction[d][k], 0.25f * (variance_[a] + variance_[b]));
      }
      for (std::size_t side = 0; side < 2; ++side) {  // the line beyond its nearer sample
        const std::size_t a = near[side], b = far[side];
        if (a == kNone || b == kNone || !is_sample(a) || !is_sample(b) || !is_symmetric(grid_, centre, b, a)) continue;
        out.add(2.0f * value_[a] / correction[0][k] - value_[b], 4.0f * variance_[a] + variance_[b]);
      }
    }
    return out;
  }

  void settle_sample(int u, int v, const std::array<Corrections, 2>& correction, Pixels<float>& value,
                     Pixels<float>& variance) const {
    const std::size_t centre = index(u, v);
    const float own = value_[centre], own_variance = variance_[centre];
    if (!(own_variance > kUnsettled * kUnsettled * initial_variance_[centre])) return;
    const Guesses guesses = guess_sample(u, v, correction);
    float at = own;
    for (const float slack : {1.0f, kMovedVariance}) {
      Mean mean;
      for (std::size_t i = 0; i < guesses.count; ++i) {
        const Guess& guess = guesses.items[i];
        const float limit = kSettledAgreement * kSettledAgreement * (guess.variance + slack * own_variance);
        mean.add(true, guess.value, kSharing * guess.variance, guess.value - at, limit, own_variance);
      }
      at = (own + mean.sum) / (1.0f + mean.weights);
      variance[centre] = own_variance / (1.0f + mean.weights);
    }
    value[centre] = at;
  }

  static constexpr std::size_t kNone = ~std::size_t(0);
  std::size_t index(int u, int v) const { return std::size_t(v) * std::size_t(grid_.width) + std::size_t(u); }
  std::size_t neighbor(int u, int v) const {
    if (v < 0 || v >= grid_.height) return kNone;
    if (u < 0 || u >= grid_.width) {
      if (!grid_.wraps) return kNone;
      u = (u + grid_.width) % grid_.width;
    }
    return index(u, v);
  }
  bool is_sample(std::size_t i) const { return variance_[i] > 0; }
  bool is_pair(std::size_t a, std::size_t b, std::size_t centre) const {
    return a != kNone && b != kNone && is_sample(a) && is_sample(b) && is_symmetric(grid_, a, b, centre);
  }

  Grid grid_;
  bool is_central_;
  bool is_skewed_;
  const Sensor& sensor_;
  float correlation_;
  // In the quantity that is affine on a plane; variance 0: no sample.
  Pixels<float> value_, variance_, initial_variance_;
  Pixels<float> next_value_, next_variance_;
};

SmoothResult run(const View& view, const NoiseModel& noise, const RangeImage* guide, const SmoothOptions& options,
                 Context& context) {
  Smoother smoother(view, noise, guide);
  if (options.reach_px > 0) smoother.tame_outliers(context);
  for (int distance = 1; distance <= options.reach_px; distance *= 2) smoother.pass(distance, context);
  for (int i = 0; i < kSettlings && options.reach_px > 0; ++i) smoother.settle(context);
  return smoother.take_result(view);
}

}  // namespace

SmoothResult smooth(const View& view, const NoiseModel& noise, const SmoothOptions& options, Context& context) {
  SmoothResult result = run(view, noise, nullptr, options, context);
  // The measured slopes are too noisy to tell what noise they have; those of the smoothed image are not.
  if (noise.pointing_rad > 0) result = run(view, noise, &result.range, options, context);
  return result;
}

NoiseModel noise_at_steps(const NoiseModel& noise, double remaining_sigma_factor) {
  return noise.scaled(std::max(kLeftAtSteps, remaining_sigma_factor));
}

}  // namespace lapseam
