#pragma once

// The mesh between two rounds, and its way into pieces and back.

#include <span>
#include <vector>

#include "lapseam/mesh.h"
#include "reduce/collapser.h"
#include "reduce/partition.h"

namespace lapseam {

class Context;

/// What a round left.
struct WorkingMesh {
  std::vector<ReduceVertex> vertices;
  std::vector<Triangle> triangles;
  std::vector<std::uint32_t> source;  ///< per triangle, of the mesh given
};

/// What a round begins with: the mesh given, or what the round before left. Refers to it.
struct Surface {
  StridedPositions positions_m;
  std::span<const Triangle> triangles;
  std::span<const float> sigma_m;          ///< of the mesh given; may be empty
  std::span<const ReduceVertex> vertices;  ///< empty for the mesh given
  std::span<const std::uint32_t> source;   ///< empty for the mesh given

  bool has_quadrics() const { return !vertices.empty(); }
};
Surface surface_of(const Mesh& mesh, std::span<const float> sigma_m);
Surface surface_of(const WorkingMesh& mesh);

/// A piece with the names of its vertices in the surface it is from. Vertices of other parts are locked, and so are
/// those that share a triangle with them. The part's own come first, in the order of its list.
struct LoadedPiece {
  Piece piece;
  std::vector<std::uint32_t> names;
  std::size_t own = 0;
  std::vector<float> squared_sigma;  ///< per vertex, or empty
};
LoadedPiece load_piece(const Surface& surface, const Partition& parts, std::size_t part);

/// Collects the pieces of a round. Parts may be stored from several threads, each once.
class PieceResults {
 public:
  explicit PieceResults(const Partition& parts) : parts_(parts), pieces_(parts.parts) {
    new_rank_.resize(parts.part_of_vertex.size());
  }
  void store(std::size_t part, LoadedPiece loaded);
  /// All pieces as one mesh; they are given up on the way.
  WorkingMesh join(Context& context);

 private:
  const Partition& parts_;
  std::vector<WorkingMesh> pieces_;      ///< triangles in the names of the surface
  std::vector<std::uint32_t> new_rank_;  ///< per vertex of the surface that is left: place in its part's result
};

/// With the provenance of the mesh given: see reduce.h.
Mesh to_mesh(const WorkingMesh& reduced, const Mesh& source, Context& context);

}  // namespace lapseam
