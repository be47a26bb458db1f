// Scanners that turn or tilt a line of samples count lines, or read an encoder: slack, an uneven drive and lines that
// were lost put whole lines where they are not. A line by itself is right, so that planes tell its angle. After
// J. Elseberg, D. Borrmann, A. Nüchter, Algorithmic solutions for computing precise maximum likelihood 3D point clouds
// from mobile laser scanning platforms, 2013 (small corrections along a scan); here one angle per line, one pose per
// view, and planes in place of closest points.

#include "register/line_angles.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "core/parallel.h"

namespace lapseam {
namespace {

// Lines are held to their neighbours as firmly as one of these shares of what is known of a line on average: the one by
// which halves of the samples predict each other best.
constexpr std::array<double, 6> kSmooth = {0.001, 0.01, 0.1, 1, 10, 100};
// All lines by the same angle is the pose turned about the axis, and a floor may be deeper where lines are steeper:
// lines are held to where the scanner says they are by this share of that.
constexpr double kStay = 0.1;
// Of the misfit of the other half of the samples: what is predicted less well is chance.
constexpr double kLeastGain = 0.01;
// Samples of a line belong to either half in runs, so that each half sees all around, and neighbours, whose errors are
// alike, are mostly on one side.
constexpr int kRuns = 8;
// Samples of a line that take part.
constexpr int kOfALine = 180;
// Lines that move need steps to bring in what they are off by: planes reach this much less far each time, at most.
constexpr double kNarrowing = 0.7;
// Share of the samples that their lines move less than the others.
constexpr double kLongLever = 0.9;
// Lines keep their order, and this share of their mean step.
constexpr double kLeastStep = 0.125;
// Planes reach no farther than their samples ask for, when that is this share of what they reached before.
constexpr double kSettled = 0.9;
// Lines that move by less than this share of their step have arrived.
constexpr double kStill = 0.1;

// A sample on a plane. World axes.
struct Sample {
  Eigen::Vector3f point = Eigen::Vector3f::Zero();
  std::uint32_t line = 0, plane = 0, half = 0;
  float residual_m = 0;
  float lever_m = 0;  // how far its line's angle moves it across the plane, per radian
  double weight = 0;
};

// A plane that may tilt about a point of it.
struct Support {
  Plane plane;
  Eigen::Vector3d center = Eigen::Vector3d::Zero(), e1 = Eigen::Vector3d::Zero(), e2 = Eigen::Vector3d::Zero();
};

// Normal equations of one view's samples: lines, which touch no other line, and a border of what lines share: the pose,
// then three per plane.
struct System {
  Eigen::VectorXd lines, line_g;  // diagonal; gradient
  Eigen::MatrixXd border;         // rows: shared, columns: lines
  Eigen::MatrixXd shared;
  Eigen::VectorXd shared_g;
  double misfit = 0;

