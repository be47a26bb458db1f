// Fits the rational projection of a measured grid to its points, and keeps what is left over as a warp table.

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <limits>
#include <string>

#include "lapseam/error.h"
#include "lapseam/sensor.h"

namespace lapseam {
namespace {

using Eigen::Vector3d;
using Eigen::Vector4d;
using Vector7d = Eigen::Matrix<double, 7, 1>;
using Matrix7d = Eigen::Matrix<double, 7, 7>;

constexpr std::size_t kMinSamples = 16;
// Eleven unknowns need no more; taken evenly over the image.
constexpr std::size_t kMaxFitSamples = 100'000;
// Thinner than this part of their extent, samples lie in a plane, and no viewing direction follows from them.
constexpr double kThinnest = 1e-5;
// A denominator keeps at least this part of its value at the samples' centre. Nearer to zero it makes rays of its own.
constexpr double kSmallestDenominator = 0.01;
// Perspective is taken only where it explains this much more than parallel rays do.
constexpr double kClearGain = 1.2, kAffineGoodEnough_px = 0.01;
// Left over more than this part of the image, the samples follow no projection of this kind.
constexpr double kLargestRelativeRms = 0.1;

[[noreturn]] void reject(const std::string& problem) { throw InvalidInput({}, {}, "points", problem); }

// Points and pixel coordinates about zero and of size one, so that the normal equations are well conditioned.
struct Normalized {
  Vector3d center = Vector3d::Zero();
  double scale_m = 1;
  std::vector<Vector3d> points;
  std::array<std::vector<double>, 2> targets;  // u, v
  std::array<double, 2> target_center, target_scale_px;
};

// numerator · (p, 1) / denominator · (p, 1), the latter with constant part one.
struct AxisFit {
  Vector4d numerator = Vector4d::Zero();
  Vector3d denominator = Vector3d::Zero();
  double rms = 0;

  double denominator_at(const Vector3d& p) const { return 1 + denominator.dot(p); }
  double at(const Vector3d& p) const { return (numerator.head<3>().dot(p) + numerator.w()) / denominator_at(p); }
};

Normalized normalize(int width, const std::vector<Vector3d>& points, const std::vector<std::size_t>& valid) {
  Normalized out;
  const std::size_t stride = std::max<std::size_t>(1, (valid.size() + kMaxFitSamples - 1) / kMaxFitSamples);
  std::array<double, 2> sum{};
  for (std::size_t k = 0; k < valid.size(); k += stride) {
    const std::size_t i = valid[k];
    out.points.push_back(points[i]);
    out.targets[0].push_back(double(i % std::size_t(width)));
    out.targets[1].push_back(double(i / std::size_t(width)));
    out.center += points[i];
  }
  const auto n = double(out.points.size());
  out.center /= n;
  double square = 0;
  for (Vector3d& p : out.points) {
    p -= out.center;
    square += p.squaredNorm();
  }
  out.scale_m = std::sqrt(square / n);
  if (!(out.scale_m > 0) || !std::isfinite(out.scale_m)) reject("all samples are at one place");
  for (Vector3d& p : out.points) p /= out.scale_m;
  for (std::size_t axis = 0; axis < 2; ++axis) {
    for (const double t : out.targets[axis]) sum[axis] += t;
    out.target_center[axis] = sum[axis] / n;
    double spread = 0;
    for (double& t : out.targets[axis]) {
      t -= out.target_center[axis];
      spread += t * t;
    }
    out.target_scale_px[axis] = std::sqrt(spread / n);
    if (!(out.target_scale_px[axis] > 0)) reject("all samples are in one row or column of the grid");
    for (double& t : out.targets[axis]) t /= out.target_scale_px[axis];
  }
  return out;
}

void check_spread(const Normalized& data) {
  Eigen::Matrix3d scatter = Eigen::Matrix3d::Zero();
  for (const Vector3d& p : data.points) scatter += p * p.transpose();
  const Vector3d spread = Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(scatter).eigenvalues();
  if (!(spread[0] > kThinnest * kThinnest * spread[2]))
    reject("the samples lie in a plane, from which no viewing direction follows");
}

class AxisFitter {
 public:
  AxisFitter(const Normalized& data, std::size_t axis) : points_(data.points), targets_(data.targets[axis]) {}

