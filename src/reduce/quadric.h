#pragma once

// The squared distance of a point to many planes, weighted, as a quadratic form: Garland & Heckbert 1997. Kept about
// the vertex it belongs to, so that single precision is enough at any distance from the origin.

#include <Eigen/Core>
#include <algorithm>
#include <optional>

namespace lapseam {

/// q(x) = xᵀAx + 2bᵀx + c, with x relative to the owner's position. A is symmetric: xx, xy, xz, yy, yz, zz.
struct Quadric {
  float a[6] = {};
  float b[3] = {};
  float c = 0;
  /// Sum of the weights by which q is divided to become a mean square distance.
  float weight = 0;

  Eigen::Vector3f times(const Eigen::Vector3f& x) const {
    return {a[0] * x[0] + a[1] * x[1] + a[2] * x[2], a[1] * x[0] + a[3] * x[1] + a[4] * x[2],
            a[2] * x[0] + a[4] * x[1] + a[5] * x[2]};
  }
  Eigen::Vector3f linear() const { return {b[0], b[1], b[2]}; }
  float at(const Eigen::Vector3f& x) const { return x.dot(times(x)) + 2 * x.dot(linear()) + c; }

  float trace() const { return a[0] + a[3] + a[5]; }

  /// Adds plane_weight times the squared distance to the plane through `point` with unit `normal`. The trace of A grows
  /// by plane_weight.
  void add_plane(const Eigen::Vector3f& point, const Eigen::Vector3f& normal, float plane_weight) {
    const float wx = plane_weight * normal[0], wy = plane_weight * normal[1], wz = plane_weight * normal[2];
    a[0] += wx * normal[0], a[1] += wx * normal[1], a[2] += wx * normal[2];
    a[3] += wy * normal[1], a[4] += wy * normal[2], a[5] += wz * normal[2];
    const float d = normal.dot(point);
    b[0] -= wx * d, b[1] -= wy * d, b[2] -= wz * d;
    c += plane_weight * d * d;
  }

  /// The sum with `other`, whose owner lies at `offset` from this one's.
  Quadric plus(const Quadric& other, const Eigen::Vector3f& offset) const {
    Quadric sum;
    for (int i = 0; i < 6; ++i) sum.a[i] = a[i] + other.a[i];
    const Eigen::Vector3f g = other.times(offset);
    for (int i = 0; i < 3; ++i) sum.b[i] = b[i] + other.b[i] - g[i];
    sum.c = c + other.c + offset.dot(g) - 2 * offset.dot(other.linear());
    sum.weight = weight + other.weight;
    return sum;
  }

  /// The same form, with x relative to a point at `offset`.
  void move_to(const Eigen::Vector3f& offset) {
    c = std::max(0.f, at(offset));
    const Eigen::Vector3f g = times(offset);
    for (int i = 0; i < 3; ++i) b[i] += g[i];
  }

  /// Where q(x) + pull · |x − target|² is smallest; nothing where that cannot be told.
  std::optional<Eigen::Vector3f> minimum_near(const Eigen::Vector3f& target, float pull) const {
    const float xx = a[0] + pull, xy = a[1], xz = a[2], yy = a[3] + pull, yz = a[4], zz = a[5] + pull;
    const float bx = b[0] - pull * target[0], by = b[1] - pull * target[1], bz = b[2] - pull * target[2];
    const float c00 = yy * zz - yz * yz, c01 = xz * yz - xy * zz, c02 = xy * yz - xz * yy;
    const float det = xx * c00 + xy * c01 + xz * c02;
    // Adjugate over determinant: with a pull of a thousandth of the trace, good to a thousandth.
    const float sum = xx + yy + zz;
    if (!(det > 1e-10f * sum * sum * sum)) return std::nullopt;
    const float c11 = xx * zz - xz * xz, c12 = xy * xz - xx * yz, c22 = xx * yy - xy * xy;
    const float s = -1 / det;
    return Eigen::Vector3f(s * (c00 * bx + c01 * by + c02 * bz), s * (c01 * bx + c11 * by + c12 * bz),
                           s * (c02 * bx + c12 * by + c22 * bz));
  }
};

}  // namespace lapseam
