// Based on: D. C. Brown, Close-Range Camera Calibration, 1971.

#include <algorithm>
#include <cmath>

#include "lapseam/sensor.h"

namespace lapseam {
namespace {

// Where Newton's method stops, on the plane z = 1: far below a millionth of any pixel.
constexpr double kConverged = 1e-15;
constexpr int kMaxSteps = 60;

// The derivative of the distorted radius by the ideal one, as a polynomial in the squared radius.
double radial_growth(const BrownDistortion& d, double s) { return 1 + s * (3 * d.k1 + s * (5 * d.k2 + s * 7 * d.k3)); }

// Whether the distorted radius grows all the way from the axis to squared radius s. Beyond a first fold the polynomial
// may grow again, so its lowest value up to s counts and not the one at s.
bool grows_up_to(const BrownDistortion& d, double s) {
  if (!(radial_growth(d, s) > 0)) return false;
  // Extrema: 3 k1 + 10 k2 s + 21 k3 s² = 0.
  const double a = 21 * d.k3, b = 10 * d.k2, c = 3 * d.k1;
  const auto holds_at = [&](double extremum) {
    return !(extremum > 0 && extremum < s) || radial_growth(d, extremum) > 0;
  };
  if (a == 0) return b == 0 || holds_at(-c / b);
  const double discriminant = b * b - 4 * a * c;
  if (discriminant < 0) return true;
  const double root = std::sqrt(discriminant);
  return holds_at((-b + root) / (2 * a)) && holds_at((-b - root) / (2 * a));
}

struct Distorted {
  double x, y;
  double dx_dx, dx_dy, dy_dx, dy_dy;
  bool is_unfolded;
};

Distorted evaluate(const BrownDistortion& d, double x, double y) {
  const double s = x * x + y * y;
  const double radial = 1 + s * (d.k1 + s * (d.k2 + s * d.k3));
  const double slope = d.k1 + s * (2 * d.k2 + s * 3 * d.k3);  // of radial by s
  Distorted out;
  out.x = x * radial + 2 * d.p1 * x * y + d.p2 * (s + 2 * x * x);
  out.y = y * radial + d.p1 * (s + 2 * y * y) + 2 * d.p2 * x * y;
  out.dx_dx = radial + 2 * x * x * slope + 2 * d.p1 * y + 6 * d.p2 * x;
  out.dx_dy = 2 * x * y * slope + 2 * d.p1 * x + 2 * d.p2 * y;
  out.dy_dx = out.dx_dy;
  out.dy_dy = radial + 2 * y * y * slope + 6 * d.p1 * y + 2 * d.p2 * x;
  out.is_unfolded = out.dx_dx * out.dy_dy - out.dx_dy * out.dy_dx > 0 && grows_up_to(d, s);
  return out;
}

}  // namespace

bool BrownDistortion::distort(double& x, double& y) const {
  const Distorted out = evaluate(*this, x, y);
  x = out.x;
  y = out.y;
  return out.is_unfolded;
}

void BrownDistortion::undistort(double& x, double& y) const {
  const double target_x = x, target_y = y;
  Distorted at = evaluate(*this, x, y);
  while (!at.is_unfolded && std::max(std::abs(x), std::abs(y)) > kConverged) {
    x *= 0.5;
    y *= 0.5;
    at = evaluate(*this, x, y);
  }
  double error = std::hypot(at.x - target_x, at.y - target_y);
  for (int step = 0; step < kMaxSteps && error > 0; ++step) {
    const double determinant = at.dx_dx * at.dy_dy - at.dx_dy * at.dy_dx;
    const double ex = target_x - at.x, ey = target_y - at.y;
    double dx = (ex * at.dy_dy - ey * at.dx_dy) / determinant;
    double dy = (ey * at.dx_dx - ex * at.dy_dx) / determinant;
    // Shorter steps where a whole one would leave the part of the model that can be inverted, or lead away.
    bool is_better = false;
    for (int halving = 0; halving < 40 && !is_better; ++halving, dx *= 0.5, dy *= 0.5) {
      const Distorted next = evaluate(*this, x + dx, y + dy);
      const double next_error = std::hypot(next.x - target_x, next.y - target_y);
      if (!next.is_unfolded || !(next_error < error)) continue;
      is_better = true;
      x += dx;
      y += dy;
      at = next;
      error = next_error;
      if (std::max(std::abs(dx), std::abs(dy)) < kConverged) return;
    }
    if (!is_better) return;  // at rounding, or at the fold
  }
}

}  // namespace lapseam
