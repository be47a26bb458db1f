#pragma once

// Closing the gaps between patches. After Sun, Dumont, Abidi 2000, §2.3.

#include <cstdint>
#include <functional>
#include <span>

#include "lapseam/extract.h"
#include "lapseam/mesh.h"

namespace lapseam {

class Context;

struct SewOptions {
  /// A seam edge may be this many times as long as the sample spacing at its ends (the larger counts).
  double reach_factor = 4.0;
  /// How far patches may lie apart because views disagree (estimate_registration_error), metres: later rounds reach this
  /// much farther, so that a step between two patches of one surface is still bridged.
  double registration_error_m = 0;
  /// Loops that the front leaves open are closed up to this many edges.
  int largest_loop = 32;
  /// Says whether a triangle would stand in space that a view measured as empty; such seams are not made. Corners are
  /// vertices of the mesh. Empty: no check. Called from several threads at once.
  std::function<bool(const Mesh&, const Triangle&)> is_seen_through{};
};

struct SewReport {
  std::uint64_t active_edges = 0;     ///< at the start
  std::uint64_t front_triangles = 0;  ///< added edge by edge
  std::uint64_t loop_triangles = 0;   ///< added to close what the front left open
  std::uint64_t open_edges = 0;       ///< active edges that found no valid triangle
};

/// Adds seam triangles (tag kSeam) to the mesh until no active edge finds a valid partner. An edge looks for boundary
/// vertices near by; a candidate is valid if its triangle keeps the mesh edge-manifold and oriented, crosses no
/// boundary, contains no vertex, faces the same way as its surroundings and does not stand in space seen as empty; of
/// the valid ones the one that sees the edge under the largest angle wins. New edges are active in turn. No vertex is
/// made or moved. Deterministic: candidates are taken by angle, then by index. Cost: about 10 µs per active edge.
SewReport sew(Mesh& mesh, std::span<const BoundaryEdge> active_edges, const SewOptions& options, Context& context);

/// Gives each fan of a vertex where several fans touch its own copy. Returns the number of copies made.
std::uint64_t split_pinched_vertices(Mesh& mesh);

/// Removes connected components (by shared edges) of fewer than `smallest` triangles. Returns the triangles removed.
std::uint64_t remove_small_components(Mesh& mesh, std::uint64_t smallest);

}  // namespace lapseam
