#pragma once

// Which surfels of two views show the same spot, and what follows from them for the poses.

#include <Eigen/Core>
#include <algorithm>
#include <cstdint>
#include <span>
#include <vector>

#include "lapseam/context.h"
#include "register/surfels.h"
#include "spatial/kd_tree.h"

namespace lapseam {

using Matrix6d = Eigen::Matrix<double, 6, 6>;
using Vector6d = Eigen::Matrix<double, 6, 1>;

/// What the views together know of the spot that a surfel shows.
struct Spot {
  float information_per_m2 = 0;  ///< sum of 1 / variance over the views that show it
  float views = 1;               ///< how many those are; those that fit poorly count for less
};

/// One view at one level, at its present pose.
struct Posed {
  const SurfelImage* image = nullptr;
  const Sensor* sensor = nullptr;
  const KdTree* tree = nullptr;  ///< of the usable surfels, in their order; may be null: no search by distance
  const Eigen::AlignedBox3d* box_in_view = nullptr;
  Eigen::Isometry3d T_world_view = Eigen::Isometry3d::Identity();
  const BrightnessAt* brightness = nullptr;  ///< its picture; null: colours are those of the surfels
  const std::vector<Spot>* spots = nullptr;  ///< of its surfels; null: not known, each pair counts by itself
};

/// A surfel of a on the surface of b. The residual is along the mean of both normals (Rusinkiewicz 2019), which is
/// zero on any patch of a sphere or a cylinder and not only on planes.
struct Match {
  std::uint32_t a = 0, b = 0;  ///< indices of surfels
  float residual_m = 0;        ///< positive: a's surface is before b's
  float variance_m2 = 0;       ///< what noise makes of it
  float distance_m = 0;        ///< from the sensor that is farther away
  Eigen::Vector3f normal_in_b = Eigen::Vector3f::Zero();
};

/// Residuals of this many standard deviations count no more (Tukey's biweight at 95 % efficiency).
inline constexpr double kTukey = 4.685;
/// The weight of a residual; none from the gate on.
inline double tukey(double residual, double gate) {
  const double t = residual / gate, s = 1 - t * t;
  return s > 0 ? s * s : 0;
}
/// Standard deviation of normally distributed values, of the median of their absolute values.
inline constexpr double kNormalPerMedian = 1.4826;

/// The one in the middle, the upper of two; 0 of none. Reorders.
inline double middle(std::vector<double>& values) {
  if (values.empty()) return 0;
  const auto at = values.begin() + std::ptrdiff_t(values.size() / 2);
  std::nth_element(values.begin(), at, values.end());
  return *at;
}

/// What residuals count, and how much.
struct Gate {
  double scale_m = 0;        ///< standard deviation of what noise does not explain, yet
  double capture_m = 0;      ///< and never farther than this
  double unexplained_m = 0;  ///< what stays unexplained, of surfaces at the distance below …
  double distance_m = 0;     ///< … and in proportion farther away: angles are wrong, not places. 0: alike everywhere

  double relative_distance(const Match& match) const;
  double variance(const Match& match) const;  ///< with what noise does not explain
  double at(const Match& match) const;
};

/// Two views to be matched at one level, at their present gate.
struct GatedPair {
  std::uint32_t a = 0, b = 0;
  Gate gate;
};

/// Stride by which about so many of an image's surfels are matched: odd, so as not to run down columns.
std::size_t thinning(const SurfelImage& image, std::size_t surfels);

/// Every stride-th usable surfel of a: first where it is projected to in b's image; where that gives nothing, the
/// closest surfel of b, if there is a tree.
std::vector<Match> find_matches(const Posed& a, const Posed& b, const Gate& gate, std::size_t stride = 1);

/// Normal equations of one pair for a small motion of a against b, about a centre in world coordinates: rotation, then
/// translation, world axes. H x = −g is the step; x moves a, and −x moves b.
struct PairSums {
  Matrix6d H = Matrix6d::Zero();
  Vector6d g = Vector6d::Zero();
  /// What the errors of the normals make of a surface that tells nothing: information that is only feigned.
  Matrix6d feigned = Matrix6d::Zero();
  std::size_t matches = 0;
  double weights = 0, shared_weights = 0;  ///< sums over the matches, and times the shares that they count with
};
/// Of each surfel of each view, what all views that show its spot know of it. Deterministic; as long as matching all
/// surfels of all pairs.
std::vector<std::vector<Spot>> find_spots(std::span<const Posed> posed, std::span<const GatedPair> pairs,
                                          Context& context);

/// Adds the matches of a in b; sign −1 when the pair's first view is b.
void add_geometry(const Posed& a, const Posed& b, const std::vector<Match>& matches, const Gate& gate,
                  const Eigen::Vector3d& center, double sign, PairSums& sums);

/// Adds what the colours tell: their differences, less the median one (exposure), along the surface. Weighted by their
/// own spread, on plain surfaces and by how steep brightness is, so that pictures that do not fit hardly count.
void add_color(const Posed& a, const Posed& b, const std::vector<Match>& matches, const Gate& gate,
               const Eigen::Vector3d& center, double sign, PairSums& sums);

/// Standard deviation at the gate's distance, as the middle residuals have it: 1.4826 times the median absolute value
/// of the residuals, each for its relative distance; 0 for none.
double robust_spread(const std::vector<Match>& matches, const Gate& gate);

}  // namespace lapseam
