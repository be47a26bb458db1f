#include <algorithm>
#include <nlohmann/json.hpp>

#include "lapseam/boundary.h"

namespace lapseam {

BoundaryFigures summarize_boundary(const Mesh& mesh, std::span<const BoundaryPiece> pieces) {
  BoundaryFigures figures;
  struct Loop {
    double length_m = 0, crack_m = 0;
  };
  std::vector<Loop> loops;
  for (const BoundaryPiece& piece : pieces) {
    if (piece.loop >= loops.size()) loops.resize(piece.loop + 1);
    const double length = (mesh.positions_m[piece.a].cast<double>() - mesh.positions_m[piece.b].cast<double>()).norm();
    ++figures.edges;
    figures.length_m += length;
    loops[piece.loop].length_m += length;
    if (piece.kind == BoundaryKind::kSeenEnd) figures.seen_end_length_m += length;
    if (piece.kind == BoundaryKind::kUnseen) figures.unseen_length_m += length;
    if (piece.kind != BoundaryKind::kCrack) continue;
    ++figures.crack_edges;
    figures.crack_length_m += length;
    loops[piece.loop].crack_m += length;
  }
  figures.loops = loops.size();
  for (const Loop& loop : loops) {
    if (loop.crack_m <= loop.length_m / 2) continue;
    ++figures.crack_loops;
    figures.crack_loop_length_m += loop.length_m;
  }
  return figures;
}

std::string to_json(const BoundaryFigures& figures) {
  const auto percent = [&](double part_m) { return figures.length_m > 0 ? 100 * part_m / figures.length_m : 0.0; };
  const nlohmann::ordered_json json = {
      {"edges", figures.edges},
      {"length_m", figures.length_m},
      {"seen_end_length_m", figures.seen_end_length_m},
      {"unseen_length_m", figures.unseen_length_m},
      {"crack_edges", figures.crack_edges},
      {"crack_length_m", figures.crack_length_m},
      {"crack_percent", percent(figures.crack_length_m)},
      {"loops", figures.loops},
      {"crack_loops", figures.crack_loops},
      {"crack_loop_length_m", figures.crack_loop_length_m},
      {"crack_loop_percent", percent(figures.crack_loop_length_m)},
  };
  return json.dump();
}

}  // namespace lapseam
