#pragma once

// Which way the surface at a sample faces, over a wider baseline than its own triangles: those, noise may turn over.

#include <Eigen/Core>

#include "lapseam/patch.h"

namespace lapseam {

/// Reads the patch's grid: only samples that are joined by triangles count.
class WideNormal {
 public:
  explicit WideNormal(const Patch& patch) : patch_(patch), w_(patch.grid.width), h_(patch.grid.height) {}

  /// Unit length, in the view's frame, always towards the sensor.
  Eigen::Vector3f at(int u, int v) const;

 private:
  bool has(int u, int v, int slot) const;
  bool is_anti(int u, int v) const;
  bool is_joined_right(int u, int v) const;
  bool is_joined_down(int u, int v) const;
  Eigen::Vector3f farthest(int u, int v, int du, int dv) const;

  const Patch& patch_;
  int w_, h_;
};

}  // namespace lapseam
