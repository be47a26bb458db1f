#pragma once

// The mesh while it grows: triangles, what is known of their corners, and the border; and what one view adds to it.

#include <Eigen/Core>
#include <cstdint>
#include <span>
#include <vector>

#include "lapseam/mesh.h"
#include "lapseam/patch.h"
#include "lapseam/sew.h"
#include "sew/edge_set.h"

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

struct GrownModel;

/// What one view's turn adds. Its vertices are counted on from those of the model that it was made for.
struct ModelAddition {
  std::uint32_t view = 0, first_vertex = 0;
  std::vector<Eigen::Vector3f> positions_m;  ///< of its vertices, relative to the mesh's origin
  std::vector<std::uint32_t> pixels;         ///< likewise
  std::vector<float> error_m;                ///< likewise; see finish
  std::vector<CoarseNormal> normal;          ///< likewise
  std::vector<Triangle> triangles;
  std::vector<TriangleTag> tags;
  std::vector<std::uint32_t> closed;  ///< places of the model's open edges that it has a triangle for
  std::vector<OpenEdge> sides;        ///< of its triangles: those that may be open, `triangle` by place in `triangles`
  std::vector<std::uint64_t> chords;  ///< edges between its vertices on the border that are not open themselves

  std::uint32_t add_vertex(std::size_t pixel, const Eigen::Vector3f& position_m);
  std::uint32_t add_triangle(const Triangle& triangle, TriangleTag tag);
  /// Fills error_m and normal, and brings triangles into an order in which neighbours follow each other.
  void finish(const GrownModel& model, Context& context);
  bool is_own(std::uint32_t vertex) const { return vertex >= first_vertex; }
};

struct GrownModel {
  std::span<const Patch> patches;
  OverlapOptions options;
  Mesh mesh;
  std::vector<float> error_m;        ///< per vertex, along its normal
  std::vector<CoarseNormal> normal;  ///< per vertex
  std::vector<OpenEdge> open;
  std::vector<std::uint32_t> outline_size;  ///< of every open edge: how many are joined to it, itself among them
  std::uint32_t shortest_outline = 0;       ///< that views are to come back to
  std::vector<Chunk> chunks;
  EdgeSet border_edges;  ///< edges between vertices that were on the border when made
  ZipperReport report;

  /// Takes over what views found, all of them in the model as it is. 0 for those that are in the way of an earlier one,
  /// closing the same border or making the same edge: nothing of them is taken.
  std::vector<std::uint8_t> accept(std::span<ModelAddition> additions, Context& context);
  /// Fills outline_size, which holds until something is added.
  void measure_outlines();
  /// Goes on with another mesh of the same provenance.
  void replace(Mesh replacement, Context& context);
  /// The mesh; nothing is left but what replace() needs.
  Mesh take();

 private:
  void find_border(Context& context);
  bool is_in_the_way(const ModelAddition& addition, const std::vector<std::uint8_t>& is_closed) const;
  void append(ModelAddition& addition, Context& context);
  void add_chunks(std::size_t begin, Context& context);
  void sort_triangles(Context& context);
};

}  // namespace lapseam
