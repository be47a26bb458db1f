// Projection into a measured grid: the fitted rational map, then a search for the cell of the warp table.

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>

#include "lapseam/sensor.h"

namespace lapseam {
namespace {

// Cells walked through before the neighbourhood is searched instead. Warps are smooth but for noise, so two or three
// cells are usual.
constexpr int kMaxWalk = 24;
constexpr int kSearchReach_px = 16;
// A folded cell has two solutions; which one is found depends on the start.
constexpr std::array<std::array<double, 2>, 5> kSearchStarts = {{{0.5, 0.5}, {0, 0}, {1, 0}, {0, 1}, {1, 1}}};
// How far outside its cell a solution may lie by rounding.
constexpr double kCellSlack = 1e-9;

// q at fractional pixels. Beyond the image the warp of its nearest pixel holds, so the map is defined, continuous and
// can be inverted everywhere.
class WarpedGrid {
 public:
  explicit WarpedGrid(const MeasuredGridSensor& sensor) : sensor_(sensor) {}

  Eigen::Vector2d corner(int u, int v) const { return Eigen::Vector2d(u, v) + warp(u, v); }

  Eigen::Vector2d at(double u, double v) const {
    const int iu = cell_index(u, sensor_.width), iv = cell_index(v, sensor_.height);
    const double a = u - iu, b = v - iv;
    const Eigen::Vector2d warp_here = (1 - b) * ((1 - a) * warp(iu, iv) + a * warp(iu + 1, iv)) +
                                      b * ((1 - a) * warp(iu, iv + 1) + a * warp(iu + 1, iv + 1));
    return Eigen::Vector2d(u, v) + warp_here;
  }

  /// (u, v) with at(u, v) = q. False where the warp is folded so badly that no cell holds q.
  bool invert(const Eigen::Vector2d& q, double& u, double& v) const {
    const Eigen::Vector2d guess = q - warp(nearest(q.x()), nearest(q.y()));
    int iu = cell_index(guess.x(), sensor_.width), iv = cell_index(guess.y(), sensor_.height);
    for (int step = 0; step < kMaxWalk; ++step) {
      double a = 0.5, b = 0.5;
      if (!invert_in_cell(q, iu, iv, a, b)) break;
      if (is_inside(a) && is_inside(b)) {
        u = iu + std::clamp(a, 0.0, 1.0);
        v = iv + std::clamp(b, 0.0, 1.0);
        return true;
      }
      // Whole strides at first; single cells later, in case strides leap to and fro over a crease.
      const int stride = step < kMaxWalk / 2 ? 1 << 20 : 1;
      if (!is_inside(a)) iu += std::clamp(int(std::floor(std::clamp(a, -1e6, 1e6))), -stride, stride);
      if (!is_inside(b)) iv += std::clamp(int(std::floor(std::clamp(b, -1e6, 1e6))), -stride, stride);
    }
    return search(q, nearest(guess.x()), nearest(guess.y()), u, v);
  }

 private:
  Eigen::Vector2d warp(int u, int v) const {
    const auto iu = std::size_t(std::clamp(u, 0, sensor_.width - 1)),
               iv = std::size_t(std::clamp(v, 0, sensor_.height - 1));
    return sensor_.warp[iv * std::size_t(sensor_.width) + iu].cast<double>();
  }

  // Beyond one cell outside the image all is the same, so the index need not grow without bound.
  static int cell_index(double x, int size) { return int(std::floor(std::clamp(x, -2.0 - size, 3.0 * size + 2.0))); }
  static int nearest(double x) { return int(std::lround(std::clamp(x, -1e6, 1e6))); }
  static bool is_inside(double t) { return t >= -kCellSlack && t <= 1 + kCellSlack; }

  // Newton's method on q = bilinear(a, b) from the given start; two steps do for a nearly parallel cell.
  bool invert_in_cell(const Eigen::Vector2d& q, int iu, int iv, double& a, double& b) const {
    const Eigen::Vector2d q00 = corner(iu, iv), along_u = corner(iu + 1, iv) - q00, along_v = corner(iu, iv + 1) - q00;
    const Eigen::Vector2d twist = corner(iu + 1, iv + 1) - q00 - along_u - along_v;
    for (int i = 0; i < 12; ++i) {
      const Eigen::Vector2d error = q - (q00 + a * along_u + b * along_v + a * b * twist);
      if (error.squaredNorm() < 1e-28) return true;
      const Eigen::Vector2d du = along_u + b * twist, dv = along_v + a * twist;
      const double determinant = du.x() * dv.y() - du.y() * dv.x();
      if (!(std::abs(determinant) > 1e-12)) return false;
      const double da = (error.x() * dv.y() - error.y() * dv.x()) / determinant;
      const double db = (error.y() * du.x() - error.x() * du.y()) / determinant;
      a += da;
      b += db;
      if (std::abs(da) + std::abs(db) < 1e-13) return true;
      // Far outside there is no need to be exact: the walk goes on.
      if (i >= 2 && (std::abs(a - 0.5) > 2 || std::abs(b - 0.5) > 2)) return true;
    }
    const Eigen::Vector2d error = q - (q00 + a * along_u + b * along_v + a * b * twist);
    return error.squaredNorm() < 1e-16 || !is_inside(a) || !is_inside(b);
  }

  // The first cell around (u0, v0), ring by ring, that holds q.
  bool search(const Eigen::Vector2d& q, int u0, int v0, double& u, double& v) const {
    for (int reach = 0; reach <= kSearchReach_px; ++reach)
      for (int iv = v0 - reach; iv <= v0 + reach; ++iv)
        for (int iu = u0 - reach; iu <= u0 + reach; ++iu) {
          if (std::max(std::abs(iu - u0), std::abs(iv - v0)) != reach) continue;
          for (const auto& start : kSearchStarts) {
            double a = start[0], b = start[1];
            if (!invert_in_cell(q, iu, iv, a, b) || !is_inside(a) || !is_inside(b)) continue;
            u = iu + std::clamp(a, 0.0, 1.0);
            v = iv + std::clamp(b, 0.0, 1.0);
            return true;
          }
        }
    return false;
  }

  const MeasuredGridSensor& sensor_;
};

}  // namespace

Eigen::Vector3d MeasuredGridSensor::unproject(double u, double v, double r) const {
  // The ray is where two planes meet: n_u − q_u d_u = 0 and n_v − q_v d_v = 0. The plane of constant r cuts it.
  const Eigen::Vector2d q = WarpedGrid(*this).at(u, v);
  const Eigen::Vector4d a = rational[0] - q.x() * rational[1], b = rational[2] - q.y() * rational[3];
  const Eigen::Vector3d na = a.head<3>(), nb = b.head<3>(), direction = na.cross(nb);
  return (direction * (r - range_offset_m) - a.w() * nb.cross(forward) - b.w() * forward.cross(na)) /
         direction.dot(forward);
}

bool MeasuredGridSensor::project(const Eigen::Vector3d& p, PixelRange& out) const {
  const double r = forward.dot(p) + range_offset_m;
  if (!(r > 0) || !std::isfinite(r)) return false;
  const Eigen::Vector4d h = p.homogeneous();
  const double du = rational[1].dot(h), dv = rational[3].dot(h);
  if (!(du > 0) || !(dv > 0)) return false;
  out.r = r;
  return WarpedGrid(*this).invert({rational[0].dot(h) / du, rational[2].dot(h) / dv}, out.u, out.v);
}

}  // namespace lapseam
