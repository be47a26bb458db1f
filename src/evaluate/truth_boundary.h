#pragma once

// Cracks by the truth: where a result ends although the true surface goes on and was seen.

#include <vector>

#include "evaluate/surface_samples.h"
#include "health/outline.h"
#include "lapseam/evaluate.h"
#include "spatial/ray_scene.h"

namespace lapseam {

/// From the middle of each boundary edge, moved to the nearest point of the truth, two probes go outwards in the
/// truth's tangent plane: one and two sample spacings (the middle side of the edge's triangle). The truth goes on where
/// it lies within a third of a spacing of both, or cuts them off like a floor that meets a wall, or folds down before
/// them into a face that looks outwards. A crack it is when one view saw both probes; of a fold, the place and the face
/// beyond.
class TruthBoundary {
 public:
  TruthBoundary(const Surface& result, const Surface& truth, const RayScene& truth_scene,
                const EvaluateOptions& options, Context& context);

  /// The next view with true pose and noiseless range: whether it saw the truth at both probes.
  void visit(const View& view, const Eigen::Vector3d& origin_m, Context& context);

  std::vector<BoundaryPiece> pieces() const;
  BoundaryFigures figures() const { return summarize_boundary(mesh_, pieces()); }

 private:
  struct Probe {
    Eigen::Vector3f point = Eigen::Vector3f::Zero(), normal = Eigen::Vector3f::Zero();
  };
  /// What lies beyond one edge.
  struct Beyond {
    bool is_near_truth = false;  ///< else nothing can be said of the edge
    bool goes_on = false;
    bool is_fold = false;
    bool is_seen = false;
    Probe probes[2];
  };
  Beyond look_beyond(const OutlineFrame& frame, const Surface& truth, const RayScene& truth_scene) const;

  double gross_m_, grazing_cosine_;
  Outline outline_;
  Mesh mesh_;  ///< positions of the result, for lengths
  std::vector<Beyond> beyond_;
};

}  // namespace lapseam
