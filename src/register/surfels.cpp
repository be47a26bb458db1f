#include "register/surfels.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>

namespace lapseam {
namespace {

// Levels go on while the next may be expected to have as many usable surfels as this.
constexpr std::size_t kCoarsest = 1000;
// Between samples of one surface: tan 76°, and four standard deviations of the noise.
constexpr float kSteepest = 4, kNoiseFactor = 4;
// Neighbouring steps of one smooth surface may differ by this many spacings beyond the noise; past that it is a crease.
// The first is of five values in three rows, the second of three values: it holds where thin or curved surfaces have no
// such rows, unless noise would let more than a whole spacing pass.
constexpr float kBend = 0.0625f, kBendOfThree = 0.25f, kMostBend = 1;
// Creases and small steps that are not told from noise make surfels that are off, always to the same side; what is
// taken for one without being it costs little, since rows beside it serve as well.
constexpr float kBendNoise = 2.5f;
// Surfaces more oblique than 75° have normals that a little noise turns.
constexpr float kLeastCosine = 0.26f;
// Normals less certain than 6° tell more of the noise than of the surface.
constexpr float kMostTilt_rad = 0.1f;
// Where a surfel is looked up, the place is off by a third of a spacing each way, root mean square.
constexpr float kLookupOffset = 0.3f;

// A range image at one level, in the quantity that planes make affine.
struct Level {
  int factor = 1;
  Image<float> value;  // 0: none
  Image<float> sigma;  // of the value
};

class Maker {
 public:
  Maker(const View& view, const NoiseModel& noise)
      : view_(view), is_central_(is_central(view.sensor)), spacing_(spacing_line(view.sensor)) {
    level_.value = RangeImage(view.range.width, view.range.height);
    level_.sigma = RangeImage(view.range.width, view.range.height);
    for (std::size_t i = 0; i < view.range.size(); ++i) {
      const float r = view.range.pixels[i];
      if (!(r > 0)) continue;
      const auto sigma = float(noise.sigma(double(r)));
      // The mean of 1 / r is over that of the surface by the noise's relative variance, if the noise is symmetric in r.
      const float excess = noise.is_symmetric_in_range ? sigma * sigma / (r * r) : 0;
      level_.value.pixels[i] = is_central_ ? std::max(0.0f, 1 - excess) / r : r;
      level_.sigma.pixels[i] = is_central_ ? sigma / (r * r) : sigma;
      ++valid_;
    }
  }

  SurfelPyramid run(std::size_t most_surfels, const BrightnessAt& brightness) {
    SurfelPyramid out;
    while (valid_ > most_surfels && can_halve()) halve();
    for (;;) {
      out.levels.push_back(surfels_of_level());
      if (brightness) add_brightness(brightness, out.levels.back());
      if (out.levels.back().usable.size() < 4 * kCoarsest || !can_halve()) break;
      halve();
    }
    describe(out);
    return out;
  }

 private:
  bool can_halve() const { return level_.value.width >= 16 && level_.value.height >= 16; }
  float range_of(float value) const { return is_central_ ? 1 / value : value; }
  // Change of the value per metre of range.
  float slope_at(float value) const { return is_central_ ? value * value : 1.0f; }
  float spacing_at(float value) const { return float(level_.factor) * float(spacing_.at(double(range_of(value)))); }
  // Largest difference of two values of one surface, `steps` surfels apart.
  float limit_at(float value, float sigma, float steps) const {
    return kSteepest * steps * spacing_at(value) * slope_at(value) + kNoiseFactor * sigma;
  }

  void halve() {
    Level next;
    next.factor = 2 * level_.factor;
    next.value = RangeImage(level_.value.width / 2, level_.value.height / 2);
    next.sigma = RangeImage(next.value.width, next.value.height);
    valid_ = 0;
    for (int v = 0; v < next.value.height; ++v)
      for (int u = 0; u < next.value.width; ++u) valid_ += join_block(u, v, next.value.at(u, v), next.sigma.at(u, v));
    level_ = std::move(next);
  }

