#include "noise/noise_symmetry.h"

#include <array>
#include <cmath>
#include <vector>

#include "core/parallel.h"

namespace lapseam {
namespace {

// Each value less what its neighbours at one and at two samples say of it, so that what is of second degree vanishes:
// sums of the squared and of the cubed weights.
constexpr double kNear = 4.0 / 3 / 4, kFar = -1.0 / 3 / 4;
constexpr double kVariance = 1 + 4 * (kNear * kNear + kFar * kFar);
constexpr double kSkew = 1 - 4 * (kNear * kNear * kNear + kFar * kFar * kFar);
// The skew is judged by the mean of (t³ − 3/2 t) exp(−t²/2): of a normal variable it is zero, and does not change when
// that is off a little, as on curved surfaces; what is far off, at steps and creases, does not count. What a skew of 1
// makes of it, and its variance.
constexpr double kResponse = 0.0883883, kScoreVariance = 0.176412;
// The answer has to be this many standard deviations from the middle between both.
constexpr double kCertainty = 2;

// Least squares for the share of the skew that noise symmetric in the range would have.
struct Sums {
  double information = 0, weighted = 0;
};

class Skew {
 public:
  Skew(const View& view, const NoiseModel& noise) : range_(view.range), noise_(noise) {}

  Sums run() const {
    Sums out;
    for (int v = 2; v < range_.height - 2; ++v)
      for (int u = 2; u < range_.width - 2; ++u) add(range_.index(u, v), out);
    return out;
  }

 private:
  void add(std::size_t i, Sums& out) const {
    const auto row = std::size_t(range_.width);
    const std::array<std::size_t, 4> near = {i - 1, i + 1, i - row, i + row};
    const std::array<std::size_t, 4> far = {i - 2, i + 2, i - 2 * row, i + 2 * row};
    if (!(range_.pixels[i] > 0)) return;
    const double value = 1 / double(range_.pixels[i]);
    double others = 0;
    for (std::size_t k = 0; k < 4; ++k) {
      const double a = double(range_.pixels[near[k]]), b = double(range_.pixels[far[k]]);
      if (!(a > 0) || !(b > 0)) return;
      others += kNear / a + kFar / b;
    }
    // The mean of both by their variances: its error is independent of their difference, so that what the noise is
    // expected to be does not go with what it is.
    const double r = kVariance / ((kVariance - 1) * value + others);
    if (!(r > 0)) return;
    const double relative = noise_.sigma(r) / r;
    const double t = (value - others) * r / (relative * std::sqrt(kVariance));
    const double score = t * (t * t - 1.5) * std::exp(-0.5 * t * t);
    const double expected = kResponse * 6 * relative * kSkew / std::pow(kVariance, 1.5);
    out.information += expected * expected / kScoreVariance;
    out.weighted += expected * score / kScoreVariance;
  }

  const RangeImage& range_;
  const NoiseModel& noise_;
};

}  // namespace

bool is_symmetric_in_range(std::span<const View* const> views, std::span<const NoiseModel* const> noise,
                           Context& context) {
  std::vector<Sums> of_view(views.size());
  parallel_for(context, views.size(), 1, [&](std::size_t i) {
    if (is_central(views[i]->sensor)) of_view[i] = Skew(*views[i], *noise[i]).run();
  });
  Sums all;
  for (const Sums& sums : of_view) {
    all.information += sums.information;
    all.weighted += sums.weighted;
  }
  return all.weighted - 0.5 * all.information > kCertainty * std::sqrt(all.information);
}

}  // namespace lapseam
