#pragma once

// Several meshes as one, with what the cut and the seam ask of their vertices.

#include <Eigen/Core>
#include <cstdint>
#include <span>
#include <vector>

#include "lapseam/mesh.h"
#include "lapseam/sew_meshes.h"

namespace lapseam {

class Context;

/// Of every vertex, what the triangles around it say.
struct VertexFrames {
  std::vector<Eigen::Vector3f> normals;  ///< unit, or zero where its triangles cancel out
  std::vector<float> spacing_m;          ///< mean length of its edges
  float edge_length_m = 0;               ///< median over the triangles of the middle one of their sides
};
VertexFrames measure_vertices(const Mesh& mesh);

struct MergedMeshes : VertexFrames {
  Mesh mesh;                                 ///< with tags; textures left out
  std::vector<std::uint32_t> first_vertex;   ///< of each mesh, and the end
  std::vector<std::uint32_t> triangle_mesh;  ///< of each triangle, the mesh it is from

  std::uint32_t mesh_of_vertex(std::uint32_t v) const;
};

/// Checks the inputs, leaves out triangles that would take an edge that is taken already, and counts them.
MergedMeshes merge_meshes(std::span<const Mesh> meshes, SewMeshesReport& report, Context& context);

}  // namespace lapseam
