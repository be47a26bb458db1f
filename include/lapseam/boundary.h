#pragma once

// Where a mesh ends: at the edge of what was seen, or at a crack in it.

#include <cstdint>
#include <functional>
#include <span>
#include <string>
#include <vector>

#include "lapseam/mesh.h"
#include "lapseam/noise.h"
#include "lapseam/view.h"

namespace lapseam {

class Context;

/// Views as they were measured, loaded one at a time, and how noisy each is.
struct MeasuredViews {
  std::size_t count = 0;
  std::function<View(std::size_t)> load;
  std::function<NoiseModel(std::size_t)> noise;  ///< asked after the view was loaded
};

struct BoundaryOptions {
  /// How far views are off by poses and calibration, metres (RegistrationError); widens what counts as agreement.
  double registration_error_m = 0;
};

enum class BoundaryKind : std::uint8_t {
  kSeenEnd = 0,  ///< a view that can tell saw the surface end there: a step behind it
  kUnseen = 1,   ///< no view tells what lies beyond: nothing measured, hidden, out of every frame
  kCrack = 2,    ///< a view measured the surface on both sides: the mesh ends where the surface does not
};

struct BoundaryPiece {
  std::uint32_t a = 0, b = 0;  ///< vertices; the edge's only triangle lies to its left
  std::uint32_t triangle = 0;
  std::uint32_t loop = 0;
  BoundaryKind kind = BoundaryKind::kUnseen;
};

/// Lengths in metres. The edge of what was seen is seen ends and unseen together.
struct BoundaryFigures {
  std::uint64_t edges = 0;
  std::uint64_t crack_edges = 0;
  double length_m = 0;
  double seen_end_length_m = 0, unseen_length_m = 0, crack_length_m = 0;
  std::uint64_t loops = 0;
  std::uint64_t crack_loops = 0;  ///< over half of whose length is crack
  double crack_loop_length_m = 0;

  double crack_share() const { return length_m > 0 ? crack_length_m / length_m : 0; }  ///< 0 … 1
};

struct BoundaryReport {
  BoundaryFigures figures;
  std::vector<BoundaryPiece> pieces;  ///< every boundary edge, by triangle and corner
};

/// Looks at every boundary edge in every view. A view speaks of an edge when it sees the front of the surface there, at
/// the mesh's range within noise, registration error and sampling. From the edge it then follows its image outwards,
/// across the outline, for two sample spacings (the mesh's or the view's, whichever is wider, but at most four of the
/// view's: sides of reduced triangles say nothing of sampling). Four valid samples around every place on the way, no
/// step between them, and a range that goes on from the mesh's, make it a crack; samples clearly behind make it an end;
/// anything else (no samples, frame, something in front) says nothing. Where views contradict each other, those whose
/// error there (noise and spacing over the cosine of incidence) is over 1.5 times that of the best end are not heard:
/// far views do not resolve the edge of a book. Vertices that are no measurement any more but lie within the noise, as
/// after smoothing, do not disturb it.
/// Indices as given: weld first where vertices at equal positions stand for one. Views are loaded once, in turn. Same
/// result for any number of threads. About 0.3 µs per boundary edge and view, beside the loading. Throws InvalidInput
/// as check_mesh does, and what `load` throws.
BoundaryReport classify_boundary(const Mesh& mesh, const MeasuredViews& views, const BoundaryOptions& options,
                                 Context& context);

/// Sums up pieces; lengths from the mesh's positions.
BoundaryFigures summarize_boundary(const Mesh& mesh, std::span<const BoundaryPiece> pieces);

/// One JSON object with a key per figure: units in the key, shares in percent.
std::string to_json(const BoundaryFigures& figures);

}  // namespace lapseam
