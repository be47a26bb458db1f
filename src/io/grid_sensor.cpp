#include "io/grid_sensor.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <optional>

#include "core/parallel.h"

namespace lapseam {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

constexpr double kTwoPi = 2 * std::numbers::pi;
// Below this, pixels look where the model says: 2 % of the distance between samples is far below their noise.
constexpr double kExact_px = 0.02;
// A polar scanner whose samples stray farther from their rows and columns is none.
constexpr double kLargestStray_px = 4;
constexpr std::size_t kMinSamples = 16;

/// Into −π … π; what is there already stays as it is, and the slow function is not called.
double wrapped(double angle_rad) {
  return std::abs(angle_rad) <= std::numbers::pi ? angle_rad : std::remainder(angle_rad, kTwoPi);
}

/// Weighted mean and spread about it of angles in one row or column, as they come (West 1979).
struct Angle {
  double mean_rad = 0, weight = 0, square = 0;

  void add(double angle_rad, double w) {
    if (!(w > 0)) return;
    weight += w;
    const double off = wrapped(angle_rad - mean_rad), shift = off * (w / weight);
    mean_rad += shift;
    square += w * off * (off - shift);
  }

  /// What the other one has seen, too (Chan, Golub and LeVeque 1983).
  void add(const Angle& other) {
    if (!(other.weight > 0)) return;
    if (!(weight > 0)) {
      *this = other;
      return;
    }
    const double off = wrapped(other.mean_rad - mean_rad), shift = off * (other.weight / (weight + other.weight));
    square += other.square + weight * off * shift;
    mean_rad += shift;
    weight += other.weight;
  }
};

/// Least squares of t = scale · s + offset, as the pairs come, and what it leaves over.
struct Line {
  double n = 0, mean_s = 0, mean_t = 0, ss = 0, st = 0, tt = 0;

  void add(double s, double t) {
    n += 1;
    const double ds = s - mean_s, dt = t - mean_t;
    mean_s += ds / n;
    mean_t += dt / n;
    ss += ds * (s - mean_s);
    st += ds * (t - mean_t);
    tt += dt * (t - mean_t);
  }
  void add(const Line& other) {
    if (other.n == 0) return;
    const double ds = other.mean_s - mean_s, dt = other.mean_t - mean_t, share = other.n / (n + other.n);
    ss += other.ss + n * share * ds * ds;
    st += other.st + n * share * ds * dt;
    tt += other.tt + n * share * dt * dt;
    mean_s += share * ds;
    mean_t += share * dt;
    n += other.n;
  }
  double scale() const { return st / ss; }
  double offset() const { return mean_t - scale() * mean_s; }
  double rms() const { return ss > 0 ? std::sqrt(std::max(0.0, tt - st * st / ss) / n) : 1e300; }
};

/// Angles of a row or column table: means, gaps filled evenly, made continuous across the turn.
std::optional<std::vector<double>> to_table(const std::vector<Angle>& angles) {
  std::vector<double> table(angles.size());
  std::vector<std::size_t> known;
  for (std::size_t i = 0; i < angles.size(); ++i) {
    if (!(angles[i].weight > 0)) continue;
    table[i] = angles[i].mean_rad;
    if (!known.empty()) {
      const double before = table[known.back()];
      const double turned = before + wrapped(table[i] - before);
      // The angle itself where it is continuous as it is: adding differences would cost its last bits.
      if (std::abs(turned - table[i]) > 1) table[i] += kTwoPi * std::round((turned - table[i]) / kTwoPi);
    }
    known.push_back(i);
  }
  if (known.size() < 2) return std::nullopt;
  const std::size_t first = known.front(), last = known.back();
  const double step = (table[last] - table[first]) / double(last - first);
  for (std::size_t i = 0; i < first; ++i) table[i] = table[first] - step * double(first - i);
  for (std::size_t i = last + 1; i < table.size(); ++i) table[i] = table[last] + step * double(i - last);
  for (std::size_t k = 1; k < known.size(); ++k) {
    const std::size_t a = known[k - 1], b = known[k];
    for (std::size_t i = a + 1; i < b; ++i) table[i] = table[a] + (table[b] - table[a]) * double(i - a) / double(b - a);
  }
  return table;
}

bool is_monotone(const std::vector<double>& table) {
  const double sign = table.back() > table.front() ? 1 : -1;
  for (std::size_t i = 1; i < table.size(); ++i)
    if (!(sign * (table[i] - table[i - 1]) > 0)) return false;
  return true;
}

/// An even table where single rows or columns stray past one another.
void make_monotone(std::vector<double>& table) {
  if (is_monotone(table)) return;
  Line line;
  for (std::size_t i = 0; i < table.size(); ++i) line.add(double(i), table[i]);
  for (std::size_t i = 0; i < table.size(); ++i) table[i] = line.offset() + line.scale() * double(i);
}

double mean_step(const std::vector<double>& table) {
  return std::abs(table.back() - table.front()) / double(table.size() - 1);
}

/// Where the tables put a direction, seen from pixel (u, v): on a full circle, the turn that is nearest.
Vector2d place(const SphericalSensor& tables, bool is_circle, const GridSample& sample) {
  PixelRange found;
  if (sample.is_polar) {
    const double level = std::cos(sample.stored.y());
    tables.project(
        {level * std::cos(sample.stored.x()), level * std::sin(sample.stored.x()), std::sin(sample.stored.y())}, found);
  } else {
    tables.project(sample.stored, found);
  }
  double du = found.u - sample.u;
  if (is_circle) du = std::remainder(du, double(tables.columns()));
  return {du, found.v - sample.v};
}

void add_warp(SphericalSensor& sensor, const SamplePieces& samples, Context& context) {
  auto warp = std::make_shared<std::vector<Eigen::Vector2f>>(std::size_t(sensor.columns()) * std::size_t(sensor.rows()),
                                                             Eigen::Vector2f::Zero());
  const bool is_circle = sensor.wraps();
  parallel_for(context, samples.count, 1, [&](std::size_t piece) {
    samples.visit(piece, [&](const GridSample& sample) {
      const std::size_t i = std::size_t(sample.v) * std::size_t(sensor.columns()) + std::size_t(sample.u);
      (*warp)[i] = place(sensor, is_circle, sample).cast<float>();
    });
  });
  sensor.warp = std::move(warp);
}

class Fitter {
 public:
  explicit Fitter(ImageSize size)
      : size_(size), azimuths_(std::size_t(size.width)), elevations_(std::size_t(size.height)) {}

