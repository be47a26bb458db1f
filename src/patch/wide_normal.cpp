#include "patch/wide_normal.h"

#include <algorithm>

namespace lapseam {
namespace {

constexpr int kBaseline_px = 4;

}  // namespace

Eigen::Vector3f WideNormal::at(int u, int v) const {
  const Eigen::Vector3f along_u = farthest(u, v, 1, 0) - farthest(u, v, -1, 0);
  const Eigen::Vector3f along_v = farthest(u, v, 0, 1) - farthest(u, v, 0, -1);
  Eigen::Vector3f normal = along_v.cross(along_u);
  if (patch_.grid.is_mirrored) normal = -normal;
  const Eigen::Vector3f& ray = patch_.rays->directions[patch_.confidence.index(u, v)];
  // What was measured faces the sensor, whatever noise makes of it.
  if (!(normal.dot(ray) < 0)) normal = -ray;
  return normal.normalized();
}

bool WideNormal::has(int u, int v, int slot) const {
  if (v < 0 || v + 1 >= h_) return false;
  if (u < 0 || u >= w_) {
    if (!patch_.grid.wraps) return false;
    u = (u + w_) % w_;
  }
  return patch_.grid.exists(patch_.confidence.index(u, v), slot);
}

bool WideNormal::is_anti(int u, int v) const {
  if (v < 0 || v + 1 >= h_ || u < 0 || u >= w_) return false;
  return (patch_.grid.cells[patch_.confidence.index(u, v)] & PatchGrid::kAntiDiagonal) != 0;
}

// Whether a triangle has the edge from (u, v) to the right, or down.
bool WideNormal::is_joined_right(int u, int v) const {
  return has(u, v, is_anti(u, v) ? 0 : 1) || has(u, v - 1, is_anti(u, v - 1) ? 1 : 0);
}
bool WideNormal::is_joined_down(int u, int v) const { return has(u, v, 0) || has(u - 1, v, 1); }

Eigen::Vector3f WideNormal::farthest(int u, int v, int du, int dv) const {
  for (int k = 0; k < kBaseline_px; ++k) {
    const int x = u + std::min(du, 0), y = v + std::min(dv, 0);
    if (du != 0 ? !is_joined_right(x, y) : !is_joined_down(x, y)) break;
    u += du, v += dv;
    if (u < 0 || u >= w_) u = (u + w_) % w_;
  }
  return patch_.point_in_view(patch_.confidence.index(u, v));
}

}  // namespace lapseam
