#pragma once

// Outlines of what views saw, out to where they are on average.

#include <cstdint>
#include <span>

#include "lapseam/mesh.h"
#include "lapseam/overlap.h"
#include "lapseam/patch.h"

namespace lapseam {

class Context;

/// A sample stands for half a spacing around it, but a view's triangles end at its last samples: things are a spacing
/// too thin, and what is behind them begins half a spacing late. Open edges beyond which their view measured another
/// surface, nothing, or has no pixels any more, move outwards by half a spacing, within the surface. Where it measured
/// that the surface goes on, they stay, and so do outlines of fewer than `shortest_outline` edges, which are slits. The
/// mesh's provenance counts the patches. Returns the number of vertices moved. Deterministic.
std::uint64_t extend_outlines(Mesh& mesh, std::span<const Patch> patches, const OverlapOptions& options,
                              std::uint32_t shortest_outline, Context& context);

}  // namespace lapseam
