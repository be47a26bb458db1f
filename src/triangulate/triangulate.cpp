// Based on: Y. Sun, C. Dumont, M. Abidi, Mesh-based Integration of Range and Color Images, 2000, §2.1.

#include "lapseam/triangulate.h"

#include <algorithm>
#include <cmath>

#include "core/parallel.h"

namespace lapseam {
namespace {

// A difference of two ranges may come from noise up to this many standard deviations of the difference.
constexpr double kNoiseFactor = 3.5;
const double kSqrt2 = std::sqrt(2.0);

// The steepest surface that one pair of samples may claim, and the steepest that a row of them may: tan 76°, tan 85°.
constexpr double kIsolatedSlope = 4.0;
constexpr double kContinuedSlope = 11.4;

// Neighbouring differences of one plane may differ by noise and by this share of themselves (perspective, curvature).
constexpr float kSlopeChange = 0.5f;

class Triangulator {
 public:
  Triangulator(const View& view, const RayTable& rays, const StepThreshold& threshold)
      : range_(view.range), rays_(rays), threshold_(threshold), width_(view.range.width), height_(view.range.height) {
    grid_.width = width_;
    grid_.height = height_;
    grid_.wraps = wraps(view.sensor);
    grid_.is_mirrored = handedness(view.sensor) < 0;
    grid_.cells.assign(range_.size(), 0);
  }

  PatchGrid run(Context& context) {
    parallel_blocks(context, std::size_t(height_ > 0 ? height_ - 1 : 0), 32, [&](std::size_t begin, std::size_t end) {
      for (std::size_t v = begin; v != end; ++v)
        for (int u = 0; u < width_ - (grid_.wraps ? 0 : 1); ++u) triangulate_cell(u, int(v));
    });
    return std::move(grid_);
  }

 private:
  float range_at(int u, int v) const {
    if (v < 0 || v >= height_) return kInvalidRange;
    if (u < 0 || u >= width_) {
      if (!grid_.wraps) return kInvalidRange;
      u = (u + width_) % width_;
    }
    return range_.at(u, v);
  }

  // Whether samples (u, v) and (u + du, v + dv) lie on one surface.
  bool is_connected(int u, int v, int du, int dv, float a, float b) const {
    if (!(a > 0) || !(b > 0)) return false;
    const float difference = b - a;
    const auto nearest = double(std::min(a, b));
    const double stretch = du != 0 && dv != 0 ? kSqrt2 : 1.0;
    if (double(std::abs(difference)) <= threshold_.isolated(nearest) * stretch) return true;
    if (double(std::abs(difference)) > threshold_.continued(nearest) * stretch) return false;
    const float tolerance =
        kSlopeChange * std::abs(difference) + float(kNoiseFactor * 2.0 * threshold_.noise.sigma(nearest));
    const float before = range_at(u - du, v - dv), after = range_at(u + 2 * du, v + 2 * dv);
    return (before > 0 && std::abs((a - before) - difference) <= tolerance) ||
           (after > 0 && std::abs((after - b) - difference) <= tolerance);
  }

  void triangulate_cell(int u, int v) {
    const int u1 = u + 1 < width_ ? u + 1 : 0;
    const float r00 = range_.at(u, v), r10 = range_.at(u1, v), r01 = range_.at(u, v + 1), r11 = range_.at(u1, v + 1);
    const int valid = (r00 > 0) + (r10 > 0) + (r01 > 0) + (r11 > 0);
    if (valid < 3) return;
    const bool top = is_connected(u, v, 1, 0, r00, r10), left = is_connected(u, v, 0, 1, r00, r01);
    const bool bottom = is_connected(u, v + 1, 1, 0, r01, r11), right = is_connected(u1, v, 0, 1, r10, r11);
    const bool main_diagonal = is_connected(u, v, 1, 1, r00, r11);
    const bool anti_diagonal = is_connected(u1, v, -1, 1, r10, r01);
    // Main: lower left (left, bottom), upper right (right, top). Anti: upper left (left, top), lower right (bottom,
    // right).
    const bool main0 = main_diagonal && left && bottom, main1 = main_diagonal && right && top;
    const bool anti0 = anti_diagonal && left && top, anti1 = anti_diagonal && bottom && right;
    bool use_anti;
    if (main0 && main1 && anti0 && anti1)
      use_anti = is_anti_shorter(u, u1, v);
    else
      use_anti = int(anti0) + int(anti1) > int(main0) + int(main1);
    const bool slot0 = use_anti ? anti0 : main0, slot1 = use_anti ? anti1 : main1;
    std::uint8_t cell = use_anti ? PatchGrid::kAntiDiagonal : 0;
    if (slot0) cell |= PatchGrid::kExists;
    if (slot1) cell |= PatchGrid::kExists << 1;
    if (slot0 || slot1) grid_.cells[range_.index(u, v)] = cell;
  }

  bool is_anti_shorter(int u, int u1, int v) const {
    const auto p = [&](int x, int y) { return rays_.point(range_.index(x, y), range_.at(x, y)); };
    return (p(u1, v) - p(u, v + 1)).squaredNorm() < (p(u, v) - p(u1, v + 1)).squaredNorm();
  }

  const RangeImage& range_;
  const RayTable& rays_;
  const StepThreshold& threshold_;
  int width_, height_;
  PatchGrid grid_;
};

}  // namespace

double StepThreshold::isolated(double r) const {
  return kIsolatedSlope * spacing(r) + kNoiseFactor * kSqrt2 * noise.sigma(r);
}
double StepThreshold::continued(double r) const {
  return kContinuedSlope * spacing(r) + kNoiseFactor * kSqrt2 * noise.sigma(r);
}

StepThreshold make_step_threshold(const Sensor& sensor, const NoiseModel& noise) {
  const double u = 0.5 * (width(sensor) - 1), v = 0.5 * (height(sensor) - 1);
  const double at_one = sample_spacing(sensor, u, v, 1.0), at_two = sample_spacing(sensor, u, v, 2.0);
  StepThreshold threshold;
  threshold.spacing_slope = at_two - at_one;
  threshold.spacing_offset_m = at_one - threshold.spacing_slope;
  threshold.noise = noise;
  return threshold;
}

PatchGrid triangulate(const View& view, const RayTable& rays, const StepThreshold& threshold, Context& context) {
  return Triangulator(view, rays, threshold).run(context);
}

}  // namespace lapseam
