#pragma once

// What the angles of a scanner's lines are off by, scan by scan: found from large planes, which are bent by them.

#include <cstdint>
#include <numbers>
#include <span>
#include <vector>

#include "lapseam/context.h"
#include "lapseam/register.h"
#include "register/associate.h"
#include "register/planes.h"

namespace lapseam {

struct LineView {
  const View* view = nullptr;  ///< with the angles as they are now known
  bool is_fixed = false;
  Eigen::Vector3d center = Eigen::Vector3d::Zero();  ///< of its motion, in world coordinates
  double radius_m = 1;                               ///< of what it sees, about the centre
};

/// What is known so far, from step to step.
struct LineAngles {
  std::vector<std::vector<double>> offsets_rad;  ///< of each view: per column, in all; empty: none
  std::vector<double> firmness;                  ///< by which lines are held to each other; 0: to where they were
  std::vector<Plane> planes;                     ///< that views share; none: to be found
  double reach_m = 0;                            ///< how far samples may be from their planes …
  double reach_rad = std::numbers::pi;           ///< … and, for what the angles of their lines are off by
  double first_reach_m = 0;                      ///< of the first step
  bool has_settled = false;                      ///< whether that has stopped to shrink: only then are lines judged
};

struct LineStep {
  std::vector<Vector6d> motion;  ///< of the views: rotation, translation about the centre, world axes
  std::vector<Matrix6d> known;   ///< what planes tell of each view's motion, whatever its lines are off by
  bool is_last = false;          ///< whether lines are where they belong, or stay where they are
};

/// One step of least squares over poses, lines and planes. Lines of a view are moved only where either half of their
/// samples predicts what the other half shows, and from then on. prior_m: how far views may be off. Deterministic.
LineStep find_line_angles(std::span<const LineView> views, std::span<const Posed> posed, double prior_m,
                          LineAngles& angles, Context& context);

}  // namespace lapseam
