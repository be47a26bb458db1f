#include "noise/roughness.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

namespace lapseam {
namespace {

constexpr int kInner_px = 16, kMargin_px = 2, kTile_px = kInner_px + 2 * kMargin_px;

// One sample less the mean of its four neighbours, done twice: the weights are 1.25 in the middle, −1/2 beside it, 1/8
// on the diagonals and 1/16 two samples away. The root of their sum of squares:
const float kGain = std::sqrt(2.640625f);

constexpr float kNone = std::numeric_limits<float>::quiet_NaN();

// d(point)/d(r) at a sample.
Eigen::Vector3d ray_slope(const PinholeSensor&, double, double, double r, const Eigen::Vector3d& p) { return p / r; }
Eigen::Vector3d ray_slope(const SphericalSensor&, double, double, double r, const Eigen::Vector3d& p) { return p / r; }
Eigen::Vector3d ray_slope(const OrthographicSensor&, double, double, double, const Eigen::Vector3d&) {
  return Eigen::Vector3d::UnitZ();
}
Eigen::Vector3d ray_slope(const MeasuredGridSensor& s, double u, double v, double r, const Eigen::Vector3d& p) {
  return s.unproject(u, v, r + 1) - p;
}

// A square of samples with the quantities that the filter passes through.
template <typename S>
class Tile {
 public:
  Tile(const S& sensor, const RangeImage& range, int u0, int v0)
      : width_(std::min(kTile_px, range.width)), height_(std::min(kTile_px, range.height)) {
    for (int y = 0; y < height_; ++y)
      for (int x = 0; x < width_; ++x) {
        const float r = range.at(u0 + x, v0 + y);
        const std::size_t i = index(x, y);
        range_[i] = r > 0 ? r : kNone;
        if (r > 0) points_[i] = sensor.unproject(u0 + x, v0 + y, double(r));
      }
    for (int y = 0; y < height_; ++y)
      for (int x = 0; x < width_; ++x) once_[index(x, y)] = off_the_plane(sensor, u0, v0, x, y);
  }

  void append_to(std::vector<Roughness>& out) const {
    for (int y = kMargin_px; y < height_ - kMargin_px; ++y)
      for (int x = kMargin_px; x < width_ - kMargin_px; ++x) {
        const std::size_t i = index(x, y);
        // Surfaces that bend evenly are off by the same amount here and next to here.
        const float twice =
            once_[i] - 0.25f * (once_[i - 1] + once_[i + 1] + once_[i - kTile_px] + once_[i + kTile_px]);
        if (std::isfinite(twice)) out.push_back({range_[i], twice / kGain});
      }
  }

 private:
  static std::size_t index(int x, int y) { return std::size_t(y) * kTile_px + std::size_t(x); }

  // How far the sample lies, along its ray, behind the plane through its four neighbours.
  float off_the_plane(const S& sensor, int u0, int v0, int x, int y) const {
    if (x == 0 || y == 0 || x == width_ - 1 || y == height_ - 1) return kNone;
    const std::size_t i = index(x, y), left = i - 1, right = i + 1, up = i - kTile_px, down = i + kTile_px;
    if (!std::isfinite(range_[i] + range_[left] + range_[right] + range_[up] + range_[down])) return kNone;
    const Eigen::Vector3d& p = points_[i];
    const Eigen::Vector3d normal = (points_[right] - points_[left]).cross(points_[down] - points_[up]);
    const Eigen::Vector3d mean = 0.25 * (points_[left] + points_[right] + points_[up] + points_[down]);
    const double facing = normal.dot(ray_slope(sensor, u0 + x, v0 + y, double(range_[i]), p));
    return float(normal.dot(p - mean) / facing);  // not finite where the plane holds the ray
  }

  int width_, height_;
  std::array<float, kTile_px * kTile_px> range_;
  std::array<Eigen::Vector3d, kTile_px * kTile_px> points_;
  std::array<float, kTile_px * kTile_px> once_;
};

}  // namespace

std::vector<Roughness> measure_roughness(const View& view, int tiles) {
  std::vector<Roughness> out;
  const int free_u = std::max(0, view.range.width - kTile_px), free_v = std::max(0, view.range.height - kTile_px);
  // As many across as down, in proportion to the image, and no two at one place.
  const double aspect = double(view.range.width) / std::max(1, view.range.height);
  const int across = std::clamp(int(std::lround(std::sqrt(tiles * aspect))), 1, free_u / kInner_px + 1);
  const int down = std::clamp(int(std::lround(double(tiles) / across)), 1, free_v / kInner_px + 1);
  std::visit(
      [&](const auto& sensor) {
        for (int j = 0; j < down; ++j)
          for (int i = 0; i < across; ++i) {
            const int u0 = across > 1 ? int(std::int64_t(free_u) * i / (across - 1)) : free_u / 2;
            const int v0 = down > 1 ? int(std::int64_t(free_v) * j / (down - 1)) : free_v / 2;
            Tile(sensor, view.range, u0, v0).append_to(out);
          }
      },
      view.sensor);
  return out;
}

}  // namespace lapseam
