#pragma once

// Closing holes that nobody measured, because it was asked for.

#include <cstdint>
#include <string>

#include "lapseam/mesh.h"

namespace lapseam {

class Context;

struct FillHolesOptions {
  /// Holes are filled whose outline's two farthest vertices are at most this far apart, metres. 0: none.
  double largest_m = 0;
};

struct FillHolesReport {
  std::uint64_t holes = 0;          ///< of any size; the outer border of a piece of surface is none
  std::uint64_t holes_in_size = 0;  ///< of those, the ones that were to be filled
  std::uint64_t holes_filled = 0;
  std::uint64_t triangles = 0;  ///< added
};

/// Closes holes with triangles tagged kFilled; no vertex is made or moved. A hole is an outline that the surface lies
/// around; one that lies around the surface (the rim of a sheet) is left. A filling meets no other triangle (exact) and
/// keeps the mesh edge-manifold and oriented; a hole that has no such filling stays open, with a warning. Outlines of
/// up to 128 edges get the flattest of all fillings, then the smallest (Liepa 2003); longer ones lose their sharpest
/// corners first (Zhao, Gao, Lin 2007). A hole of 128 edges takes some 10 ms, a few dozen times that where the first
/// fillings meet something. Deterministic. Throws InvalidInput as check_mesh does, when largest_m is not a number, and
/// when two triangles run through an edge in the same direction; Cancelled.
FillHolesReport fill_holes(Mesh& mesh, const FillHolesOptions& options, Context& context);

/// One JSON object.
std::string to_json(const FillHolesReport& report);

}  // namespace lapseam