  // The mean of 2 × 2 values; a single missing one follows from the other three.
  bool join_block(int u, int v, float& value, float& sigma) const {
    std::array<float, 4> x, s;
    int missing = -1, count = 0;
    for (int k = 0; k < 4; ++k) {
      x[std::size_t(k)] = level_.value.at(2 * u + k % 2, 2 * v + k / 2);
      s[std::size_t(k)] = level_.sigma.at(2 * u + k % 2, 2 * v + k / 2);
      x[std::size_t(k)] > 0 ? ++count : missing = k;
    }
    if (count < 3) return false;
    if (missing >= 0) {  // opposite corners of a parallelogram: 0–3 and 1–2
      const std::size_t m = std::size_t(missing), o = 3 - m, p = m == 0 || m == 3 ? 1 : 0, q = 3 - p;
      x[m] = x[p] + x[q] - x[o];
      s[m] = s[o];
      if (!(x[m] > 0)) return false;
    }
    const auto [low, high] = std::minmax_element(x.begin(), x.end());
    const float mean = 0.25f * (x[0] + x[1] + x[2] + x[3]), noise = 0.25f * (s[0] + s[1] + s[2] + s[3]);
    if (*high - *low > limit_at(mean, noise, 1.42f)) return false;
    value = mean;
    sigma = noise * (missing < 0 ? 0.5f : 0.7071f);
    return true;
  }

  int wrapped(int u) const { return wraps_ ? (u + level_.value.width) % level_.value.width : u; }

  float value_at(int u, int v) const {
    u = wrapped(u);
    if (u < 0 || u >= level_.value.width || v < 0 || v >= level_.value.height) return 0;
    return level_.value.at(u, v);
  }

  struct Gradient {
    float slope = 0;     // change of value per surfel
    float variance = 0;  // in units of the value's variance
  };

  // Five values in three rows along (du, dv).
  struct Run {
    static constexpr float kNone = std::numeric_limits<float>::max();
    float slope = 0;     // of the rows' mean, per surfel
    float bend = kNone;  // what it is off a straight line by, over what a smooth surface and its noise may be
    bool exists() const { return bend < kNone; }
    bool is_smooth() const { return bend <= 1; }
  };

  Run run_at(int u, int v, int du, int dv) const {
    Run out;
    const float x = value_at(u, v);
    if (!(x > 0)) return out;
    const float sigma = level_.sigma.at(wrapped(u), v);
    std::array<float, 5> y{};  // sums of three
    for (int row = -1; row <= 1; ++row)
      for (int k = -2; k <= 2; ++k) {
        const float other = value_at(u + k * du + row * dv, v + k * dv + row * du);
        const auto far = float(std::max(std::abs(k), std::abs(row)));
        if (!(other > 0) || std::abs(other - x) > limit_at(x, 1.42f * sigma, far)) return out;
        y[std::size_t(k + 2)] += other;
      }
    // Orthogonal polynomials of second degree (creases) and of third (steps), of unit length.
    const float second = (2 * (y[0] - y[2] + y[4]) - y[1] - y[3]) / std::sqrt(14.0f);
    const float third = (y[4] - y[0] - 2 * (y[3] - y[1])) / std::sqrt(10.0f);
    const float smooth = kBend * spacing_at(x) * slope_at(x) * 0.5f * std::sqrt(14.0f);
    out.slope = (2 * (y[4] - y[0]) + y[3] - y[1]) / 30;
    out.bend = std::hypot(second, third) / (3 * smooth + kBendNoise * std::sqrt(3.0f) * sigma);
    return out;
  }

  // How far to go along (du, dv) for a run of one smooth surface with this surfel; nothing where there is none. A bend
  // that is largest here is in the surfel itself, so that its mean is off, and no run is its own; three values may
  // still pass where it is shallow. From others, runs lead away.
  std::optional<int> way_to_run(int u, int v, int du, int dv) const {
    const auto at = [&](int k) { return run_at(u + k * du, v + k * dv, du, dv); };
    const Run here = at(0);
    if (here.is_smooth()) return 0;
    if (here.exists()) {
      const Run before = at(-1), after = at(1);
      const float b = before.exists() ? before.bend : 0, a = after.exists() ? after.bend : 0;
      if (here.bend >= std::max(a, b)) return std::nullopt;
      const int away = b > a ? 1 : -1;
      if (at(2 * away).is_smooth()) return 2 * away;
      if ((b > a ? after : before).is_smooth()) return away;
      return std::nullopt;
    }
    for (const int k : {-1, 1, -2, 2})
      if (at(k).is_smooth()) return k;
    return std::nullopt;
  }

