// Filtered predicates in the manner of J. R. Shewchuk, "Adaptive Precision Floating-Point Arithmetic and Fast Robust
// Geometric Predicates" (1997): a double with a bound on its error first, an exact sum of expansions where that cannot
// tell. Inputs are floats, so products of two are exact in double, and nothing over- or underflows.

#include "health/predicates.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

namespace lapseam {
namespace {

// (7 + 56 ε) ε and (3 + 16 ε) ε with ε = 2^-53 (Shewchuk 1997, §4.3), rounded up.
constexpr double kOrient3dBound = 7.8e-16;
constexpr double kOrient2dBound = 3.4e-16;

int sign_of(double x) { return (x > 0) - (x < 0); }

/// A sum without rounding: its components do not overlap and grow in magnitude, so the last one has the sign.
class ExactSum {
 public:
  void add(double x) {
    int kept = 0;
    for (int i = 0; i < size_; ++i) {
      const double sum = x + component_[i];
      const double b = sum - x;
      const double error = (x - (sum - b)) + (component_[i] - b);
      if (error != 0) component_[kept++] = error;
      x = sum;
    }
    if (x != 0) component_[kept++] = x;
    size_ = kept;
  }
  int sign() const { return size_ == 0 ? 0 : sign_of(component_[size_ - 1]); }

