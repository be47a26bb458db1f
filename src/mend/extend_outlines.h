#pragma once

// The outline of what stands before something else, out to where it is on average.

#include <cstdint>
#include <span>

#include "lapseam/mesh.h"
#include "lapseam/overlap.h"
#include "lapseam/patch.h"

namespace lapseam {

class Context;

/// A sample stands for half a spacing around it, but a view's triangles end at its last samples: things are a spacing
/// too thin. Open edges behind which their view measured something farther off move outwards by half a spacing, within
/// the surface; outlines of fewer than `shortest_outline` edges are slits, and stay. The mesh's provenance counts the
/// patches. Returns the number of vertices moved. Deterministic.
std::uint64_t extend_silhouettes(Mesh& mesh, std::span<const Patch> patches, const OverlapOptions& options,
                                 std::uint32_t shortest_outline, Context& context);

}  // namespace lapseam
