#pragma once

// After sewing: where two layers lie over each other one goes, what is open although views measured a surface there is
// closed, and slivers in the seams go.

#include <cstdint>
#include <span>
#include <string>

#include "lapseam/mesh.h"
#include "lapseam/overlap.h"
#include "lapseam/patch.h"

namespace lapseam {

class Context;

struct CloseCracksReport {
  std::uint64_t outline_slivers_removed = 0;    ///< at borders, along the rays of their view, or needles of seams
  std::uint64_t seen_through_removed = 0;       ///< at borders, where most views measured what is behind
  std::uint64_t covered_triangles_removed = 0;  ///< at borders, over another layer of the same surface
  std::uint64_t crack_loops = 0;                ///< short loops of open edges along most of which the surface goes on
  std::uint64_t loops_closed = 0;
  std::uint64_t loops_filled = 0;        ///< partly: the least length is left open
  std::uint64_t loop_triangles = 0;      ///< added, tagged kSeam
  std::uint64_t triangles_replaced = 0;  ///< removed around a hole that could not be closed as it was
  std::uint64_t corners_filled = 0;      ///< triangles, tagged kSeam, in corners of what could not be closed
  std::uint64_t flips = 0;               ///< edges of the seam that were turned for a better shape
  std::uint64_t collapses = 0;           ///< short edges at the seam that were taken out for a better shape
};

/// The mesh's provenance counts the patches. Slivers at the border along the rays of their view go. With a registration
/// error, so does what at the border more views looked through than measured, within three times that error of what
/// stays. A border triangle goes when the middle of another one that faces alike and shares no vertex with it lies over
/// it within the noise of both: the surer stays. A loop of up to 128 open edges is closed by the flattest, then
/// smallest triangulation that meets nothing (exact), that views about as sure as its corners confirm and no clearly
/// surer one looked through: in the middle of each triangle where some view measured a surface beyond most of the
/// loop's length, everywhere else. Where there is none, up to four rings of triangles around the hole are replaced,
/// unless measured surface would be lost; where that does not help, as much of the loop is filled as can be, and
/// corners are. No vertex is made or moved; the mesh stays edge-manifold and oriented, and no new triangle meets
/// another. Same result for any number of threads. Throws Cancelled.
CloseCracksReport close_cracks(Mesh& mesh, std::span<const Patch> patches, const OverlapOptions& options,
                               Context& context);

/// One JSON object.
std::string to_json(const CloseCracksReport& report);

}  // namespace lapseam