  void add(const GridSample& sample) {
    ++count_;
    const Vector3d polar = sample.polar();
    // Near the zenith azimuths mean little; their weight is the distance that they make.
    azimuths_[std::size_t(sample.u)].add(polar.x(), square_of_level(sample));
    elevations_[std::size_t(sample.v)].add(polar.y(), 1);
    if (!is_before_camera_) return;
    const Vector3d p = sample.point_m();
    is_before_camera_ = p.z() > 0;
    if (!is_before_camera_) return;
    columns_.add(p.x() / p.z(), sample.u);
    rows_.add(p.y() / p.z(), sample.v);
  }

  void add(const Fitter& other) {
    count_ += other.count_;
    for (std::size_t u = 0; u < azimuths_.size(); ++u) azimuths_[u].add(other.azimuths_[u]);
    for (std::size_t v = 0; v < elevations_.size(); ++v) elevations_[v].add(other.elevations_[v]);
    is_before_camera_ = is_before_camera_ && other.is_before_camera_;
    columns_.add(other.columns_);
    rows_.add(other.rows_);
  }

  std::size_t count() const { return count_; }

  std::optional<Sensor> pinhole() const {
    if (!is_before_camera_ || !(columns_.rms() < kExact_px) || !(rows_.rms() < kExact_px)) return std::nullopt;
    if (!(columns_.scale() > 0) || !(rows_.scale() > 0)) return std::nullopt;
    return PinholeSensor{size_.width, size_.height, columns_.scale(), rows_.scale(), columns_.offset(), rows_.offset(),
                         {}};
  }

  /// The tables, and how far samples stray from them (rms, pixels).
  std::optional<SphericalSensor> polar(double& stray_px) const {
    if (size_.width < 2 || size_.height < 2) return std::nullopt;
    auto azimuth_rad = to_table(azimuths_), elevation_rad = to_table(elevations_);
    if (!azimuth_rad || !elevation_rad) return std::nullopt;
    // More than a turn, or rows over the top and down behind, are no such grid.
    if (std::abs(azimuth_rad->back() - azimuth_rad->front()) > kTwoPi + 0.5 * mean_step(*azimuth_rad))
      return std::nullopt;
    make_monotone(*azimuth_rad);
    make_monotone(*elevation_rad);
    if (!is_monotone(*azimuth_rad) || !is_monotone(*elevation_rad)) return std::nullopt;
    const double azimuth_px = spread(azimuths_, *azimuth_rad), elevation_px = spread(elevations_, *elevation_rad);
    stray_px = std::max(azimuth_px, elevation_px);
    return SphericalSensor{std::move(*azimuth_rad), std::move(*elevation_rad)};
  }

 private:
  /// cos² of the elevation.
  static double square_of_level(const GridSample& sample) {
    if (!sample.is_polar) return sample.stored.head<2>().squaredNorm() / sample.stored.squaredNorm();
    const double level = std::cos(sample.stored.y());
    return level * level;
  }

