// What sensors are off by, in turns with the poses.

#include "core/parallel.h"
#include "register/range_offsets.h"
#include "register/registrar.h"

namespace lapseam {
namespace {

// Poses and what sensors are off by take turns.
constexpr int kCalibrations = 10;
// Lines, poses and planes are found together; at first, planes reach this share of the capture range.
constexpr int kLineRounds = 30;
constexpr double kLineReach = 0.5;

}  // namespace

bool Registrar::calibrate_lines() {
  const auto is_scanner = [](const View& view) { return std::holds_alternative<SphericalSensor>(view.sensor); };
  if (std::none_of(given_.begin(), given_.end(), is_scanner)) return false;
  StageScope stage(context_, "calibrate lines", kLineRounds);
  const std::vector<PlacedView> reached = result_.views;
  LineAngles angles;
  angles.reach_m = kLineReach * capture_m_;
  for (int round = 0; round < kLineRounds && step_lines(angles); ++round) stage.advance();
  const bool has_found =
      std::any_of(angles.firmness.begin(), angles.firmness.end(), [](double held) { return held > 0; });
  if (!has_found) {
    result_.views = reached;
    known_.clear();
  }
  // Where planes put the views is what later results are judged against.
  for (std::size_t i = 0; i < n_ && has_found; ++i) corrected_[i].T_world_view = result_.views[i].T_world_view;
  return has_found;
}

bool Registrar::step_lines(LineAngles& angles) {
  std::vector<LineView> views(n_);
  for (std::size_t i = 0; i < n_; ++i)
    views[i] = {&views_[i], !is_moving(i), center_of(i), std::max(pyramids_[i].radius_m, 1e-9)};
  const LineStep found = find_line_angles(views, posed_at(0), capture_m_, angles, context_);
  move_views(found.motion);
  known_ = found.known;
  for (std::size_t i = 0; i < n_; ++i) result_.views[i].line_offset_rad = angles.offsets_rad[i];
  if (std::any_of(angles.firmness.begin(), angles.firmness.end(), [](double held) { return held > 0; })) {
    correct_views();
    make_pyramids();
  }
  return !found.is_last;
}

void Registrar::calibrate() {
  StageScope stage(context_, "calibrate", kCalibrations);
  for (int round = 0; round < kCalibrations; ++round) {
    if (!add_range_offsets(views_, posed_at(0), gated_pairs(), kJudged, result_.corrections, context_)) break;
    correct_views();
    make_pyramids();
    step(0, make_trees(0), kJudged);
    stage.advance();
  }
  if (!corrected_.empty()) refine_with_all(make_trees(0));
}

void Registrar::correct_views() {
  if (corrected_.empty()) corrected_.assign(given_.begin(), given_.end());
  parallel_for(context_, n_, 1, [&](std::size_t i) {
    const std::vector<double>& lines = result_.views[i].line_offset_rad;
    if (!lines.empty()) corrected_[i].sensor = corrected(std::get<SphericalSensor>(given_[i].sensor), lines);
    const auto found = result_.corrections.find(given_[i].sensor_id);
    if (found != result_.corrections.end()) corrected_[i].range = corrected(given_[i].range, found->second);
  });
  views_ = corrected_;
}

}  // namespace lapseam