 private:
  double component_[49];
  int size_ = 0;
};

/// sum += factor · x · y · z, factor ±1. x·y has 48 bits: split in halves, each times z fits a double.
void add_product(ExactSum& sum, double factor, float x, float y, float z) {
  const double xy = double(x) * double(y);
  const double c = 134217729.0 * xy;  // 2^27 + 1: Veltkamp's split
  const double high = c - (c - xy);
  sum.add(factor * high * double(z));
  sum.add(factor * (xy - high) * double(z));
}

/// sum += factor · x · (y × z)
void add_triple(ExactSum& sum, double factor, const Eigen::Vector3f& x, const Eigen::Vector3f& y,
                const Eigen::Vector3f& z) {
  for (int i = 0; i < 3; ++i) {
    const int j = (i + 1) % 3, k = (i + 2) % 3;
    add_product(sum, factor, x[i], y[j], z[k]);
    add_product(sum, -factor, x[i], y[k], z[j]);
  }
}

int orient3d_exact(const Eigen::Vector3f& a, const Eigen::Vector3f& b, const Eigen::Vector3f& c,
                   const Eigen::Vector3f& d) {
  ExactSum sum;
  add_triple(sum, 1, b, c, d);
  add_triple(sum, -1, a, c, d);
  add_triple(sum, 1, a, b, d);
  add_triple(sum, -1, a, b, c);
  return sum.sign();
}

int orient2d_exact(const Eigen::Vector2f& a, const Eigen::Vector2f& b, const Eigen::Vector2f& c) {
  ExactSum sum;
  const auto add_cross = [&](const Eigen::Vector2f& p, const Eigen::Vector2f& q) {
    sum.add(double(p.x()) * double(q.y()));
    sum.add(-double(p.y()) * double(q.x()));
  };
  add_cross(a, b);
  add_cross(b, c);
  add_cross(c, a);
  return sum.sign();
}

using Triangle2 = std::array<Eigen::Vector2f, 3>;

bool is_inside(const Triangle2& t, const Eigen::Vector2f& p) {
  const int s0 = orient2d(t[0], t[1], p), s1 = orient2d(t[1], t[2], p), s2 = orient2d(t[2], t[0], p);
  return !((s0 > 0 || s1 > 0 || s2 > 0) && (s0 < 0 || s1 < 0 || s2 < 0));
}

/// p is known to lie on the line through a and b.
bool is_between(const Eigen::Vector2f& a, const Eigen::Vector2f& b, const Eigen::Vector2f& p) {
  return (a.cwiseMin(b).array() <= p.array()).all() && (p.array() <= a.cwiseMax(b).array()).all();
}

bool do_segments_meet(const Eigen::Vector2f& a, const Eigen::Vector2f& b, const Eigen::Vector2f& c,
                      const Eigen::Vector2f& d) {
  const int ac = orient2d(a, b, c), ad = orient2d(a, b, d), ca = orient2d(c, d, a), cb = orient2d(c, d, b);
  if (ac * ad < 0 && ca * cb < 0) return true;
  return (ac == 0 && is_between(a, b, c)) || (ad == 0 && is_between(a, b, d)) || (ca == 0 && is_between(c, d, a)) ||
         (cb == 0 && is_between(c, d, b));
}

bool do_coplanar_meet(const Eigen::Vector3f& p, const Eigen::Vector3f& q, const std::array<Eigen::Vector3f, 3>& t) {
  const int axis = dominant_plane(t[0], t[1], t[2]);
  if (axis < 0) return false;
  const Eigen::Vector2f p2 = drop_axis(p, axis), q2 = drop_axis(q, axis);
  const Triangle2 t2 = {drop_axis(t[0], axis), drop_axis(t[1], axis), drop_axis(t[2], axis)};
  if (is_inside(t2, p2) || is_inside(t2, q2)) return true;
  for (int i = 0; i < 3; ++i)
    if (do_segments_meet(p2, q2, t2[std::size_t(i)], t2[std::size_t((i + 1) % 3)])) return true;
  return false;
}

/// The sides of the triangle's plane that p and q lie on are known.
bool do_meet(const Eigen::Vector3f& p, const Eigen::Vector3f& q, int side_p, int side_q,
             const std::array<Eigen::Vector3f, 3>& t) {
  if (side_p * side_q > 0) return false;
  if (side_p == 0 && side_q == 0) return do_coplanar_meet(p, q, t);
  // The line through p and q pierces the plane in one point: inside when it passes all edges on the same side.
  bool is_left = false, is_right = false;
  for (std::size_t i = 0; i < 3; ++i) {
    const int side = orient3d(p, q, t[i], t[(i + 1) % 3]);
    is_left |= side > 0;
    is_right |= side < 0;
    if (is_left && is_right) return false;
  }
  return true;
}

}  // namespace

int orient3d(const Eigen::Vector3f& a, const Eigen::Vector3f& b, const Eigen::Vector3f& c, const Eigen::Vector3f& d) {
  const Eigen::Vector3d o = a.cast<double>();
  const Eigen::Vector3d u = b.cast<double>() - o, v = c.cast<double>() - o, w = d.cast<double>() - o;
  const double uv_x = u.y() * v.z(), vu_x = u.z() * v.y();
  const double uv_y = u.z() * v.x(), vu_y = u.x() * v.z();
  const double uv_z = u.x() * v.y(), vu_z = u.y() * v.x();
  const double det = (uv_x - vu_x) * w.x() + (uv_y - vu_y) * w.y() + (uv_z - vu_z) * w.z();
  const double permanent = (std::abs(uv_x) + std::abs(vu_x)) * std::abs(w.x()) +
                           (std::abs(uv_y) + std::abs(vu_y)) * std::abs(w.y()) +
                           (std::abs(uv_z) + std::abs(vu_z)) * std::abs(w.z());
  if (std::abs(det) > kOrient3dBound * permanent) return sign_of(det);
  if (permanent == 0) return 0;  // every term is exactly zero: common on walls along the axes
  return orient3d_exact(a, b, c, d);
}

int orient2d(const Eigen::Vector2f& a, const Eigen::Vector2f& b, const Eigen::Vector2f& c) {
  const double left = (double(b.x()) - double(a.x())) * (double(c.y()) - double(a.y()));
  const double right = (double(b.y()) - double(a.y())) * (double(c.x()) - double(a.x()));
  const double det = left - right;
  const double permanent = std::abs(left) + std::abs(right);
  if (std::abs(det) > kOrient2dBound * permanent) return sign_of(det);
  if (permanent == 0) return 0;
  return orient2d_exact(a, b, c);
}

int dominant_plane(const Eigen::Vector3f& a, const Eigen::Vector3f& b, const Eigen::Vector3f& c) {
  const Eigen::Vector3d o = a.cast<double>();
  const Eigen::Vector3d normal = (b.cast<double>() - o).cross(c.cast<double>() - o).cwiseAbs();
  int best = 0;
  normal.maxCoeff(&best);
  for (int i = 0; i < 3; ++i) {
    const int axis = (best + i) % 3;
    if (orient2d(drop_axis(a, axis), drop_axis(b, axis), drop_axis(c, axis)) != 0) return axis;
  }
  return -1;
}

bool do_segment_and_triangle_meet(const Eigen::Vector3f& p, const Eigen::Vector3f& q,
                                  const std::array<Eigen::Vector3f, 3>& t) {
  return do_meet(p, q, orient3d(t[0], t[1], t[2], p), orient3d(t[0], t[1], t[2], q), t);
}

bool do_triangles_meet(const std::array<Eigen::Vector3f, 3>& a, const std::array<Eigen::Vector3f, 3>& b) {
  // If two triangles meet, an edge of one meets the other.
  const auto sides = [](const auto& plane, const auto& t) {
    return std::array{orient3d(plane[0], plane[1], plane[2], t[0]), orient3d(plane[0], plane[1], plane[2], t[1]),
                      orient3d(plane[0], plane[1], plane[2], t[2])};
  };
  const auto is_one_side = [](const std::array<int, 3>& s) {
    return (s[0] > 0 && s[1] > 0 && s[2] > 0) || (s[0] < 0 && s[1] < 0 && s[2] < 0);
  };
  const std::array<int, 3> b_of_a = sides(a, b);
  if (is_one_side(b_of_a)) return false;
  const std::array<int, 3> a_of_b = sides(b, a);
  if (is_one_side(a_of_b)) return false;
  for (std::size_t i = 0; i < 3; ++i) {
    const std::size_t j = (i + 1) % 3;
    if (do_meet(b[i], b[j], b_of_a[i], b_of_a[j], a) || do_meet(a[i], a[j], a_of_b[i], a_of_b[j], b)) return true;
  }
  return false;
}

}  // namespace lapseam