  System(Eigen::Index n, Eigen::Index m)
      : lines(Eigen::VectorXd::Zero(n)),
        line_g(Eigen::VectorXd::Zero(n)),
        border(Eigen::MatrixXd::Zero(m, n)),
        shared(Eigen::MatrixXd::Zero(m, m)),
        shared_g(Eigen::VectorXd::Zero(m)) {}
  double change(const Eigen::VectorXd& line_x, const Vector6d& pose_x) const {
    const auto B = border.topRows<6>();
    return 2 * line_g.dot(line_x) + line_x.dot(lines.cwiseProduct(line_x)) + 2 * shared_g.head<6>().dot(pose_x) +
           pose_x.dot(shared.topLeftCorner<6, 6>() * pose_x) + 2 * pose_x.dot(B * line_x);
  }
};

// (diagonal, with neighbours coupled by −held) x = each column of b; Thomas 1949.
Eigen::MatrixXd solve_chain(Eigen::VectorXd diagonal, double held, Eigen::MatrixXd b) {
  const Eigen::Index n = diagonal.size();
  for (Eigen::Index i = 1; i < n; ++i) {
    const double f = held / diagonal[i - 1];
    diagonal[i] -= f * held;
    b.row(i) += f * b.row(i - 1);
  }
  for (Eigen::Index i = n - 1; i >= 0; --i) {
    if (i + 1 < n) b.row(i) += held * b.row(i + 1);
    b.row(i) /= diagonal[i];
  }
  return b;
}

// A system of which the lines are eliminated, held to their neighbours by their offsets in all.
struct Reduced {
  Eigen::MatrixXd shared;  // what is left for what lines share
  Eigen::VectorXd shared_g;
  Eigen::MatrixXd of_lines;  // lines = −of_lines.col(0) − of_lines.rightCols · shared step
};

Reduced reduce(const System& system, const Eigen::VectorXd& now, double smooth) {
  const Eigen::Index n = now.size(), m = system.shared_g.size();
  const double held = smooth * system.lines.sum() / double(std::max<Eigen::Index>(1, n));
  Eigen::VectorXd diagonal = system.lines.array() + kStay * held + 1e-9;
  Eigen::MatrixXd right(n, m + 1);
  right.col(0) = system.line_g + kStay * held * now;
  right.rightCols(m) = system.border.transpose();
  for (Eigen::Index i = 0; i + 1 < n; ++i) {
    diagonal[i] += held;
    diagonal[i + 1] += held;
    right(i, 0) += held * (now[i] - now[i + 1]);
    right(i + 1, 0) += held * (now[i + 1] - now[i]);
  }
  Reduced out;
  out.of_lines = solve_chain(diagonal, held, right);
  out.shared = system.shared - system.border * out.of_lines.rightCols(m);
  out.shared_g = system.shared_g - system.border * out.of_lines.col(0);
  return out;
}

class LineFinder {
 public:
  LineFinder(std::span<const LineView> views, std::span<const Posed> posed, double prior_m, LineAngles& angles)
      : views_(views), posed_(posed), prior_m_(prior_m), angles_(angles), samples_(views.size()) {
    angles.offsets_rad.resize(views.size());
    angles.firmness.resize(views.size());
    for (std::size_t i = 0; i < views.size(); ++i) {
      const std::vector<double>& offsets = angles.offsets_rad[i];
      const int lines = scanner(i) ? scanner(i)->columns() : 0;
      Eigen::VectorXd now = Eigen::VectorXd::Zero(lines);
      for (int c = 0; c < lines && !offsets.empty(); ++c) now[c] = offsets[std::size_t(c)];
      now_.push_back(std::move(now));
    }
  }

  // Each sample to the plane that is nearest.
  void assign(Context& context) {
    if (angles_.first_reach_m == 0) angles_.first_reach_m = angles_.reach_m;
    if (angles_.planes.empty()) angles_.planes = find_planes(posed_, angles_.reach_m);
    for (const Plane& plane : angles_.planes) {
      Support support{plane, Eigen::Vector3d::Zero(), plane.normal.unitOrthogonal(), Eigen::Vector3d::Zero()};
      support.e2 = plane.normal.cross(support.e1);
      planes_.push_back(support);
    }
    parallel_for(context, views_.size(), 1, [&](std::size_t i) { collect(i); });
    std::vector<double> count(planes_.size());
    for (const auto& samples : samples_)
      for (const Sample& sample : samples) {
        planes_[sample.plane].center += sample.point.cast<double>();
        ++count[sample.plane];
      }
    for (std::size_t p = 0; p < planes_.size(); ++p) planes_[p].center /= std::max(1.0, count[p]);
    weigh();
  }

