#pragma once

// What a registration knows on its way. Its stages are in files of their own: the way down the levels in register.cpp,
// who is matched with whom in linking.cpp, what sensors are off by in calibration.cpp, and what came of it in
// judgement.cpp.

#include <algorithm>
#include <limits>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "lapseam/register.h"
#include "register/line_angles.h"
#include "register/network.h"
#include "register/pairs.h"

namespace lapseam {

// Surfels of each view that are matched on the way, with all its partners together and at least with each; and that a
// result is judged by. Only the last steps take all.
inline constexpr std::size_t kOnTheWay = 20'000, kOnTheWayEach = 1000, kJudged = 4000;
inline constexpr std::size_t kAll = std::numeric_limits<std::size_t>::max();
// Fewer matches say nothing of a pair.
inline constexpr std::size_t kFewestMatches = 30;
// Each measurement is matched from both sides.
inline constexpr double kCountedTwice = 2;

class Registrar {
 public:
  Registrar(std::span<const View> views, std::span<const NoiseModel> noise, const PictureOf& pictures,
            const RegisterOptions& options, Context& context);
  RegisterResult run();

 private:
  struct Pair {
    Overlap views{};
    Gate gate{};
    Eigen::Vector3d center = Eigen::Vector3d::Zero();
    PairSums sums{};
    double start_m = 0;    // scale of its residuals at first; 0: too few to tell
    double noise_m = 0;    // what noise makes of them, median
    bool is_weak = false;  // projection finds too little: closest points help
    bool is_dropped = false;
  };

  static bool is_live(const Pair& pair) { return !pair.is_dropped && pair.sums.matches > 0; }
  void make_pyramids();
  void set_capture_range();
  const SurfelImage& image(std::size_t i, int level) const;
  std::vector<Posed> posed_at(int level) const;
  void refine_all();
  // Pairs, and who stays.
  void link();
  // Each part needs one view that stays. A view without partners is a part by itself.
  void fix_parts();
  // The scale at which each pair begins, from what it is off by as given.
  void start_pairs();
  static double typical_distance(const std::vector<Match>& matches);
  bool is_moving(std::size_t i) const;
  bool is_central(std::size_t i) const;
  // Closest points, where projection is a poor guide: for sensors without one centre, whose rays graze what others see
  // well, and for pairs that it finds too little of.
  std::vector<std::optional<KdTree>> make_trees(int level) const;
  // At one level, from the present scale to the finest that the level can tell.
  void descend(int level);
  // Coarse levels see motions as certain that the finest knows nothing of: what views moved along those is taken back.
  void refine_with_all(const std::vector<std::optional<KdTree>>& trees);
  // What all views know of each spot, so that what many show does not count many times. Poses hardly move from here on.
  void share_spots(const std::vector<std::optional<KdTree>>& trees);
  std::vector<GatedPair> gated_pairs() const;
  // Poses and lines together, from the poses as given: lines that are off by degrees hold poses off as well.
  bool calibrate_lines();
  // Whether lines are still moving.
  bool step_lines(LineAngles& angles);
  // Poses are held while offsets are found, and the other way round.
  void calibrate();
  void correct_views();
  // Whether the views have hardly moved.
  bool step(int level, const std::vector<std::optional<KdTree>>& trees, std::size_t surfels);
  void associate_all(int level, const std::vector<std::optional<KdTree>>& trees, std::size_t surfels);
  // Rotation, and translation of the centre.
  Vector6d motion_since_given(std::size_t i) const;
  Eigen::Vector3d center_of(std::size_t i) const;
  void associate(Pair& pair, const std::vector<Posed>& posed, std::size_t surfels) const;
  // What the residuals show beyond the noise: a scale that the pair keeps when the scene's has become smaller.
  void measure_spread(Pair& pair, const std::vector<Match>& a_in_b, const std::vector<Match>& b_in_a) const;
  double spacing_at(int level) const;
  double typical_noise() const;
  std::vector<NetworkView> network_views() const;
  NetworkStep solve(bool with_covariance, double least_certainty = kCertain,
                    const std::vector<Vector6d>* total = nullptr);
  // The longest way that any point of any view went.
  double move_views(const std::vector<Vector6d>& motion);
  struct Agreement {
    PairResidual residual;
    double gain = 0;
  };
  // Of a pair under given poses: all matches within the capture range, and how well they fit by the final gate.
  Agreement agreement(const Pair& pair, const Posed& a, const Posed& b) const;
  double gain_of(const std::vector<Pair>& pairs) const;
  // By how many standard deviations each view is more strained than usual: pulls against the others, or fits less.
  std::vector<double> strains() const;
  // Less what is usual among its partners, which see the same things: of twigs and clutter less fits than of walls.
  std::vector<double> beside_partners(const std::vector<double>& of_view) const;
  void mend_misplaced();
  // Starts strained views again, against those that are not. Whether any was moved.
  bool restart(const std::vector<double>& strain);
  // Whether the view fits better somewhere else than where it is; it is put there.
  bool place_anew(std::size_t i, const std::vector<bool>& is_suspect);
  // As given, and as given against each of the partners that share most with it.
  std::vector<Eigen::Isometry3d> starts_of(std::size_t i, std::vector<Pair> own) const;
  // Compares with the poses as given. Views and pairs that got worse are left out, and the rest is refined once more.
  void judge();
  static bool is_worse(double before, double after);
  // Whether anything was left out that was not before.
  bool refuse(const std::vector<Agreement>& before, const std::vector<Agreement>& after);
  // Whether views would fall apart without the pair.
  bool is_needed(std::size_t k) const;
  bool is_lost(std::size_t i) const;
  void leave(std::size_t i, const std::string& problem);
  void drop(std::size_t k, const std::string& problem);
  void report_pairs(const std::vector<Agreement>& before, const std::vector<Agreement>& after);
  void finish();
  // From a motion about a centre, rotation first, to one about the view's origin, translation first.
  static PoseCovariance about_origin(const Matrix6d& covariance, const Eigen::Vector3d& d);
  Sliding describe(const SlidingMode& mode) const;

  const std::span<const View> given_;
  std::span<const View> views_;  // as given, or without what their sensors are off by
  std::vector<View> corrected_;
  const std::span<const NoiseModel> noise_;
  const PictureOf& pictures_;
  const RegisterOptions& options_;
  Context& context_;
  const std::size_t n_;
  RegisterResult result_;
  std::vector<SurfelPyramid> pyramids_;
  std::vector<BrightnessAt> brightness_;  // empty: no picture
  int levels_ = 0;
  double capture_m_ = 0;
  double scale_m_ = 0;
  std::vector<Matrix6d> known_;  // of each view, what planes tell of its motion since they put it in place; or none
  std::vector<Vector6d> slid_;   // what takes back the motion along what the last step found undetermined
  std::vector<Pair> pairs_;
  std::size_t on_the_way_ = kOnTheWayEach;  // surfels of each view that are matched with each partner
  std::vector<std::vector<Spot>> spots_;    // of the finest level, once views are nearly in place
};

}  // namespace lapseam
