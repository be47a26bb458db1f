#pragma once

// The closest point of one of several meshes, and whether it is the mesh's border.

#include <Eigen/Core>
#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "sew_meshes/live_mesh.h"
#include "sew_meshes/merged.h"
#include "spatial/ray_scene.h"

namespace lapseam {

class Context;

/// What a mesh has near a point.
struct SurfacePoint {
  Eigen::Vector3f position = Eigen::Vector3f::Zero();
  Eigen::Vector3f normal = Eigen::Vector3f::Zero();  ///< between the normals of the corners, unit
  float distance = 0;
  float spacing_m = 0;
  float confidence = 0;    ///< between those of the corners; 0 where none are given
  bool is_border = false;  ///< on an open edge: the surface may go on where this mesh ends
};

/// The living triangles of one mesh, at the time when it was made. Queries are const and thread-safe, as long as the
/// live mesh does not change.
class SurfaceProbe {
 public:
  SurfaceProbe(const MergedMeshes& merged, const LiveMesh& live, std::uint32_t mesh, Context& context);

  std::optional<SurfacePoint> closest(const Eigen::Vector3f& point, float radius,
                                      const std::vector<float>* confidence = nullptr) const;

 private:
  const MergedMeshes& merged_;
  std::vector<std::uint32_t> triangles_;
  std::vector<std::uint8_t>
      borders_;  // per triangle: bit k: the edge from corner k is open, bit 3 + k: corner k is on one
  RayScene scene_;
};

using SurfaceProbes = std::vector<std::unique_ptr<SurfaceProbe>>;

/// One for each mesh.
SurfaceProbes make_probes(const MergedMeshes& merged, const LiveMesh& live, Context& context);

/// Whether any mesh has a surface at the point that faces alike: within `height_m` of it, and at most `beside_m` beyond
/// its border.
bool is_surface_at(const SurfaceProbes& probes, const Eigen::Vector3f& point, const Eigen::Vector3f& normal,
                   float height_m, float beside_m);

}  // namespace lapseam
