#pragma once

// The map q(u, v) = (u, v) + warp of a sensor whose pixels look beside a regular grid, bilinear between pixels, and its
// inverse by search. Private to the sensor models.

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

namespace lapseam {

// Cells walked through before the neighbourhood is searched instead. Warps are smooth but for noise, so two or three
// cells are usual.
inline constexpr int kMaxWalk = 24;
inline constexpr int kSearchReach_px = 16;
// A folded cell has two solutions; which one is found depends on the start.
inline constexpr std::array<std::array<double, 2>, 5> kSearchStarts = {{{0.5, 0.5}, {0, 0}, {1, 0}, {0, 1}, {1, 1}}};
// How far outside its cell a solution may lie by rounding.
constexpr double kCellSlack = 1e-9;

// q at fractional pixels. Beyond the image the warp of its nearest pixel holds (or that of the other end, where columns
// go round), so the map is defined, continuous and can be inverted everywhere.
class WarpedGrid {
 public:
  WarpedGrid(int width, int height, const std::vector<Eigen::Vector2f>& warp, bool wraps)
      : width_(width), height_(height), warp_(warp), wraps_(wraps) {}

  Eigen::Vector2d corner(int u, int v) const { return Eigen::Vector2d(u, v) + warp(u, v); }

  Eigen::Vector2d at(double u, double v) const {
    const int iu = cell_index(u, width_), iv = cell_index(v, height_);
    const double a = u - iu, b = v - iv;
    const Eigen::Vector2d warp_here = (1 - b) * ((1 - a) * warp(iu, iv) + a * warp(iu + 1, iv)) +
                                      b * ((1 - a) * warp(iu, iv + 1) + a * warp(iu + 1, iv + 1));
    return Eigen::Vector2d(u, v) + warp_here;
  }

  /// (u, v) with at(u, v) = q. False where the warp is folded so badly that no cell holds q.
  bool invert(const Eigen::Vector2d& q, double& u, double& v) const {
    const Eigen::Vector2d guess = q - warp(nearest(q.x()), nearest(q.y()));
    int iu = cell_index(guess.x(), width_), iv = cell_index(guess.y(), height_);
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
    const int column = wraps_ ? (u % width_ + width_) % width_ : std::clamp(u, 0, width_ - 1);
    const std::size_t row = std::size_t(std::clamp(v, 0, height_ - 1));
    return warp_[row * std::size_t(width_) + std::size_t(column)].cast<double>();
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

  int width_, height_;
  const std::vector<Eigen::Vector2f>& warp_;
  bool wraps_;
};

}  // namespace lapseam
