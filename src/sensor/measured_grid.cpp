// Projection into a measured grid: the fitted rational map, then a search for the cell of the warp table.

#include <Eigen/Geometry>
#include <cmath>

#include "lapseam/sensor.h"
#include "sensor/warped_grid.h"

namespace lapseam {
Eigen::Vector3d MeasuredGridSensor::unproject(double u, double v, double r) const {
  // The ray is where two planes meet: n_u − q_u d_u = 0 and n_v − q_v d_v = 0. The plane of constant r cuts it.
  const Eigen::Vector2d q = WarpedGrid(width, height, warp, false).at(u, v);
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
  return WarpedGrid(width, height, warp, false)
      .invert({rational[0].dot(h) / du, rational[2].dot(h) / dv}, out.u, out.v);
}

}  // namespace lapseam
