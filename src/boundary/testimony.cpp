#include "boundary/testimony.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "lapseam/sensor.h"

namespace lapseam {
namespace {

// Flatter looks than this tell little: neighbouring samples differ by more than a step between surfaces may be.
constexpr double kLeastCosine = 0.15;
// The steepest surface that neighbouring samples are believed to be of: tan 76°, as everywhere.
constexpr double kSteepest = 4.0;
// Differences of two ranges, in standard deviations of the difference.
constexpr double kNoiseFactor = 3.5;
const double kSqrt2 = std::sqrt(2.0);
// Registration error is a standard deviation too.
constexpr double kRegistrationFactor = 3.0;
// How far the surface is followed, in sample spacings; and how many of the view's own these may be.
constexpr double kReach_spacings = 2.0;
constexpr double kMostOwnSpacings = 4.0;
// A step along the way: every cell that it crosses, or a neighbour that shares two samples with it, is looked at.
constexpr double kStep_px = 0.7;
// Far more than any crack: nobody walks through half an image.
constexpr int kMostSteps = 64;
// The surface may turn away from the plane of its border by this much per distance: a floor that meets a wall.
constexpr double kMostDrift = 2.0;

}  // namespace

struct Witness::Tolerance {
  double spacing_m;
  double step_m;   ///< between neighbouring samples of one surface
  double agree_m;  ///< between the mesh and the view
};

Witness::Witness(const View& view, const NoiseModel& noise, const Eigen::Vector3d& mesh_origin_m,
                 double registration_error_m)
    : view_(view),
      noise_(noise),
      T_view_mesh_(view.T_world_view.inverse() * Eigen::Translation3d(mesh_origin_m)),
      registration_error_m_(registration_error_m),
      wraps_(wraps(view.sensor)) {
  const double u = 0.5 * (width(view.sensor) - 1), v = 0.5 * (height(view.sensor) - 1);
  const double at_one = sample_spacing(view.sensor, u, v, 1.0), at_two = sample_spacing(view.sensor, u, v, 2.0);
  spacing_slope_ = at_two - at_one;
  spacing_offset_m_ = at_one - spacing_slope_;
}

Eigen::Vector3d Witness::to_view(const Eigen::Vector3f& point_in_mesh) const {
  return T_view_mesh_ * point_in_mesh.cast<double>();
}

float Witness::sample(int u, int v) const {
  if (v < 0 || v >= view_.range.height) return kInvalidRange;
  if (wraps_) u = (u % view_.range.width + view_.range.width) % view_.range.width;
  if (u < 0 || u >= view_.range.width) return kInvalidRange;
  return view_.range.at(u, v);
}

Witness::Tolerance Witness::tolerance_at(double range_m) const {
  const double spacing = spacing_offset_m_ + spacing_slope_ * range_m;
  const double noise = kNoiseFactor * kSqrt2 * noise_.sigma(range_m);
  return {spacing, kSteepest * spacing + noise,
          kSteepest * spacing + noise + kRegistrationFactor * registration_error_m_};
}

bool Witness::is_on_surface(const Eigen::Vector3d& point, const Tolerance& tolerance) const {
  const auto at = project(view_.sensor, point);
  if (!at || std::abs(at->u) > 1e6 || std::abs(at->v) > 1e6) return false;
  const float nearest = sample(int(std::lround(at->u)), int(std::lround(at->v)));
  return nearest > 0 && std::abs(double(nearest) - at->r) <= tolerance.agree_m;
}

Statement Witness::ask(const OutlineFrame& edge) const {
  if (edge.outward.isZero(0)) return {};
  const auto at = project(view_.sensor, to_view(edge.middle));
  if (!at || !(at->u > -1 && at->u < view_.range.width && at->v > -1 && at->v < view_.range.height)) return {};
  const Eigen::Vector3d normal = T_view_mesh_.linear() * edge.normal.cast<double>();
  const double cosine = -normal.dot(ray_direction(view_.sensor, at->u, at->v));
  if (cosine < kLeastCosine) return {};
  const Tolerance tolerance = tolerance_at(at->r);
  if (!is_on_surface(to_view(edge.inside), tolerance)) return {};
  const double reach =
      kReach_spacings * std::clamp(double(edge.side_m), tolerance.spacing_m, kMostOwnSpacings * tolerance.spacing_m);
  const double error = std::hypot(noise_.sigma(at->r), tolerance.spacing_m) / cosine;
  return {follow(edge, tolerance, reach), float(error)};
}

Testimony Witness::follow(const OutlineFrame& edge, const Tolerance& tolerance, double reach_m) const {
  const Eigen::Vector3d middle = to_view(edge.middle);
  const Eigen::Vector3d way = T_view_mesh_.linear() * edge.outward.cast<double>() * reach_m;
  const auto from = project(view_.sensor, middle), to = project(view_.sensor, middle + way);
  if (!from || !to) return Testimony::kNothing;
  double across = to->u - from->u;
  if (wraps_) across -= view_.range.width * std::round(across / view_.range.width);
  const int steps = std::clamp(int(std::ceil(std::hypot(across, to->v - from->v) / kStep_px)), 1, kMostSteps);
  for (int k = 1; k <= steps; ++k) {
    const double share = double(k) / steps;
    const auto at = project(view_.sensor, middle + share * way);
    if (!at) return Testimony::kNothing;
    const Testimony here = look(*at, kMostDrift * share * reach_m, tolerance);
    if (here != Testimony::kGoesOn) return here;
  }
  return Testimony::kGoesOn;
}

Testimony Witness::look(const PixelRange& at, double drift_m, const Tolerance& tolerance) const {
  const int u = int(std::floor(at.u)), v = int(std::floor(at.v));
  // Around the cell, so that neighbours in the list are neighbours in the image.
  const std::array<float, 4> r = {sample(u, v), sample(u + 1, v), sample(u + 1, v + 1), sample(u, v + 1)};
  const double slack = drift_m + tolerance.agree_m;
  bool is_complete = true, is_smooth = true;
  double nearest = std::numeric_limits<double>::infinity(), farthest = 0;
  for (std::size_t k = 0; k < 4; ++k) {
    if (!(r[k] > 0)) {
      is_complete = false;
      continue;
    }
    nearest = std::min(nearest, double(r[k]));
    farthest = std::max(farthest, double(r[k]));
    const float next = r[(k + 1) % 4];
    if (next > 0) is_smooth &= std::abs(double(next - r[k])) <= tolerance.step_m;
  }
  if (farthest == 0 || nearest < at.r - slack) return Testimony::kNothing;
  if (is_smooth) {
    if (nearest > at.r + slack) return Testimony::kEnds;
    return is_complete ? Testimony::kGoesOn : Testimony::kNothing;
  }
  // A step: the surface ends here if it is the near side of it, and is hidden if it is the far side.
  return std::abs(nearest - at.r) < std::abs(farthest - at.r) || nearest > at.r ? Testimony::kEnds
                                                                                : Testimony::kNothing;
}

}  // namespace lapseam
