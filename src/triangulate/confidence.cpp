// Based on: Y. Sun, C. Dumont, M. Abidi, Mesh-based Integration of Range and Color Images, 2000, §2.2; and
// G. Turk, M. Levoy, Zippered Polygon Meshes from Range Images, 1994, §3 (weights fall off at borders).

#include <algorithm>
#include <cmath>

#include "core/parallel.h"
#include "lapseam/triangulate.h"

namespace lapseam {
namespace {

// How much of the sample spacing counts as error: between samples a surface is only guessed.
constexpr double kSpacingShare = 0.25;
// Confidence rises from kBorderShare at a border to 1 this many samples inside.
constexpr int kBorderRamp_px = 12;
constexpr float kBorderShare = 0.3f;
// Who wins must not flicker with the noise of the incidence: confidence is averaged over windows of this radius, twice.
constexpr int kAveraging_px = 8;
// Normals for the incidence come from differences over this many samples either side, of range smoothed at these taps.
constexpr int kBaseline_px = 3;
constexpr int kTaps[] = {1, 2, 4};

// Samples that no triangle uses have no say.
std::vector<std::uint8_t> mark_used_samples(const PatchGrid& grid) {
  std::vector<std::uint8_t> used(grid.cells.size(), 0);
  for (std::size_t cell = 0; cell < grid.cells.size(); ++cell)
    for (int slot = 0; slot < 2; ++slot)
      if (grid.exists(cell, slot))
        for (const std::uint32_t p : grid.corners(cell, slot)) used[p] = 1;
  return used;
}

// Chessboard distance to the nearest sample whose ring of triangles is not complete, capped at the ramp. Two sweeps.
std::vector<std::uint8_t> distance_to_border(const PatchGrid& grid) {
  const int w = grid.width, h = grid.height;
  std::vector<std::uint8_t> distance(grid.cells.size(), 0);
  const auto full = [&](int u, int v) {
    if (v < 0 || v >= h - 1) return false;
    if (u < 0 || u >= w) {
      if (!grid.wraps) return false;
      u = (u + w) % w;
    }
    const std::uint8_t both = PatchGrid::kExists | (PatchGrid::kExists << 1);
    return (grid.cells[std::size_t(v) * std::size_t(w) + std::size_t(u)] & both) == both;
  };
  const auto at = [&](int u, int v) -> int {
    if (v < 0 || v >= h) return -1;
    if (u < 0 || u >= w) {
      if (!grid.wraps) return -1;
      u = (u + w) % w;
    }
    return distance[std::size_t(v) * std::size_t(w) + std::size_t(u)];
  };
  for (int v = 0; v < h; ++v)
    for (int u = 0; u < w; ++u) {
      const bool inside = full(u, v) && full(u - 1, v) && full(u, v - 1) && full(u - 1, v - 1);
      const int before = std::min({at(u - 1, v), at(u, v - 1), at(u - 1, v - 1), at(u + 1, v - 1)});
      distance[std::size_t(v) * std::size_t(w) + std::size_t(u)] =
          inside ? std::uint8_t(std::min(kBorderRamp_px, std::max(0, before) + 1)) : 0;
    }
  for (int v = h - 1; v >= 0; --v)
    for (int u = w - 1; u >= 0; --u) {
      auto& d = distance[std::size_t(v) * std::size_t(w) + std::size_t(u)];
      const int after = std::min({at(u + 1, v), at(u, v + 1), at(u + 1, v + 1), at(u - 1, v + 1)});
      if (d > 0) d = std::uint8_t(std::min(int(d), std::max(0, after) + 1));
    }
  return distance;
}

// Range smoothed strongly within steps; only for directions, never for positions.
std::vector<float> smooth_for_normals(const Patch& patch, const StepThreshold& threshold, Context& context) {
  const RangeImage& range = patch.view.range;
  const int w = range.width, h = range.height;
  std::vector<float> value = range.pixels, next(value.size());
  for (const int tap : kTaps)
    for (int axis = 0; axis < 2; ++axis) {
      const int du = axis == 0 ? tap : 0, dv = axis == 1 ? tap : 0;
      parallel_blocks(context, std::size_t(h), 32, [&](std::size_t begin, std::size_t end) {
        for (int v = int(begin); v < int(end); ++v)
          for (int u = 0; u < w; ++u) {
            const std::size_t i = range.index(u, v);
            next[i] = value[i];
            if (!(value[i] > 0) || u < du || v < dv || u + du >= w || v + dv >= h) continue;
            const float a = value[range.index(u - du, v - dv)], b = value[range.index(u + du, v + dv)];
            const float limit = float(threshold.isolated(double(value[i]))) * float(tap);
            if (a > 0 && b > 0 && std::abs(a - value[i]) < limit && std::abs(b - value[i]) < limit)
              next[i] = 0.5f * value[i] + 0.25f * (a + b);
          }
      });
      value.swap(next);
    }
  return value;
}

// Cosine between the ray and the normal at (u, v), from one-sided or central differences within steps; 0 if unknown.
class IncidenceMeasure {
 public:
  IncidenceMeasure(const Patch& patch, const StepThreshold& threshold, const std::vector<float>& range)
      : patch_(patch), threshold_(threshold), range_(range), width_(patch.grid.width), height_(patch.grid.height) {}

