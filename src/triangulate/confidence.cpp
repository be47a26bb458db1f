// Based on: Y. Sun, C. Dumont, M. Abidi, Mesh-based Integration of Range and Color Images, 2000, §2.2; and
// G. Turk, M. Levoy, Zippered Polygon Meshes from Range Images, 1994, §3 (weights fall off at borders).

#include <algorithm>
#include <cmath>

#include "core/parallel.h"
#include "lapseam/mesh.h"
#include "lapseam/triangulate.h"

namespace lapseam {
namespace {

// How much of the sample spacing counts as error: between samples a surface is only guessed.
constexpr double kSpacingShare = 0.25;
// Confidence rises from kBorderShare at a border to 1 this many samples inside.
constexpr int kBorderRamp_px = 12;
constexpr float kBorderShare = 0.3f;
// Neither quantity changes from one sample to the next: both are measured once in a block of samples this wide.
constexpr int kBlock_px = 2;
// Who wins must not flicker with the noise of the incidence: confidence is averaged over windows of this radius, twice.
constexpr int kAveraging_blocks = 4;
// Normals for the incidence come from differences over this many blocks either side, of range smoothed at these taps.
constexpr int kBaseline_blocks = 2;
// More grazing normals are not told from this.
constexpr float kLowestCosine = 0.02f;
constexpr int kTaps_blocks[] = {1, 2};

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

// A view in blocks. Each is stood for by one of its samples that a triangle uses.
class Blocks {
 public:
  Blocks(const Patch& patch, const StepThreshold& threshold, const std::vector<std::uint8_t>& used)
      : patch_(patch),
        threshold_(threshold),
        wraps_(patch.grid.wraps),
        pixel_((patch.grid.width + kBlock_px - 1) / kBlock_px, (patch.grid.height + kBlock_px - 1) / kBlock_px,
               kInvalidIndex),
        range_(pixel_.width, pixel_.height, 0.0f),
        limit_(pixel_.width, pixel_.height, 0.0f) {
    const int w = patch.grid.width, h = patch.grid.height;
    for (int v = h - 1; v >= 0; --v)
      for (int u = w - 1; u >= 0; --u) {
        const std::size_t i = std::size_t(v) * std::size_t(w) + std::size_t(u);
        if (used[i]) pixel_.at(u / kBlock_px, v / kBlock_px) = std::uint32_t(i);
      }
    for (std::size_t b = 0; b < pixel_.size(); ++b) {
      if (pixel_.pixels[b] == kInvalidIndex) continue;
      const float r = patch.view.range.pixels[pixel_.pixels[b]];
      range_.pixels[b] = r;
      limit_.pixels[b] = float(threshold.isolated(double(r))) * kBlock_px;
    }
  }

  int width() const { return pixel_.width; }
  int height() const { return pixel_.height; }
  /// kInvalidIndex: no triangle uses a sample of the block.
  std::uint32_t pixel(int x, int y) const { return pixel_.at(x, y); }

  /// Strongly, within steps; only for directions, never for positions.
  void smooth() {
    Image<float> next(width(), height(), 0.0f);
    for (const int tap : kTaps_blocks)
      for (int axis = 0; axis < 2; ++axis) {
        const int dx = axis == 0 ? tap : 0, dy = axis == 1 ? tap : 0;
        next.pixels = range_.pixels;
        for (int y = dy; y + dy < height(); ++y) {
          const float* const before = &range_.at(0, y - dy);
          const float* const here = &range_.at(0, y);
          const float* const after = &range_.at(0, y + dy);
          const float* const limit = &limit_.at(0, y);
          float* const out = &next.at(0, y);
          for (int x = dx; x + dx < width(); ++x) {
            const float a = before[x - dx], b = after[x + dx], r = here[x], most = limit[x] * float(tap);
            const bool agree = a > 0 && b > 0 && std::abs(a - r) < most && std::abs(b - r) < most;
            out[x] = agree ? 0.5f * r + 0.25f * (a + b) : r;
          }
        }
        range_.pixels.swap(next.pixels);
      }
  }

  /// Between the ray and the normal, from one-sided or central differences within steps; 0 if unknown.
  float cosine(int x, int y) const {
    const Eigen::Vector3f normal = tangent(x, y, 1, 0).cross(tangent(x, y, 0, 1));
    const Eigen::Vector3f& ray = patch_.rays->directions[pixel(x, y)];
    const float length = normal.norm() * ray.norm();
    return length > 0 ? std::min(1.0f, std::abs(normal.dot(ray)) / length) : 0.0f;
  }

 private:
  Eigen::Vector3f tangent(int x, int y, int dx, int dy) const {
    return farthest(x, y, dx, dy) - farthest(x, y, -dx, -dy);
  }
  Eigen::Vector3f farthest(int x, int y, int dx, int dy) const {
    std::size_t best = pixel_.index(x, y);
    for (int k = 1; k <= kBaseline_blocks; ++k) {
      int i = x + k * dx;
      const int j = y + k * dy;
      if (j < 0 || j >= height()) break;
      if (i < 0 || i >= width()) {
        if (!wraps_) break;
        i = (i + width()) % width();
      }
      const std::size_t b = pixel_.index(i, j);
      if (!(range_.pixels[b] > 0) || double(std::abs(range_.pixels[b] - range_.pixels[best])) >
                                         kBlock_px * threshold_.continued(double(range_.pixels[best])))
        break;
      best = b;
    }
    return patch_.rays->point(pixel_.pixels[best], range_.pixels[best]);
  }

