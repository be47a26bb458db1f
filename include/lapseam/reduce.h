#pragma once

// Fewer triangles for the same surface.

#include <cstdint>
#include <span>

#include "lapseam/mesh.h"

namespace lapseam {

class Context;

/// Where the vertex goes that two became one.
enum class Placement : std::uint8_t {
  kOptimal,   ///< where the error is least: averages noise
  kEndpoint,  ///< onto one of the two: every vertex stays a vertex of the mesh given
};

/// Three limits; the first that is reached ends the work. With none of them given, the error is bounded by the noise
/// that is found in the mesh (ReduceReport::noise_m).
struct ReduceOptions {
  /// How far a vertex may be off the planes of the triangles that it stands for, root mean square, metres. 0: no limit.
  double max_error_m = 0;
  /// The same in units of the vertices' sigma, which must be given then. Not together with max_error_m. 0: no limit.
  double max_error_sigma = 0;
  /// Stop when no more are left, having made the cheapest collapses of the whole mesh. 0: no limit.
  std::uint64_t max_triangles = 0;
  Placement placement = Placement::kOptimal;
  /// Where the mesh is cut into pieces, what lies along their borders is mended in further rounds, as long as that is
  /// worth it: at most this many in all. One does for a mesh that is to be reduced again.
  int max_rounds = 5;
};

struct ReduceReport {
  double noise_m = 0;      ///< roughness of the mesh, if it was needed: see docs/reduction.md
  double max_error_m = 0;  ///< the bound that held; 0: none in metres
  int rounds = 0;
};

struct ReduceResult {
  Mesh mesh;
  ReduceReport report;
};

/// Collapses edges by quadric error (Garland & Heckbert 1997), with optimal placement regularized as in Trettner &
/// Kobbelt 2020.
/// vertex_sigma_m: expected error of each vertex, or empty; planes then weigh 1/σ², so that what was measured well is
/// not pulled by what was not.
///
/// An edge-manifold mesh stays one, with the same components, holes and outlines: no outline closes, no two sheets join
/// (surfaces close to each other are apart as long as they share no vertex). No triangle turns by over 66° in a
/// collapse. Open edges keep their shape within about three times the bound. Self-intersections are not looked for:
/// what the mesh has stays, and a bound wider than the gap between two sheets may make new ones.
///
/// Provenance: a vertex has view, pixel and colour of the nearest of the vertices it stands for. A triangle shows the
/// view that most of its corners are from; a measured one whose corners are from several views becomes a seam, as its
/// interior was measured by none of them alone. Texture coordinates are dropped, with a warning. Vertices in no
/// triangle, and triangles that name a vertex twice, are dropped.
///
/// The mesh is cut into pieces that fit a core's cache; those are reduced in parallel with locked borders, in rounds
/// that cut at different places; a count is then met exactly on one thread (result: max_triangles, or one less). Same
/// bytes for any number of threads. About half a microsecond of one core per triangle given, and 30 bytes beside the
/// mesh. Throws InvalidInput as check_mesh does, and when a limit or a sigma is not what it should be; Cancelled.
ReduceResult reduce(const Mesh& mesh, std::span<const float> vertex_sigma_m, const ReduceOptions& options,
                    Context& context);

}  // namespace lapseam
