#include "evaluate/truth_boundary.h"

#include <algorithm>

#include "core/parallel.h"
#include "evaluate/view_figures.h"

namespace lapseam {
namespace {

constexpr std::size_t kGrain = 512;
// Of a sample spacing: how far the truth may lie from the tangent plane of the place where the result ends.
constexpr float kOffPlane = 1.0f / 3;
// Two sides of a thin sheet are not one surface.
constexpr float kSameSide = -0.5f;
// Over an edge of the truth the surface goes on with a face that looks outwards, at over 17° from the tangent plane's
// normal, and is met this many spacings below the edge.
constexpr float kLooksOutwards = 0.3f, kBelowEdge = 0.5f;

}  // namespace

TruthBoundary::TruthBoundary(const Surface& result, const Surface& truth, const RayScene& truth_scene,
                             const EvaluateOptions& options, Context& context)
    : gross_m_(options.gross_m), grazing_cosine_(options.grazing_cosine) {
  const Incidence incidence = build_incidence(result.positions_m.size(), result.triangles);
  outline_ = find_outline(result.positions_m.size(), result.triangles, incidence, context);
  const std::vector<OutlineFrame> frames =
      outline_frames(result.positions_m, result.triangles, incidence, outline_, context);
  mesh_.positions_m = result.positions_m;
  beyond_.resize(frames.size());
  parallel_for(context, frames.size(), kGrain,
               [&](std::size_t i) { beyond_[i] = look_beyond(frames[i], truth, truth_scene); });
}

TruthBoundary::Beyond TruthBoundary::look_beyond(const OutlineFrame& frame, const Surface& truth,
                                                 const RayScene& truth_scene) const {
  Beyond beyond;
  const ClosestPoint start = truth_scene.closest(frame.middle);
  if (frame.outward.isZero(0) || double(start.distance) > gross_m_) return beyond;
  const Eigen::Vector3f& normal = truth.normals[start.triangle];
  Eigen::Vector3f outward = frame.outward - frame.outward.dot(normal) * normal;
  // An edge that stands on the truth, as where the result has a flap.
  if (outward.norm() < 0.2f) return beyond;
  outward.normalize();
  beyond.is_near_truth = true;
  const float spacing = std::min(frame.side_m, float(gross_m_));
  for (int k = 0; k < 2; ++k) {
    const Eigen::Vector3f probe = start.point + float(k + 1) * spacing * outward;
    const ClosestPoint there = truth_scene.closest(probe);
    const Eigen::Vector3f& normal_there = truth.normals[there.triangle];
    const bool is_on = there.distance <= kOffPlane * spacing;
    const bool is_cut_off = (probe - there.point).dot(normal_there) < -0.5f * there.distance &&
                            there.distance <= 2 * float(k + 1) * spacing;
    if (!(is_on || is_cut_off) || normal_there.dot(normal) < kSameSide) {
      // The nearest point is on the truth's own edge.
      const ClosestPoint fold = truth_scene.closest(there.point - kBelowEdge * spacing * normal);
      const Eigen::Vector3f& normal_fold = truth.normals[fold.triangle];
      beyond.is_fold = true;
      beyond.goes_on = fold.distance <= kOffPlane * spacing && normal_fold.dot(outward) > kLooksOutwards;
      beyond.probes[0] = {start.point, normal};
      beyond.probes[1] = {fold.point, normal_fold};
      return beyond;
    }
    beyond.probes[k] = {there.point, normal_there};
  }
  beyond.goes_on = true;
  return beyond;
}

void TruthBoundary::visit(const View& view, const Eigen::Vector3d& origin_m, Context& context) {
  const Eigen::Isometry3d T_view_world = view.T_world_view.inverse();
  const auto is_probe_seen = [&](const Probe& probe) {
    return is_seen(view, T_view_world * (probe.point.cast<double>() + origin_m),
                   T_view_world.linear() * probe.normal.cast<double>(), grazing_cosine_);
  };
  parallel_for(context, beyond_.size(), kGrain, [&](std::size_t i) {
    Beyond& beyond = beyond_[i];
    if (beyond.goes_on && !beyond.is_seen)
      beyond.is_seen = is_probe_seen(beyond.probes[0]) && is_probe_seen(beyond.probes[1]);
  });
}

std::vector<BoundaryPiece> TruthBoundary::pieces() const {
  std::vector<BoundaryPiece> pieces;
  pieces.reserve(beyond_.size());
  for (std::size_t i = 0; i < beyond_.size(); ++i) {
    const OutlineEdge& edge = outline_.edges[i];
    BoundaryKind kind = BoundaryKind::kUnseen;
    if (beyond_[i].goes_on && beyond_[i].is_seen) kind = BoundaryKind::kCrack;
    // A fold that no view saw round is where the surface ended for all of them.
    const bool is_end = !beyond_[i].goes_on || (beyond_[i].is_fold && !beyond_[i].is_seen);
    if (beyond_[i].is_near_truth && is_end) kind = BoundaryKind::kSeenEnd;
    pieces.push_back({edge.a, edge.b, edge.triangle, edge.loop, kind});
  }
  return pieces;
}

}  // namespace lapseam