  const Patch& patch_;
  const StepThreshold& threshold_;
  bool wraps_;
  Image<std::uint32_t> pixel_;
  Image<float> range_, limit_;
};

// Mean over a window of rows or columns, of blocks in use only (> 0), by running sums.
Image<float> average_columns(const Image<float>& image) {
  const int w = image.width, h = image.height;
  Image<float> out(w, h, 0.0f);
  std::vector<double> sum(std::size_t(w), 0.0);
  std::vector<int> count(std::size_t(w), 0);
  const auto add = [&](int y, int sign) {
    for (int x = 0; x < w; ++x) {
      sum[std::size_t(x)] += sign * double(image.at(x, y));
      count[std::size_t(x)] += image.at(x, y) > 0 ? sign : 0;
    }
  };
  for (int y = 0; y < std::min(kAveraging_blocks, h); ++y) add(y, 1);
  for (int y = 0; y < h; ++y) {
    if (y + kAveraging_blocks < h) add(y + kAveraging_blocks, 1);
    if (y - kAveraging_blocks - 1 >= 0) add(y - kAveraging_blocks - 1, -1);
    for (int x = 0; x < w; ++x)
      if (image.at(x, y) > 0) out.at(x, y) = float(sum[std::size_t(x)] / count[std::size_t(x)]);
  }
  return out;
}

Image<float> average_rows(const Image<float>& image, bool wraps) {
  const int w = image.width;
  Image<float> out(w, image.height, 0.0f);
  const int reach = std::min(kAveraging_blocks, (w - 1) / 2);
  for (int y = 0; y < image.height; ++y) {
    double sum = 0;
    int count = 0;
    const auto add = [&](int x, int sign) {
      if (x < 0 || x >= w) {
        if (!wraps) return;
        x = (x + w) % w;
      }
      sum += sign * double(image.at(x, y));
      count += image.at(x, y) > 0 ? sign : 0;
    };
    for (int x = -reach; x < reach; ++x) add(x, 1);
    for (int x = 0; x < w; ++x) {
      add(x + reach, 1);
      if (x > 0) add(x - reach - 1, -1);
      if (image.at(x, y) > 0) out.at(x, y) = float(sum / count);
    }
  }
  return out;
}

}  // namespace

void measure_confidence(Patch& patch, const StepThreshold& threshold, Context& context) {
  context.throw_if_cancelled();
  const int w = patch.grid.width, h = patch.grid.height;
  patch.confidence = Image<std::uint8_t>(w, h, 0);
  patch.incidence = Image<std::uint8_t>(w, h, 0);
  const std::vector<std::uint8_t> used = mark_used_samples(patch.grid);
  const std::vector<std::uint8_t> border = distance_to_border(patch.grid);
  Blocks blocks(patch, threshold, used);
  blocks.smooth();
  Image<float> confidence(blocks.width(), blocks.height(), 0.0f);
  Image<std::uint8_t> incidence(blocks.width(), blocks.height(), 0);
  for (int y = 0; y < blocks.height(); ++y)
    for (int x = 0; x < blocks.width(); ++x) {
      const std::uint32_t i = blocks.pixel(x, y);
      if (i == kInvalidIndex) continue;
      const auto r = double(patch.view.range.pixels[i]);
      const float cosine = blocks.cosine(x, y), believed = std::max(kLowestCosine, cosine);
      const double noise_m = double(patch.sigma_across(i, believed) / believed);
      const auto error = float(std::hypot(noise_m, kSpacingShare * threshold.spacing(r)));
      const float ramp = kBorderShare + (1.0f - kBorderShare) * float(border[i]) / float(kBorderRamp_px);
      // Never 0 for a sample in use: any measurement beats none.
      confidence.at(x, y) = believed * ramp / error;
      incidence.at(x, y) = std::uint8_t(std::lround(cosine * 255.0f));
    }
  for (int pass = 0; pass < 2; ++pass) confidence = average_columns(average_rows(confidence, patch.grid.wraps));
  Image<std::uint8_t> code(blocks.width(), blocks.height(), 0);
  for (std::size_t b = 0; b < code.size(); ++b)
    if (confidence.pixels[b] > 0) code.pixels[b] = confidence_code(confidence.pixels[b]);
  for (int v = 0; v < h; ++v)
    for (int u = 0; u < w; ++u) {
      const std::size_t i = patch.confidence.index(u, v);
      if (!used[i]) continue;
      patch.confidence.pixels[i] = code.at(u / kBlock_px, v / kBlock_px);
      patch.incidence.pixels[i] = incidence.at(u / kBlock_px, v / kBlock_px);
    }
}

}  // namespace lapseam
