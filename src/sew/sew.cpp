#include "lapseam/sew.h"

#include "sew/front.h"

namespace lapseam {

SewReport sew(Mesh& mesh, std::span<const BoundaryEdge> active_edges, const SewOptions& options, Context& context) {
  SewReport report;
  if (mesh.triangles.empty()) return report;
  Front front(mesh, active_edges, options, context);
  front.grow(report);
  front.close_loops(report);
  return report;
}

}  // namespace lapseam