  double spread(const std::vector<Angle>& angles, const std::vector<double>& table) const {
    double square = 0;
    for (std::size_t i = 0; i < angles.size(); ++i) {
      const double off = angles[i].weight > 0 ? wrapped(angles[i].mean_rad - table[i]) : 0;
      square += angles[i].square + angles[i].weight * off * off;
    }
    return std::sqrt(square / double(std::max<std::size_t>(count_, 1))) / mean_step(table);
  }

  ImageSize size_;
  std::size_t count_ = 0;
  std::vector<Angle> azimuths_, elevations_;
  bool is_before_camera_ = true;
  Line columns_, rows_;
};

Sensor fit_measured(const Source& source, ImageSize size, const SamplePieces& samples) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  std::vector<Vector3d> points_m(std::size_t(size.width) * std::size_t(size.height), Vector3d(nan, nan, nan));
  Vector3d sum = Vector3d::Zero();
  for (std::size_t piece = 0; piece < samples.count; ++piece) {
    samples.visit(piece, [&](const GridSample& sample) {
      const Vector3d p = sample.point_m();
      points_m[std::size_t(sample.v) * std::size_t(size.width) + std::size_t(sample.u)] = p;
      sum += p.normalized();
    });
  }
  try {
    return fit_measured_grid(size.width, size.height, points_m, sum).sensor;
  } catch (const InvalidInput& error) {
    std::string problem = error.what();
    if (problem.starts_with("points: ")) problem.erase(0, 8);
    source.refuse("points", "rows and columns are neither a camera's nor a polar scanner's, and " + problem);
  }
}

}  // namespace

Vector3d GridSample::point_m() const {
  if (!is_polar) return stored;
  const double level = stored.z() * std::cos(stored.y());
  return {level * std::cos(stored.x()), level * std::sin(stored.x()), stored.z() * std::sin(stored.y())};
}

Vector3d GridSample::polar() const {
  if (is_polar) return stored;
  return {std::atan2(stored.y(), stored.x()), std::atan2(stored.z(), std::hypot(stored.x(), stored.y())),
          stored.norm()};
}

Sensor fit_grid_sensor(const Source& source, ImageSize size, const SamplePieces& samples, Context& context) {
  Fitter fitter(size);
  if (samples.count == 1) {
    samples.visit(0, [&](const GridSample& sample) { fitter.add(sample); });
  } else {
    std::vector<Fitter> parts(samples.count, fitter);
    parallel_for(context, samples.count, 1, [&](std::size_t piece) {
      samples.visit(piece, [&](const GridSample& sample) { parts[piece].add(sample); });
    });
    for (const Fitter& part : parts) fitter.add(part);
  }
  if (fitter.count() == 0) source.refuse("points", "there is no valid sample");
  if (fitter.count() < kMinSamples)
    source.refuse("points", "only " + std::to_string(fitter.count()) + " valid samples: too few to tell the sensor");
  if (auto pinhole = fitter.pinhole()) return *pinhole;
  double stray_px = 0;
  if (auto polar = fitter.polar(stray_px); polar && stray_px < kLargestStray_px) {
    if (stray_px > kExact_px) add_warp(*polar, samples, context);
    return *polar;
  }
  return fit_measured(source, size, samples);
}

float range_of(const Sensor& sensor, const GridSample& sample) {
  double r = 0;
  if (std::holds_alternative<SphericalSensor>(sensor))
    r = sample.distance_m();
  else if (const auto* grid = std::get_if<MeasuredGridSensor>(&sensor))
    r = grid->forward.dot(sample.point_m()) + grid->range_offset_m;
  else
    r = sample.point_m().z();
  return r >= double(std::numeric_limits<float>::min()) && r <= double(std::numeric_limits<float>::max()) ? float(r)
                                                                                                          : 0.0f;
}

// ---- points without a grid

