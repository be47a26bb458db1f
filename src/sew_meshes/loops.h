#pragma once

// Outlines of holes, and triangles that close them.

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "sew_meshes/triangle_check.h"

namespace lapseam {

/// Vertices in the order of the open half-edges, so that the hole is on the right; each vertex once.
using Loop = std::vector<std::uint32_t>;

/// Open half-edges of living triangles, by triangle and corner.
std::vector<std::array<std::uint32_t, 2>> open_edges(const LiveMesh& mesh, Context& context);

/// The loops that the given open edges are part of. Where several fans touch in a vertex, a loop goes on along the hole
/// that it came along; what it passes twice is cut off as a loop of its own.
std::vector<Loop> trace_loops(const LiveMesh& mesh, std::span<const std::array<std::uint32_t, 2>> edges);

/// Which of all triangulations of a loop is best.
enum class LoopGoal {
  kShape,  ///< the worst triangle and the sharpest fold are as good as can be: narrow gaps between dense borders
  kArea,   ///< the sharpest fold is as flat as can be, then the area is least (Liepa 2003): holes
};

/// How many triangulations are tried, where the first ones meet something.
enum class LoopEffort {
  kThorough,
  kQuick,  ///< a quarter: where there is another way to close a loop
};

/// Closes a loop without new vertices, or leaves everything as it was and returns false. The new triangles meet nothing
/// and fit the rule. Cost: O(n³) and a few dozen times that where the first choices meet something; loops of more than
/// kLargestWhole edges lose ears first, sharpest corners first.
bool close_loop(LiveMesh& mesh, TriangleCheck& check, const Loop& loop, LoopGoal goal, const TriangleRule& rule,
                TriangleTag tag, LoopEffort effort = LoopEffort::kThorough);
/// Fills what of a loop can be filled, and leaves the least length of outline; returns how many triangles it took.
/// Cost: O(n³) and ten times that, and ten thousand tests of a triangle; loops of more than kLargestWhole edges are
/// left as they are.
std::size_t fill_loop(LiveMesh& mesh, TriangleCheck& check, const Loop& loop, LoopGoal goal, const TriangleRule& rule,
                      TriangleTag tag);
/// Fills corners of a loop as far as the rule and the check allow, the sharpest first; returns how many.
std::size_t cut_ears(LiveMesh& mesh, TriangleCheck& check, const Loop& loop, const TriangleRule& rule, TriangleTag tag);
inline constexpr std::size_t kLargestWhole = 128;

}  // namespace lapseam
