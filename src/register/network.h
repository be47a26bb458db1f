#pragma once

// All poses at once: pairs tie views together, as distances tie the points of a surveyor's network.

#include <Eigen/Geometry>
#include <cstdint>
#include <span>
#include <vector>

#include "lapseam/context.h"
#include "register/associate.h"

namespace lapseam {

/// A pair's normal equations about a centre.
struct NetworkPair {
  std::uint32_t a = 0, b = 0;
  Eigen::Vector3d center = Eigen::Vector3d::Zero();
  const PairSums* sums = nullptr;
};

struct NetworkView {
  bool is_fixed = false;
  Eigen::Vector3d center = Eigen::Vector3d::Zero();  ///< of its motion, in world coordinates
  double radius_m = 1;                               ///< of what it sees, about the centre
  Matrix6d known = Matrix6d::Zero();                 ///< information of its own, as that of planes it lies on, …
  Vector6d away = Vector6d::Zero();                  ///< … and how far it is from where that has it
};

/// A way in which views can slide without anything to show for it: nothing was moved along it.
struct SlidingMode {
  std::vector<Vector6d> motion;  ///< one per view: rotation, translation; the largest displacement is 1 m
  double certainty = 0;          ///< information over what errors of the normals feign; below kCertain
};

struct NetworkStep {
  std::vector<Vector6d> motion;  ///< rotation, translation about the view's centre, world axes
  std::vector<SlidingMode> sliding;
  std::vector<Vector6d> slid;        ///< what takes back the share of `total` that is along the sliding; empty: nothing
  std::vector<Matrix6d> covariance;  ///< about the centre; empty unless asked for
};

/// Information below this many times what is feigned is none. On the way there, where wrong matches feign more than the
/// noise does, more is asked for.
inline constexpr double kCertain = 2, kCertainOnTheWay = 4;

struct NetworkOptions {
  double prior_m = 1;  ///< how far a view may be off, which keeps what no pair tells where it is
  double least_certainty = kCertain;
  bool with_covariance = false;
  const std::vector<Vector6d>* total = nullptr;  ///< motion so far, of each view, to be taken back where views slide
};

/// Deterministic. Throws Error when the equations cannot be solved.
NetworkStep solve_network(std::span<const NetworkView> views, std::span<const NetworkPair> pairs,
                          const NetworkOptions& options, Context& context);

/// How hard a pair pulls at its place in the network: its own wish squared over what its information allows, per degree
/// of freedom; 1 is what noise makes.
double tension(const PairSums& sums);

}  // namespace lapseam