namespace {

/// How wide the gap in the azimuths is, so that the image does not begin in the middle of the scene.
double first_azimuth(std::vector<double> azimuths_rad) {
  std::sort(azimuths_rad.begin(), azimuths_rad.end());
  double widest = azimuths_rad.front() + kTwoPi - azimuths_rad.back(), begin = azimuths_rad.front();
  for (std::size_t i = 1; i < azimuths_rad.size(); ++i) {
    const double gap = azimuths_rad[i] - azimuths_rad[i - 1];
    if (gap > widest) {
      widest = gap;
      begin = azimuths_rad[i];
    }
  }
  return begin;
}

struct PolarBox {
  double azimuth = 0, elevation = 0, width = 0, height = 0;  ///< begin and extent, radians
};

std::size_t count_cells(const std::vector<Vector2d>& angles, const PolarBox& box, double step) {
  const std::size_t columns = std::size_t(box.width / step) + 1, rows = std::size_t(box.height / step) + 1;
  std::vector<bool> seen(columns * rows);
  std::size_t cells = 0;
  for (const Vector2d& a : angles) {
    const std::size_t i =
        std::min(std::size_t(a.y() / step), rows - 1) * columns + std::min(std::size_t(a.x() / step), columns - 1);
    cells += !seen[i];
    seen[i] = true;
  }
  return cells;
}

/// The step at which one point falls into a cell that is seen at all: from the area of coarse cells of sixteen each.
double choose_step(const std::vector<Vector2d>& angles, const PolarBox& box) {
  const auto n = double(angles.size());
  double step = std::sqrt(std::max(box.width * box.height, 1e-12) / n);
  for (int pass = 0; pass < 3; ++pass) {
    const double coarse = std::max({4 * step, std::sqrt(box.width * box.height / (n + 64)), 1e-6});
    step = std::sqrt(double(count_cells(angles, box, coarse)) / n) * coarse;
  }
  return step;
}

double median(std::vector<double>& values) {
  const auto middle = values.begin() + std::ptrdiff_t(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

/// Steps of columns and rows. Files mostly hold one line of the scanner after another: then the step from point to
/// point is that along the lines, and the area of a point gives the other one.
Vector2d choose_steps(const std::vector<Vector2d>& angles, const PolarBox& box) {
  const double step = choose_step(angles, box);
  std::vector<double> along_u, along_v;
  for (std::size_t i = 1; i < angles.size(); ++i) {
    along_u.push_back(std::abs(wrapped(angles[i].x() - angles[i - 1].x())));
    along_v.push_back(std::abs(angles[i].y() - angles[i - 1].y()));
  }
  const double u = median(along_u), v = median(along_v);
  const double along = std::max(u, v), across = along > 0 ? step * step / along : 0;
  // Beyond this, the points are in no such order.
  constexpr double kMostUneven = 20;
  if (!(across * kMostUneven > along && along * kMostUneven > across)) return {step, step};
  return u > v ? Vector2d(along, across) : Vector2d(across, along);
}

}  // namespace

SphericalSensor make_polar_grid(const Source& source, std::vector<GridSample>& samples) {
  if (samples.size() < kMinSamples)
    source.refuse("points", "only " + std::to_string(samples.size()) + " valid samples: too few to make a grid of");
  std::vector<double> azimuths_rad;
  std::vector<Vector2d> angles;
  double low = 10, high = -10;
  for (const GridSample& sample : samples) {
    const Vector3d polar = sample.polar();
    azimuths_rad.push_back(polar.x());
    angles.emplace_back(polar.x(), polar.y());
    low = std::min(low, polar.y());
    high = std::max(high, polar.y());
  }
  PolarBox box{first_azimuth(std::move(azimuths_rad)), low, 0, high - low};
  for (Vector2d& a : angles) {
    a.x() -= box.azimuth;
    if (a.x() < 0) a.x() += kTwoPi;
    a.y() -= low;
    box.width = std::max(box.width, a.x());
  }
  const Vector2d steps = choose_steps(angles, box);
  const double columns = std::max(2.0, std::round(box.width / steps.x()) + 1);
  const double rows = std::max(2.0, std::round(box.height / steps.y()) + 1);
  // Empty cells beyond this many a point are no scan.
  constexpr double kCellsPerSample = 64;
  if (!(box.width > 0 && box.height > 0) || columns * rows > kCellsPerSample * double(samples.size()) + 65536)
    source.refuse("points", "have no extent that a polar grid could be laid over");
  const double step_u = box.width / (columns - 1), step_v = box.height / (rows - 1);
  // Rows run down: elevations fall.
  SphericalSensor sensor =
      SphericalSensor::from_limits(int(columns), int(rows), box.azimuth - step_u / 2,
                                   box.azimuth + box.width + step_u / 2, high + step_v / 2, low - step_v / 2);
  std::vector<std::uint32_t> nearest(std::size_t(columns * rows), 0xFFFFFFFFu);
  for (std::size_t k = 0; k < samples.size(); ++k) {
    GridSample& sample = samples[k];
    sample.u = std::clamp(int(std::lround(angles[k].x() / step_u)), 0, int(columns) - 1);
    sample.v = std::clamp(int(rows) - 1 - int(std::lround(angles[k].y() / step_v)), 0, int(rows) - 1);
    std::uint32_t& owner = nearest[std::size_t(sample.v) * std::size_t(columns) + std::size_t(sample.u)];
    if (owner == 0xFFFFFFFFu || sample.distance_m() < samples[owner].distance_m()) {
      if (owner != 0xFFFFFFFFu) samples[owner].u = -1;
      owner = std::uint32_t(k);
    } else {
      sample.u = -1;
    }
  }
  Context context(1);
  const auto visit_all = [&](std::size_t, const VisitSample& visit) {
    for (const GridSample& sample : samples)
      if (sample.u >= 0) visit(sample);
  };
  add_warp(sensor, {1, visit_all}, context);
  return sensor;
}

}  // namespace lapseam