  AxisFit fit_affine() const {
    Eigen::Matrix4d normal = Eigen::Matrix4d::Zero();
    Vector4d right = Vector4d::Zero();
    for (std::size_t i = 0; i < points_.size(); ++i) {
      const Vector4d row = points_[i].homogeneous();
      normal += row * row.transpose();
      right += row * targets_[i];
    }
    AxisFit fit;
    fit.numerator = normal.ldlt().solve(right);
    fit.rms = rms(fit);
    return fit;
  }

  // Linear least squares on n(p) − t·d(p) = 0, weighted towards pixel units, then Gauss-Newton on the pixels
  // themselves.
  AxisFit fit_perspective(const AxisFit& affine) const {
    AxisFit fit = affine;
    for (int pass = 0; pass < 3; ++pass) {
      const Vector7d solution = solve([&](std::size_t i, Vector7d& row, double& value) {
        row << points_[i], 1.0, -targets_[i] * points_[i];
        const double weight = 1.0 / std::max(fit.denominator_at(points_[i]), kSmallestDenominator);
        row *= weight;
        value = targets_[i] * weight;
      });
      fit.numerator = solution.head<4>();
      fit.denominator = solution.tail<3>();
    }
    fit.rms = rms(fit);
    for (int pass = 0; pass < 8; ++pass) {
      const Vector7d step = solve([&](std::size_t i, Vector7d& row, double& value) {
        const double d = fit.denominator_at(points_[i]), q = fit.at(points_[i]);
        row << points_[i] / d, 1.0 / d, -q / d * points_[i];
        value = targets_[i] - q;
      });
      AxisFit next = fit;
      next.numerator += step.head<4>();
      next.denominator += step.tail<3>();
      next.rms = rms(next);
      if (!(next.rms < fit.rms)) break;
      fit = next;
    }
    return fit;
  }

  // Infinite where a denominator comes too near to zero.
  double rms(const AxisFit& fit) const {
    double square = 0;
    for (std::size_t i = 0; i < points_.size(); ++i) {
      if (!(fit.denominator_at(points_[i]) > kSmallestDenominator)) return std::numeric_limits<double>::infinity();
      const double error = fit.at(points_[i]) - targets_[i];
      square += error * error;
    }
    return std::sqrt(square / double(points_.size()));
  }

 private:
  template <typename MakeRow>
  Vector7d solve(const MakeRow& make_row) const {
    Matrix7d normal = Matrix7d::Zero();
    Vector7d right = Vector7d::Zero(), row;
    double value = 0;
    for (std::size_t i = 0; i < points_.size(); ++i) {
      make_row(i, row, value);
      normal.selfadjointView<Eigen::Lower>().rankUpdate(row);
      right += row * value;
    }
    // What the samples leave open stays at nothing instead of at anything.
    normal.diagonal().array() += 1e-13 * normal.trace();
    return normal.selfadjointView<Eigen::Lower>().ldlt().solve(right);
  }