  LineStep run(Context& context) {
    const std::size_t n = views_.size();
    std::vector<double>& smooth = angles_.firmness;
    LineStep out;
    out.motion.assign(n, Vector6d::Zero());
    const auto none = [&] { return std::all_of(smooth.begin(), smooth.end(), [](double held) { return held == 0; }); };
    const bool had_none = none();
    if (angles_.has_settled)
      parallel_for(context, n, 1, [&](std::size_t i) {
        const double best = firmness(i);
        if (best > 0) smooth[i] = best;
      });
    if (angles_.has_settled && none()) {
      out.is_last = true;
      return out;
    }
    const auto border = Eigen::Index(6 + 3 * planes_.size());
    std::vector<Reduced> reduced(n);
    parallel_for(context, n, 1, [&](std::size_t i) { reduced[i] = reduced_of(i, smooth[i]); });
    const auto m = Eigen::Index(6 * n), planes = border - 6;
    Eigen::MatrixXd H = Eigen::MatrixXd::Zero(m + planes, m + planes);
    Eigen::VectorXd g = Eigen::VectorXd::Zero(m + planes);
    for (std::size_t i = 0; i < n; ++i) {
      const auto at = Eigen::Index(6 * i);
      H.block<6, 6>(at, at) += reduced[i].shared.topLeftCorner<6, 6>();
      H.block<6, 6>(at, at).diagonal() += prior_of(i);
      H.block(at, m, 6, planes) += reduced[i].shared.topRightCorner(6, planes);
      H.block(m, at, planes, 6) += reduced[i].shared.bottomLeftCorner(planes, 6);
      H.bottomRightCorner(planes, planes) += reduced[i].shared.bottomRightCorner(planes, planes);
      out.known.emplace_back(reduced[i].shared.topLeftCorner<6, 6>());
      g.segment<6>(at) += reduced[i].shared_g.head<6>();
      g.tail(planes) += reduced[i].shared_g.tail(planes);
    }
    H.diagonal().tail(planes).array() += 1e-9 * H.diagonal().maxCoeff();  // planes that nothing lies on any more
    const Eigen::VectorXd x = H.ldlt().solve(-g);
    double moved = 0;
    for (std::size_t i = 0; i < n; ++i) {
      out.motion[i] = x.segment<6>(Eigen::Index(6 * i));
      Eigen::VectorXd of_shared(border);
      of_shared << out.motion[i], x.tail(planes);
      if (smooth[i] > 0)
        moved = std::max(moved,
                         move_lines(i, -reduced[i].of_lines.col(0) - reduced[i].of_lines.rightCols(border) * of_shared,
                                    angles_.offsets_rad[i]));
    }
    for (std::size_t p = 0; p < planes_.size(); ++p) move_plane(p, x.segment<3>(m + Eigen::Index(3 * p)));
    out.is_last = angles_.has_settled && moved < kStill;
    if (had_none && !none()) {  // what lines bent out of reach may belong to planes after all
      angles_.reach_m = angles_.first_reach_m;
      angles_.reach_rad = std::numbers::pi;
      angles_.planes.clear();
      out.is_last = false;
    }
    return out;
  }

 private:
  // By how far most samples are: what noise does shows where the angle of a line does not matter, and what angles do on
  // the tenth that they move farthest. Grazing lines on far floors would be lost by one spread for all.
  void weigh() {
    std::vector<float> levers;
    for (const auto& samples : samples_)
      for (const Sample& sample : samples) levers.push_back(sample.lever_m);
    if (levers.empty()) return;
    const auto half = levers.begin() + std::ptrdiff_t(levers.size() / 2);
    std::nth_element(levers.begin(), half, levers.end());
    const float short_m = *half;
    const auto tenth = levers.begin() + std::ptrdiff_t(kLongLever * double(levers.size()));
    std::nth_element(levers.begin(), tenth, levers.end());
    const float long_m = *tenth;
    std::vector<double> near, angles;
    for (const auto& samples : samples_)
      for (const Sample& sample : samples) {
        const double r = std::abs(double(sample.residual_m));
        if (sample.lever_m <= short_m) near.push_back(r);
        if (sample.lever_m >= long_m && long_m > 0) angles.push_back(r / double(sample.lever_m));
      }
    const bool is_moving =
        std::any_of(angles_.firmness.begin(), angles_.firmness.end(), [](double held) { return held > 0; });
    const double closing = is_moving ? kNarrowing / kTukey : 0;
    const double scale_m = std::max(closing * angles_.reach_m, kNormalPerMedian * middle(near));
    const double scale_rad = kNormalPerMedian * middle(angles);
    for (auto& samples : samples_)
      for (Sample& sample : samples) {
        const double scale = std::hypot(scale_m, scale_rad * double(sample.lever_m));
        sample.weight = tukey(double(sample.residual_m), kTukey * scale) / (scale * scale);
      }
    const double reach_m = std::min(angles_.reach_m, kTukey * scale_m);
    const double reach_rad = std::min(angles_.reach_rad, kTukey * scale_rad);
    if (reach_m > kSettled * angles_.reach_m && reach_rad >= kSettled * angles_.reach_rad) angles_.has_settled = true;
    angles_.reach_m = reach_m;
    angles_.reach_rad = reach_rad;
  }

  double reach_of(double lever_m) const {
    return std::min(angles_.first_reach_m, std::hypot(angles_.reach_m, angles_.reach_rad * lever_m));
  }