  bool gradients(int u, int v, Gradient& along_u, Gradient& along_v) const {
    const std::optional<int> way_u = way_to_run(u, v, 1, 0), way_v = way_to_run(u, v, 0, 1);
    if (!way_u || !way_v) return gradient_of_three(u, v, 1, 0, along_u) && gradient_of_three(u, v, 0, 1, along_v);
    const auto sign = [](int k) { return (k > 0) - (k < 0); };
    Run run_u = run_at(u + *way_u, v + sign(*way_v), 1, 0), run_v = run_at(u + sign(*way_u), v + *way_v, 0, 1);
    // Those are other runs than the ones that were found smooth, and may lead across a crease.
    if (!run_u.is_smooth()) run_u = run_at(u + *way_u, v, 1, 0);
    if (!run_v.is_smooth()) run_v = run_at(u, v + *way_v, 0, 1);
    along_u = {run_u.slope, 1.0f / 30};
    along_v = {run_v.slope, 1.0f / 30};
    return true;
  }

  bool gradient_of_three(int u, int v, int du, int dv, Gradient& out) const {
    const float x = level_.value.at(u, v), sigma = level_.sigma.at(u, v), spacing = spacing_at(x) * slope_at(x);
    const float bend = kNoiseFactor * 2.45f * sigma + kBendOfThree * spacing;
    const auto near = [&](int steps) {
      const float other = value_at(u + steps * du, v + steps * dv);
      return other > 0 && std::abs(other - x) <= limit_at(x, 1.42f * sigma, 1) ? other : 0.0f;
    };
    const float before = near(-1), after = near(1);
    if (bend > kMostBend * spacing || !(before > 0) || !(after > 0) || std::abs(before + after - 2 * x) > bend)
      return false;
    out = {0.5f * (after - before), 0.5f};
    return true;
  }

  Surfel make_surfel(int u, int v) const {
    Surfel out;
    const float x = level_.value.at(u, v), sigma = level_.sigma.at(u, v);
    Gradient along_u, along_v;
    if (!(x > 0)) return out;
    const double f = level_.factor, U = f * (u + 0.5) - 0.5, V = f * (v + 0.5) - 0.5;
    const auto at = [&](double du, double dv, float value) {
      return unproject(view_.sensor, U + f * du, V + f * dv, double(range_of(value)));
    };
    const Eigen::Vector3d point = at(0, 0, x);
    out.point = point.cast<float>();
    if (!gradients(u, v, along_u, along_v)) return out;
    const float h = 0.5f;  // half a surfel either way, so that values stay positive
    const Eigen::Vector3d tangent_u = at(0.5, 0, x + h * along_u.slope) - at(-0.5, 0, x - h * along_u.slope);
    const Eigen::Vector3d tangent_v = at(0, 0.5, x + h * along_v.slope) - at(0, -0.5, x - h * along_v.slope);
    Eigen::Vector3d normal = tangent_u.cross(tangent_v);
    const double length = normal.norm();
    if (!(length > 0) || !std::isfinite(length)) return out;
    normal /= length;
    const double r = double(range_of(x));
    const Eigen::Vector3d per_range = (unproject(view_.sensor, U, V, 1.001 * r) - point) / (0.001 * r);
    double cosine = normal.dot(per_range);
    if (cosine > 0) normal = -normal;
    cosine = std::abs(cosine);
    if (cosine < double(kLeastCosine) * per_range.norm()) return out;
    const float sigma_r = is_central_ ? sigma / (x * x) : sigma;
    out.tilt_rad = sigma_r * std::sqrt(std::max(along_u.variance, along_v.variance)) / spacing_at(x);
    if (out.tilt_rad > kMostTilt_rad) return out;
    out.normal = normal.cast<float>();
    out.sigma_m = std::hypot(sigma_r * float(cosine), kLookupOffset * spacing_at(x) * out.tilt_rad);
    return out;
  }

  SurfelImage surfels_of_level() {
    SurfelImage out;
    out.factor = level_.factor;
    out.width = level_.value.width;
    out.height = level_.value.height;
    // A circle of samples that the factor does not divide has a gap between its last block and its first.
    wraps_ = lapseam::wraps(view_.sensor) && out.width * out.factor == view_.range.width;
    out.wraps = wraps_;
    out.surfels.resize(level_.value.size());
    std::vector<float> spacings;
    for (int v = 0; v < out.height; ++v)
      for (int u = 0; u < out.width; ++u) {
        const std::size_t i = level_.value.index(u, v);
        out.surfels[i] = make_surfel(u, v);
        if (!out.surfels[i].is_usable()) continue;
        out.usable.push_back(std::uint32_t(i));
        spacings.push_back(spacing_at(level_.value.pixels[i]));
      }
    if (spacings.empty()) return out;
    const auto middle = spacings.begin() + std::ptrdiff_t(spacings.size() / 2);
    std::nth_element(spacings.begin(), middle, spacings.end());
    out.spacing_m = double(*middle);
    return out;
  }

