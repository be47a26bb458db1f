#include "noise/roughness.h"

#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <span>

namespace lapseam {
namespace {

constexpr int kInner_px = 16, kMargin_px = 2, kTile_px = kInner_px + 2 * kMargin_px;

// One sample less the mean of its four neighbours, done twice: the weights are 1.25 in the middle, −1/2 beside it, 1/8
// on the diagonals and 1/16 two samples away. The root of their sum of squares:
const float kGain = std::sqrt(2.640625f);

constexpr float kNone = std::numeric_limits<float>::quiet_NaN();

// A tile is a plane if most of it is there and lies no farther from one than neighbours differ.
constexpr double kFewestOfPlane = 0.6, kFlat = 1.5;
// At more grazing incidence (87°) a pixel is a pixel off.
constexpr double kLowestCosine = 0.05;

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
  Tile(const S& sensor, const RangeImage& range, const Image<std::uint8_t>& intensity, int u0, int v0)
      : sensor_(sensor),
        intensity_(intensity),
        u0_(u0),
        v0_(v0),
        width_(std::min(kTile_px, range.width)),
        height_(std::min(kTile_px, range.height)) {
    for (int y = 0; y < height_; ++y)
      for (int x = 0; x < width_; ++x) {
        const float r = range.at(u0 + x, v0 + y);
        const std::size_t i = index(x, y);
        range_[i] = r > 0 ? r : kNone;
        if (r > 0) points_[i] = sensor.unproject(u0 + x, v0 + y, double(r));
      }
    for (int y = 0; y < height_; ++y)
      for (int x = 0; x < width_; ++x) once_[index(x, y)] = off_the_plane(x, y);
  }

  void append_to(std::vector<Roughness>& out) const {
    const std::size_t first = out.size();
    for (int y = kMargin_px; y < height_ - kMargin_px; ++y)
      for (int x = kMargin_px; x < width_ - kMargin_px; ++x) {
        const std::size_t i = index(x, y);
        // Surfaces that bend evenly are off by the same amount here and next to here.
        const float twice =
            once_[i] - 0.25f * (once_[i - 1] + once_[i + 1] + once_[i - kTile_px] + once_[i + kTile_px]);
        if (std::isfinite(twice)) out.push_back({range_[i], twice / kGain, -1, intensity_at(x, y)});
      }
    const float slope_m = slope_of_plane(std::span(out).subspan(first));
    for (std::size_t i = first; i < out.size(); ++i) out[i].slope_m = slope_m;
  }

 private:
  static std::size_t index(int x, int y) { return std::size_t(y) * kTile_px + std::size_t(x); }

  std::uint8_t intensity_at(int x, int y) const {
    return intensity_.pixels.empty() ? std::uint8_t(0) : intensity_.at(u0_ + x, v0_ + y);
  }

  // How far the sample lies, along its ray, behind the plane through its four neighbours.
  float off_the_plane(int x, int y) const {
    if (x == 0 || y == 0 || x == width_ - 1 || y == height_ - 1) return kNone;
    const std::size_t i = index(x, y), left = i - 1, right = i + 1, up = i - kTile_px, down = i + kTile_px;
    if (!std::isfinite(range_[i] + range_[left] + range_[right] + range_[up] + range_[down])) return kNone;
    const Eigen::Vector3d& p = points_[i];
    const Eigen::Vector3d normal = (points_[right] - points_[left]).cross(points_[down] - points_[up]);
    const Eigen::Vector3d mean = 0.25 * (points_[left] + points_[right] + points_[up] + points_[down]);
    const double facing = normal.dot(ray_slope(sensor_, u0_ + x, v0_ + y, double(range_[i]), p));
    return float(normal.dot(p - mean) / facing);  // not finite where the plane holds the ray
  }

  // Of all samples: single normals are as noisy as what they would explain.
  float slope_of_plane(std::span<const Roughness> found) const {
    if (double(found.size()) < kFewestOfPlane * kInner_px * kInner_px) return -1;
    Eigen::Vector3d mean = Eigen::Vector3d::Zero(), ray = Eigen::Vector3d::Zero();
    double count = 0, range = 0;
    const auto for_each_sample = [&](const auto& f) {
      for (int y = 0; y < height_; ++y)
        for (int x = 0; x < width_; ++x)
          if (std::isfinite(range_[index(x, y)])) f(x, y, points_[index(x, y)]);
    };
    for_each_sample([&](int x, int y, const Eigen::Vector3d& p) {
      mean += p;
      ray += ray_slope(sensor_, u0_ + x, v0_ + y, double(range_[index(x, y)]), p);
      range += double(range_[index(x, y)]);
      ++count;
    });
    mean /= count, ray /= count, range /= count;
    Eigen::Matrix3d spread = Eigen::Matrix3d::Zero();
    for_each_sample([&](int, int, const Eigen::Vector3d& p) { spread += (p - mean) * (p - mean).transpose(); });
    const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> axes(spread);
    const Eigen::Vector3d normal = axes.eigenvectors().col(0);
    const double facing = std::abs(normal.dot(ray)), cosine = facing / ray.norm();
    if (!(cosine > kLowestCosine)) return -1;
    std::vector<double> rough, off;
    for (const Roughness& r : found) rough.push_back(double(std::abs(r.residual_m)));
    for_each_sample(
        [&](int, int, const Eigen::Vector3d& p) { off.push_back(std::abs(normal.dot(p - mean)) / facing); });
    const auto median = [](std::vector<double>& values) {
      const auto middle = values.begin() + std::ptrdiff_t(values.size() / 2);
      std::nth_element(values.begin(), middle, values.end());
      return *middle;
    };
    if (!(median(off) < kFlat * median(rough))) return -1;
    return float(range * std::sqrt(1 - std::min(1.0, cosine * cosine)) / cosine);
  }

  const S& sensor_;
  const Image<std::uint8_t>& intensity_;
  int u0_, v0_;
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
            Tile(sensor, view.range, view.intensity, u0, v0).append_to(out);
          }
      },
      view.sensor);
  return out;
}

}  // namespace lapseam