  void move_plane(std::size_t p, const Eigen::Vector3d& by) {
    const Support& support = planes_[p];
    Plane& plane = angles_.planes[p];
    const double at_center = plane.distance_to(support.center) + by.z();
    plane.normal = (plane.normal + by.x() * support.e1 + by.y() * support.e2).normalized();
    plane.offset_m = plane.normal.dot(support.center) - at_center;
  }

  const SphericalSensor* scanner(std::size_t i) const { return std::get_if<SphericalSensor>(&views_[i].view->sensor); }

  Vector6d prior_of(std::size_t i) const {
    Vector6d out = Vector6d::Constant(1 / (prior_m_ * prior_m_));
    out.head<3>() *= views_[i].radius_m * views_[i].radius_m;
    return out;
  }

  void collect(std::size_t i) {
    const View& view = *views_[i].view;
    const Eigen::Isometry3d& T = posed_[i].T_world_view;
    const int stride = std::max(1, view.range.height / kOfALine);
    for (int v = stride / 2; v < view.range.height; v += stride)
      for (int u = 0; u < view.range.width; ++u) {
        const float r = view.range.at(u, v);
        if (!(r > 0)) continue;
        const Eigen::Vector3d p = T * unproject(view.sensor, u, v, double(r));
        const Eigen::Vector3d by_line = T.linear().col(2).cross(p - T.translation());  // per radian
        Sample sample;
        double nearest = 1;  // of what planes reach
        for (std::uint32_t k = 0; k < planes_.size(); ++k) {
          const Plane& plane = planes_[k].plane;
          const double distance = plane.distance_to(p), lever_m = std::abs(plane.normal.dot(by_line));
          const double relative = std::abs(distance) / reach_of(now_[i].size() > 0 ? lever_m : 0);
          if (!(relative < nearest) || plane.distance_to(T.translation()) <= 0) continue;
          nearest = relative;
          sample.plane = k;
          sample.residual_m = float(distance);
          sample.lever_m = now_[i].size() > 0 ? float(lever_m) : 0;
        }
        if (!(nearest < 1)) continue;
        sample.point = p.cast<float>();
        sample.line = std::uint32_t(u);
        sample.half = std::uint32_t(v * kRuns / view.range.height) % 2;
        samples_[i].push_back(sample);
      }
  }

  // All samples of a view, or those of one half.
  System sum(std::size_t i, int half = -1) const {
    const Eigen::Isometry3d& T = posed_[i].T_world_view;
    System out(now_[i].size(), Eigen::Index(6 + 3 * planes_.size()));
    for (const Sample& sample : samples_[i]) {
      if (half >= 0 && int(sample.half) != half) continue;
      const Support& support = planes_[sample.plane];
      const Eigen::Vector3d x = sample.point.cast<double>(), n = support.plane.normal, d = x - support.center;
      const double w = sample.weight, r = double(sample.residual_m);
      const double line = now_[i].size() > 0 ? n.dot(T.linear().col(2).cross(x - T.translation())) : 0;
      Eigen::Matrix<double, 9, 1> J;
      J << (x - views_[i].center).cross(n), n, support.e1.dot(d), support.e2.dot(d), 1;
      if (views_[i].is_fixed) J.head<6>().setZero();
      const auto at = Eigen::Index(6 + 3 * sample.plane);
      const Eigen::Matrix<double, 9, 1> wJ = w * J;
      out.shared.topLeftCorner<6, 6>() += wJ.head<6>() * J.head<6>().transpose();
      out.shared.block<6, 3>(0, at) += wJ.head<6>() * J.tail<3>().transpose();
      out.shared.block<3, 6>(at, 0) += wJ.tail<3>() * J.head<6>().transpose();
      out.shared.block<3, 3>(at, at) += wJ.tail<3>() * J.tail<3>().transpose();
      out.shared_g.head<6>() += r * wJ.head<6>();
      out.shared_g.segment<3>(at) += r * wJ.tail<3>();
      out.misfit += w * r * r;
      if (now_[i].size() == 0) continue;
      out.lines[sample.line] += w * line * line;
      out.line_g[sample.line] += w * line * r;
      out.border.col(sample.line).head<6>() += line * wJ.head<6>();
      out.border.col(sample.line).segment<3>(at) += line * wJ.tail<3>();
    }
    return out;
  }

  Reduced reduced_of(std::size_t i, double smooth) const {
    System system = sum(i);
    if (smooth > 0) return reduce(system, now_[i], smooth);
    return {system.shared, system.shared_g, {}};
  }

