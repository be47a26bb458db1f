#include <limits>

#include "boundary/testimony.h"
#include "core/parallel.h"
#include "health/outline.h"
#include "lapseam/boundary.h"
#include "lapseam/context.h"

namespace lapseam {
namespace {

// A view is heard against one that saw an end if its error is up to so many times the other's.
constexpr float kHeardFactor = 1.5f;

/// The best witness of either side.
struct Hearing {
  float ends_error_m = std::numeric_limits<float>::infinity();
  float goes_on_error_m = std::numeric_limits<float>::infinity();

  void hear(const Statement& statement) {
    if (statement.says == Testimony::kEnds) ends_error_m = std::min(ends_error_m, statement.error_m);
    if (statement.says == Testimony::kGoesOn) goes_on_error_m = std::min(goes_on_error_m, statement.error_m);
  }
  BoundaryKind verdict() const {
    if (goes_on_error_m < std::numeric_limits<float>::infinity() && goes_on_error_m <= kHeardFactor * ends_error_m)
      return BoundaryKind::kCrack;
    if (ends_error_m < std::numeric_limits<float>::infinity()) return BoundaryKind::kSeenEnd;
    return BoundaryKind::kUnseen;
  }
};

}  // namespace

BoundaryReport classify_boundary(const Mesh& mesh, const MeasuredViews& views, const BoundaryOptions& options,
                                 Context& context) {
  check_mesh(mesh);
  const Incidence incidence = build_incidence(mesh.vertex_count(), mesh.triangles);
  const Outline outline = find_outline(mesh.vertex_count(), mesh.triangles, incidence, context);
  const std::vector<OutlineFrame> frames =
      outline_frames(mesh.positions_m, mesh.triangles, incidence, outline, context);
  std::vector<Hearing> hearings(frames.size());
  StageScope stage(context, "boundary", views.count);
  for (std::size_t i = 0; i < views.count; ++i) {
    const View view = views.load(i);
    const Witness witness(view, views.noise(i), mesh.origin_m, options.registration_error_m);
    parallel_for(context, frames.size(), 1024, [&](std::size_t k) { hearings[k].hear(witness.ask(frames[k])); });
    stage.advance();
  }
  BoundaryReport report;
  report.pieces.reserve(frames.size());
  for (std::size_t k = 0; k < frames.size(); ++k) {
    const OutlineEdge& edge = outline.edges[k];
    report.pieces.push_back({edge.a, edge.b, edge.triangle, edge.loop, hearings[k].verdict()});
  }
  report.figures = summarize_boundary(mesh, report.pieces);
  return report;
}

}  // namespace lapseam