  const std::vector<Vector3d>& points_;
  const std::vector<double>& targets_;
};

AxisFit fit_axis(const Normalized& data, std::size_t axis) {
  const AxisFitter fitter(data, axis);
  const AxisFit affine = fitter.fit_affine();
  if (affine.rms * data.target_scale_px[axis] < kAffineGoodEnough_px) return affine;
  const AxisFit perspective = fitter.fit_perspective(affine);
  return affine.rms > kClearGain * perspective.rms ? perspective : affine;
}

// Rows n and d of the sensor, for points in metres and targets in pixels.
void denormalize(const Normalized& data, std::size_t axis, const AxisFit& fit, Vector4d& numerator,
                 Vector4d& denominator) {
  const auto for_metres = [&](const Vector4d& w) {
    Vector4d out;
    out.head<3>() = w.head<3>() / data.scale_m;
    out.w() = w.w() - out.head<3>().dot(data.center);
    return out;
  };
  const Vector4d d = fit.denominator.homogeneous();
  denominator = for_metres(d);
  numerator = for_metres(data.target_scale_px[axis] * fit.numerator + data.target_center[axis] * d);
}

// Fills what `known` does not mark: averages over ever larger blocks, then back down ("push-pull": Gortler et al.
// 1996).
void fill_unknown(int width, int height, std::vector<Eigen::Vector2f>& values, std::vector<std::uint8_t>& known) {
  if (std::find(known.begin(), known.end(), std::uint8_t{0}) == known.end() || (width <= 1 && height <= 1)) return;
  const int w = (width + 1) / 2, h = (height + 1) / 2;
  const auto fine = [&](int u, int v) { return std::size_t(v) * std::size_t(width) + std::size_t(u); };
  const auto coarse = [&](int u, int v) { return std::size_t(v) * std::size_t(w) + std::size_t(u); };
  std::vector<Eigen::Vector2f> mean(std::size_t(w) * std::size_t(h), Eigen::Vector2f::Zero());
  std::vector<std::uint8_t> mean_known(mean.size(), 0);
  std::vector<std::uint8_t> counts(mean.size(), 0);
  for (int v = 0; v < height; ++v)
    for (int u = 0; u < width; ++u) {
      if (!known[fine(u, v)]) continue;
      mean[coarse(u / 2, v / 2)] += values[fine(u, v)];
      ++counts[coarse(u / 2, v / 2)];
    }
  for (std::size_t i = 0; i < mean.size(); ++i) {
    if (counts[i] > 0) mean[i] /= float(counts[i]);
    mean_known[i] = counts[i] > 0;
  }
  fill_unknown(w, h, mean, mean_known);
  for (int v = 0; v < height; ++v)
    for (int u = 0; u < width; ++u) {
      if (known[fine(u, v)]) continue;
      // Bilinear between block centres, which lie at 2i + 0.5.
      const float x = std::clamp(0.5f * float(u) - 0.25f, 0.0f, float(w - 1));
      const float y = std::clamp(0.5f * float(v) - 0.25f, 0.0f, float(h - 1));
      const int x0 = int(x), y0 = int(y), x1 = std::min(x0 + 1, w - 1), y1 = std::min(y0 + 1, h - 1);
      const float a = x - float(x0), b = y - float(y0);
      values[fine(u, v)] = (1 - b) * ((1 - a) * mean[coarse(x0, y0)] + a * mean[coarse(x1, y0)]) +
                           b * ((1 - a) * mean[coarse(x0, y1)] + a * mean[coarse(x1, y1)]);
    }
  std::fill(known.begin(), known.end(), std::uint8_t{1});
}

Eigen::Vector2d rational_at(const MeasuredGridSensor& sensor, const Vector3d& p) {
  const Vector4d h = p.homogeneous();
  return {sensor.rational[0].dot(h) / sensor.rational[1].dot(h), sensor.rational[2].dot(h) / sensor.rational[3].dot(h)};
}

// Along the ray through a sample, unnormalised: its sign is the same for all samples.
Vector3d ray_at(const MeasuredGridSensor& sensor, const Vector3d& p) {
  const Eigen::Vector2d q = rational_at(sensor, p);
  return (sensor.rational[0] - q.x() * sensor.rational[1])
      .head<3>()
      .cross((sensor.rational[2] - q.y() * sensor.rational[3]).head<3>());
}

void set_forward(MeasuredGridSensor& sensor, const Normalized& data, const Vector3d& toward_scene) {
  Vector3d sum = Vector3d::Zero();
  for (const Vector3d& p : data.points) sum += ray_at(sensor, data.center + data.scale_m * p).normalized();
  const double length = sum.norm();
  if (!(length > 0.1 * double(data.points.size()))) reject("the rays through the samples have no common direction");
  sensor.forward = sum / length;
  if (sensor.forward.dot(toward_scene) < 0) sensor.forward = -sensor.forward;
  const Vector3d columns = sensor.rational[0].head<3>().cross(sensor.forward);
  const Vector3d rows = sensor.rational[2].head<3>().cross(sensor.forward);
  if (!(columns.cross(rows).norm() > 1e-6 * columns.norm() * rows.norm()))
    reject("columns and rows of the grid run in one direction");
}

// Zero range lies one diagonal of the samples' box before the nearest one, but not before the place where rays meet:
// a measurement cannot come from behind the sensor.
void set_range_offset(MeasuredGridSensor& sensor, const std::vector<Vector3d>& points,
                      const std::vector<std::size_t>& valid) {
  Eigen::AlignedBox3d box;
  double nearest = std::numeric_limits<double>::infinity(), meeting = -nearest;
  for (const std::size_t i : valid) {
    const Vector3d& p = points[i];
    box.extend(p);
    const double depth = sensor.forward.dot(p);
    nearest = std::min(nearest, depth);
    Vector3d ray = ray_at(sensor, p);
    ray /= ray.dot(sensor.forward);
    for (const std::size_t row : {1, 3}) {
      const double growth = sensor.rational[row].head<3>().dot(ray);
      // Parallel rays meet nowhere; a denominator that falls along the ray has its zero behind the scene.
      if (growth > 0) meeting = std::max(meeting, depth - sensor.rational[row].dot(p.homogeneous()) / growth);
    }
  }
  const double zero = std::max(nearest - box.diagonal().norm(), meeting);
  sensor.range_offset_m = -std::min(zero, nearest - 1e-3 * box.diagonal().norm());
}

}  // namespace

MeasuredGrid fit_measured_grid(int width, int height, const std::vector<Vector3d>& points_m,
                               const Vector3d& toward_scene) {
  if (width <= 0 || height <= 0 || points_m.size() != std::size_t(width) * std::size_t(height))
    reject("their number is not width times height");
  std::vector<std::size_t> valid;
  for (std::size_t i = 0; i < points_m.size(); ++i)
    if (points_m[i].allFinite()) valid.push_back(i);
  if (valid.size() < kMinSamples) reject("fewer than " + std::to_string(kMinSamples) + " samples");

  const Normalized data = normalize(width, points_m, valid);
  check_spread(data);
  MeasuredGrid out;
  MeasuredGridSensor& sensor = out.sensor;
  sensor.width = width;
  sensor.height = height;
  for (std::size_t axis = 0; axis < 2; ++axis)
    denormalize(data, axis, fit_axis(data, axis), sensor.rational[2 * axis], sensor.rational[2 * axis + 1]);
  // Outliers that the fit did not see may lie behind it; no ray leads there.
  std::erase_if(valid, [&](std::size_t i) {
    const Vector4d h = points_m[i].homogeneous();
    return !(sensor.rational[1].dot(h) > 0) || !(sensor.rational[3].dot(h) > 0);
  });
  set_forward(sensor, data, toward_scene);
  set_range_offset(sensor, points_m, valid);

  out.range = RangeImage(width, height, kInvalidRange);
  sensor.warp.assign(points_m.size(), Eigen::Vector2f::Zero());
  std::vector<std::uint8_t> known(points_m.size(), 0);
  double square = 0;
  for (const std::size_t i : valid) {
    const Eigen::Vector2d pixel(double(i % std::size_t(width)), double(i / std::size_t(width)));
    const Eigen::Vector2d left_over = rational_at(sensor, points_m[i]) - pixel;
    square += left_over.squaredNorm();
    sensor.warp[i] = left_over.cast<float>();
    known[i] = 1;
    out.range.pixels[i] = float(sensor.forward.dot(points_m[i]) + sensor.range_offset_m);
  }
  sensor.fit_rms_px = std::sqrt(square / double(valid.size()));
  if (!(sensor.fit_rms_px < kLargestRelativeRms * std::max(width, height)))
    reject("they follow no perspective, parallel or push-broom projection");
  fill_unknown(width, height, sensor.warp, known);
  return out;
}

}  // namespace lapseam
