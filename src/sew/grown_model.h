#pragma once

// The mesh while it grows: triangles, what is known of their corners, and the border.

#include <Eigen/Core>
#include <cstdint>
#include <span>
#include <unordered_set>
#include <vector>

#include "lapseam/mesh.h"
#include "lapseam/patch.h"
#include "lapseam/sew.h"

namespace lapseam {

/// An edge of one triangle alone; the triangle lies to its left.
struct OpenEdge {
  std::uint32_t a, b, triangle;
};

/// Key of an edge, whichever way it runs.
inline std::uint64_t undirected(std::uint32_t a, std::uint32_t b) {
  return a < b ? std::uint64_t(a) << 32 | b : std::uint64_t(b) << 32 | a;
}
/// Sorts sides of one edge next to each other.
bool is_before(const OpenEdge& x, const OpenEdge& y);

/// Triangles [first, last), all inside a sphere: culled together.
struct Chunk {
  std::size_t first, last;
  Eigen::Vector3f center;
  float radius_m;
  float error_m;  ///< largest of its vertices
};

/// In the world's directions, × 127.
using CoarseNormal = Eigen::Matrix<std::int8_t, 3, 1>;

struct GrownModel {
  std::span<const Patch> patches;
  OverlapOptions options;
  Mesh mesh;
  std::vector<float> error_m;        ///< per vertex, along its normal
  std::vector<CoarseNormal> normal;  ///< per vertex
  std::vector<OpenEdge> open;
  std::vector<Chunk> chunks;
  std::unordered_set<std::uint64_t> border_edges;  ///< edges between vertices that were on the border when made
  ZipperReport report;

  /// Of a sample that lies there relative to the mesh's origin.
  std::uint32_t add_vertex(std::uint32_t view, std::size_t pixel, const Eigen::Vector3f& position_m);
  void add_triangle(const Triangle& triangle, TriangleTag tag, std::uint32_t view);
  /// Of all triangles from `begin` on.
  void add_chunks(std::size_t begin);
  /// Goes on with another mesh of the same provenance.
  void replace(Mesh replacement, Context& context);
  /// The mesh; nothing is left but what replace() needs.
  Mesh take();

 private:
  void find_border(Context& context);
};

}  // namespace lapseam