  void add_brightness(const BrightnessAt& brightness, SurfelImage& out) const {
    const float none = std::numeric_limits<float>::quiet_NaN();
    out.brightness.assign(out.surfels.size(), none);
    out.brightness_gradient_per_m.assign(out.surfels.size(), Eigen::Vector3f::Zero());
    for (std::size_t i = 0; i < out.surfels.size(); ++i)
      if (level_.value.pixels[i] > 0)
        out.brightness[i] = brightness(out.surfels[i].point, spacing_at(level_.value.pixels[i]));
    std::vector<std::uint32_t> without;  // told only when all are done: neighbours are looked at
    for (const std::uint32_t i : out.usable)
      if (!fit_gradient(out, int(i) % out.width, int(i) / out.width)) without.push_back(i);
    for (const std::uint32_t i : without) out.brightness[i] = none;
  }

  // Least squares over the eight neighbours on the tangent plane.
  bool fit_gradient(SurfelImage& out, int u, int v) const {
    const std::size_t i = level_.value.index(u, v);
    const Surfel& s = out.surfels[i];
    if (u < 1 || v < 1 || u + 1 >= out.width || v + 1 >= out.height || !std::isfinite(out.brightness[i])) return false;
    const Eigen::Vector3f e1 = s.normal.unitOrthogonal(), e2 = s.normal.cross(e1);
    Eigen::Matrix2f A = Eigen::Matrix2f::Zero();
    Eigen::Vector2f b = Eigen::Vector2f::Zero();
    for (int dv = -1; dv <= 1; ++dv)
      for (int du = -1; du <= 1; ++du) {
        const std::size_t j = level_.value.index(u + du, v + dv);
        if (!(level_.value.pixels[j] > 0) || !std::isfinite(out.brightness[j])) return false;
        const Eigen::Vector3f d = out.surfels[j].point - s.point;
        const Eigen::Vector2f x(d.dot(e1), d.dot(e2));
        A += x * x.transpose();
        b += x * (out.brightness[j] - out.brightness[i]);
      }
    if (!(A.determinant() > 0)) return false;
    const Eigen::Vector2f g = A.inverse() * b;
    out.brightness_gradient_per_m[i] = g.x() * e1 + g.y() * e2;
    return true;
  }

  static void describe(SurfelPyramid& out) {
    const SurfelImage& finest = out.levels.front();
    if (finest.usable.empty()) return;
    for (const std::uint32_t i : finest.usable)
      out.center_in_view += finest.surfels[i].point.cast<double>() / double(finest.usable.size());
    std::vector<double> distances;
    for (const std::uint32_t i : finest.usable) {
      out.box_in_view.extend(finest.surfels[i].point.cast<double>());
      distances.push_back((finest.surfels[i].point.cast<double>() - out.center_in_view).norm());
    }
    const auto most = distances.begin() + std::ptrdiff_t(0.9 * double(distances.size() - 1));
    std::nth_element(distances.begin(), most, distances.end());
    out.radius_m = *most;
  }

  const View& view_;
  const bool is_central_;
  const SpacingLine spacing_;
  Level level_;
  std::size_t valid_ = 0;
  bool wraps_ = false;
};

}  // namespace

std::int64_t SurfelImage::index_at(double u_px, double v_px) const {
  auto u = std::int64_t(std::floor((u_px + 0.5) / factor));
  const auto v = std::int64_t(std::floor((v_px + 0.5) / factor));
  if (wraps && (u == width || u == -1)) u = u < 0 ? width - 1 : 0;
  if (u < 0 || v < 0 || u >= width || v >= height) return -1;
  return v * width + u;
}

SurfelPyramid make_surfels(const View& view, const NoiseModel& noise, std::size_t most_surfels,
                           const BrightnessAt& brightness) {
  return Maker(view, noise).run(most_surfels, brightness);
}

}  // namespace lapseam
