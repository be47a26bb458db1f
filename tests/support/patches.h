#pragma once

// From a view to a patch as the pipeline makes it, without the pipeline.

#include <vector>

#include "lapseam/context.h"
#include "lapseam/mesh.h"
#include "lapseam/patch.h"
#include "lapseam/triangulate.h"

namespace lapseam::test {

inline Patch make_patch(const View& view, const NoiseModel& noise, Context& context) {
  Patch patch{view, noise, make_ray_table(view.sensor, context), {}, {}, {}};
  const StepThreshold threshold = make_step_threshold(view.sensor, noise);
  patch.grid = triangulate(patch.view, *patch.rays, threshold, context);
  measure_confidence(patch, threshold, context);
  return patch;
}

/// Every triangle of one patch, with indices; one vertex per sample in use.
inline Mesh mesh_of_patch(const Patch& patch) {
  Mesh mesh;
  std::vector<std::uint32_t> vertex(patch.grid.cells.size(), kInvalidIndex);
  for (std::size_t cell = 0; cell < patch.grid.cells.size(); ++cell)
    for (int slot = 0; slot < 2; ++slot) {
      if (!patch.grid.exists(cell, slot)) continue;
      Triangle t;
      for (std::size_t k = 0; k < 3; ++k) {
        const std::uint32_t pixel = patch.grid.corners(cell, slot)[k];
        if (vertex[pixel] == kInvalidIndex) {
          vertex[pixel] = std::uint32_t(mesh.vertex_count());
          mesh.positions_m.push_back(
              (patch.view.T_world_view * patch.point_in_view(pixel).cast<double>()).cast<float>());
        }
        t[k] = vertex[pixel];
      }
      mesh.triangles.push_back(t);
    }
  return mesh;
}

}  // namespace lapseam::test