  // How firmly lines are to be held so that what one half shows of them brings the other one closer, beyond what the
  // pose alone does; 0: they do not. Planes stay.
  double firmness(std::size_t i) const {
    if (now_[i].size() < 3) return 0;
    const std::array<System, 2> half = {sum(i, 0), sum(i, 1)};
    const Eigen::Matrix<double, 6, 6> prior = prior_of(i).asDiagonal();
    double best = 0, most = kLeastGain;
    for (const double smooth : kSmooth) {
      double least = 1;
      for (const std::size_t k : {0, 1}) {
        const System &from = half[k], &to = half[1 - k];
        const Vector6d pose =
            (from.shared.topLeftCorner<6, 6>() + prior).ldlt().solve(-Vector6d(from.shared_g.head<6>()));
        const Reduced reduced = reduce(from, now_[i], smooth);
        const Vector6d with =
            (reduced.shared.topLeftCorner<6, 6>() + prior).ldlt().solve(-Vector6d(reduced.shared_g.head<6>()));
        const Eigen::VectorXd lines = -reduced.of_lines.col(0) - reduced.of_lines.middleCols<6>(1) * with;
        const double gain = to.change(Eigen::VectorXd::Zero(lines.size()), pose) - to.change(lines, with);
        if (to.misfit > 0) least = std::min(least, gain / to.misfit);
      }
      if (!(least > most)) continue;
      most = least;
      best = smooth;
    }
    return best;
  }

  // Returns how far, in steps of lines.
  double move_lines(std::size_t i, const Eigen::VectorXd& by, std::vector<double>& offsets_rad) const {
    const std::vector<double>& now = scanner(i)->azimuth_rad;
    std::vector<double> azimuth = now;
    for (std::size_t c = 0; c < azimuth.size(); ++c) azimuth[c] += by[Eigen::Index(c)];
    keep_order(azimuth);
    // A full circle stays one.
    const double span = std::abs(azimuth.back() - azimuth.front());
    if (span * (1 + kLeastStep / double(azimuth.size())) > 2 * std::numbers::pi) return 0;
    offsets_rad.resize(azimuth.size());
    double farthest = 0;
    for (std::size_t c = 0; c < azimuth.size(); ++c) {
      offsets_rad[c] += azimuth[c] - now[c];
      farthest = std::max(farthest, std::abs(azimuth[c] - now[c]));
    }
    return farthest / span * double(azimuth.size() - 1);
  }

  // Nearest in least squares (pool adjacent violators: Ayer et al. 1955).
  static void keep_order(std::vector<double>& angles) {
    const double mean_step = (angles.back() - angles.front()) / double(angles.size() - 1);
    const double least = kLeastStep * mean_step, sign = mean_step < 0 ? -1 : 1;
    struct Pool {
      double sum = 0;
      std::size_t count = 0;
      double mean() const { return sum / double(count); }
    };
    std::vector<Pool> pools;
    for (std::size_t i = 0; i < angles.size(); ++i) {
      pools.push_back({sign * (angles[i] - double(i) * least), 1});
      while (pools.size() > 1 && pools.back().mean() < pools[pools.size() - 2].mean()) {
        const Pool last = pools.back();
        pools.pop_back();
        pools.back().sum += last.sum;
        pools.back().count += last.count;
      }
    }
    std::size_t i = 0;
    for (const Pool& pool : pools)
      for (std::size_t k = 0; k < pool.count; ++k, ++i) angles[i] = sign * pool.mean() + double(i) * least;
  }

  std::span<const LineView> views_;
  std::span<const Posed> posed_;
  const double prior_m_;
  LineAngles& angles_;
  std::vector<Eigen::VectorXd> now_;  // offsets so far; no lines: not a scanner
  std::vector<Support> planes_;
  std::vector<std::vector<Sample>> samples_;
};

}  // namespace

SphericalSensor corrected(const SphericalSensor& sensor, std::span<const double> offset_rad) {
  SphericalSensor out = sensor;
  for (std::size_t c = 0; c < out.azimuth_rad.size() && c < offset_rad.size(); ++c) out.azimuth_rad[c] += offset_rad[c];
  return out;
}

LineStep find_line_angles(std::span<const LineView> views, std::span<const Posed> posed, double prior_m,
                          LineAngles& angles, Context& context) {
  LineFinder finder(views, posed, prior_m, angles);
  finder.assign(context);
  return finder.run(context);
}

}  // namespace lapseam