  float cosine(int u, int v) const {
    const std::size_t i = std::size_t(v) * std::size_t(width_) + std::size_t(u);
    const Eigen::Vector3f normal = tangent(u, v, 1, 0).cross(tangent(u, v, 0, 1));
    const float length = normal.norm() * patch_.rays->directions[i].norm();
    return length > 0 ? std::min(1.0f, std::abs(normal.dot(patch_.rays->directions[i])) / length) : 0.0f;
  }

 private:
  Eigen::Vector3f tangent(int u, int v, int du, int dv) const {
    const std::size_t after = farthest(u, v, du, dv), before = farthest(u, v, -du, -dv);
    return patch_.rays->point(after, range_[after]) - patch_.rays->point(before, range_[before]);
  }
  std::size_t farthest(int u, int v, int du, int dv) const {
    std::size_t best = std::size_t(v) * std::size_t(width_) + std::size_t(u);
    for (int k = 1; k <= kBaseline_px; ++k) {
      int x = u + k * du;
      const int y = v + k * dv;
      if (y < 0 || y >= height_) break;
      if (x < 0 || x >= width_) {
        if (!patch_.grid.wraps) break;
        x = (x + width_) % width_;
      }
      const std::size_t i = std::size_t(y) * std::size_t(width_) + std::size_t(x);
      if (!(range_[i] > 0) || double(std::abs(range_[i] - range_[best])) > threshold_.continued(double(range_[best])))
        break;
      best = i;
    }
    return best;
  }

  const Patch& patch_;
  const StepThreshold& threshold_;
  const std::vector<float>& range_;
  int width_, height_;
};

// Mean over a window along one axis of the image, of samples in use only (confidence > 0), by running sums.
void average_along(Image<float>& image, bool is_along_u, bool wraps_u, Context& context) {
  const int lines = is_along_u ? image.height : image.width, length = is_along_u ? image.width : image.height;
  const bool is_ring = is_along_u && wraps_u;
  parallel_blocks(context, std::size_t(lines), 16, [&](std::size_t begin, std::size_t end) {
    std::vector<double> sum(std::size_t(length) + 1);
    std::vector<int> count(std::size_t(length) + 1);
    for (int line = int(begin); line < int(end); ++line) {
      const auto at = [&](int i) -> float& { return is_along_u ? image.at(i, line) : image.at(line, i); };
      for (int i = 0; i < length; ++i) {
        sum[std::size_t(i) + 1] = sum[std::size_t(i)] + double(at(i));
        count[std::size_t(i) + 1] = count[std::size_t(i)] + (at(i) > 0 ? 1 : 0);
      }
      const auto window = [&](int first, int last, double& s, int& n) {  // [first, last), inside the line
        s += sum[std::size_t(last)] - sum[std::size_t(first)];
        n += count[std::size_t(last)] - count[std::size_t(first)];
      };
      for (int i = 0; i < length; ++i) {
        if (!(at(i) > 0)) continue;
        const int first = i - kAveraging_px, last = i + kAveraging_px + 1;
        double s = 0;
        int n = 0;
        window(std::max(0, first), std::min(length, last), s, n);
        if (is_ring && first < 0) window(std::max(0, length + first), length, s, n);
        if (is_ring && last > length) window(0, std::min(length, last - length), s, n);
        at(i) = float(s / n);
      }
    }
  });
}

}  // namespace

void measure_confidence(Patch& patch, const StepThreshold& threshold, Context& context) {
  const int w = patch.grid.width, h = patch.grid.height;
  patch.confidence = Image<float>(w, h, 0.0f);
  patch.incidence = Image<std::uint8_t>(w, h, 0);
  const std::vector<std::uint8_t> used = mark_used_samples(patch.grid);
  const std::vector<std::uint8_t> border = distance_to_border(patch.grid);
  const std::vector<float> smoothed = smooth_for_normals(patch, threshold, context);
  const IncidenceMeasure measure(patch, threshold, smoothed);
  parallel_blocks(context, std::size_t(h), 32, [&](std::size_t begin, std::size_t end) {
    for (int v = int(begin); v < int(end); ++v)
      for (int u = 0; u < w; ++u) {
        const std::size_t i = patch.confidence.index(u, v);
        if (!used[i]) continue;
        const auto r = double(patch.view.range.pixels[i]);
        const float cosine = measure.cosine(u, v);
        const auto error = float(std::hypot(patch.noise.sigma(r), kSpacingShare * threshold.spacing(r)));
        const float ramp = kBorderShare + (1.0f - kBorderShare) * float(border[i]) / float(kBorderRamp_px);
        // Never 0 for a sample in use: any measurement beats none.
        patch.confidence.pixels[i] = std::max(0.02f, cosine) * ramp / error;
        patch.incidence.pixels[i] = std::uint8_t(std::lround(cosine * 255.0f));
      }
  });
  for (int pass = 0; pass < 2; ++pass) {
    average_along(patch.confidence, true, patch.grid.wraps, context);
    average_along(patch.confidence, false, patch.grid.wraps, context);
  }
}

}  // namespace lapseam
