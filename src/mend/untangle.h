#pragma once

// Triangles that cut through each other: one of two goes.

#include <cstdint>
#include <span>

#include "lapseam/mesh.h"

namespace lapseam {

class Context;

/// Removes triangles until no two meet where they share nothing: seams before what was measured, then what meets most
/// others, then what is less sure. Exact. Returns the number removed. Deterministic.
/// The mesh must have tags. vertex_error_m: expected error of each vertex.
std::uint64_t remove_self_intersections(Mesh& mesh, std::span<const float> vertex_error_m, Context& context);

}  // namespace lapseam
