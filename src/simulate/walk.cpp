// A walk through a room with a camera in the hand. Places that together see everything are joined to a tour through
// free space; views are spread evenly along it, and each looks where least was seen so far, without turning too fast.

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "core/parallel.h"
#include "lapseam/error.h"
#include "simulate/counter_rng.h"
#include "simulate/coverage.h"
#include "simulate/free_space.h"
#include "simulate/trajectory.h"

namespace lapseam::simulation {
namespace {

using Eigen::Vector3d;
using Eigen::Vector3f;

constexpr float kPi = std::numbers::pi_v<float>;

/// The order in which the places make a short open tour: nearest first, then exchanges of two legs.
std::vector<std::size_t> order_tour(const std::vector<Vector3f>& places) {
  std::vector<std::size_t> tour(places.size());
  for (std::size_t i = 0; i < tour.size(); ++i) tour[i] = i;
  const auto length = [&](std::size_t i, std::size_t j) { return (places[tour[i]] - places[tour[j]]).norm(); };
  for (std::size_t i = 0; i + 1 < tour.size(); ++i) {
    std::size_t best = i + 1;
    for (std::size_t j = i + 2; j < tour.size(); ++j)
      if (length(i, j) < length(i, best)) best = j;
    std::swap(tour[i + 1], tour[best]);
  }
  for (bool is_shorter = true; is_shorter;) {
    is_shorter = false;
    for (std::size_t i = 0; i + 2 < tour.size(); ++i)
      for (std::size_t j = i + 2; j < tour.size(); ++j) {
        const float before = length(i, i + 1) + (j + 1 < tour.size() ? length(j, j + 1) : 0.0f);
        const float after = length(i, j) + (j + 1 < tour.size() ? length(i + 1, j + 1) : 0.0f);
        if (after >= before - 1e-4f) continue;
        std::reverse(tour.begin() + std::ptrdiff_t(i) + 1, tour.begin() + std::ptrdiff_t(j) + 1);
        is_shorter = true;
      }
  }
  return tour;
}

/// Rounds the corners of a path without leaving free space.
void smooth_path(std::vector<Vector3f>& path, const FreeSpace& space) {
  for (int pass = 0; pass < 60; ++pass)
    for (std::size_t i = 1; i + 1 < path.size(); ++i) {
      const Vector3f moved = 0.5f * path[i] + 0.25f * (path[i - 1] + path[i + 1]);
      const bool is_clear = space.is_free(moved) && space.is_free(0.5f * (moved + path[i - 1])) &&
                            space.is_free(0.5f * (moved + path[i + 1]));
      if (is_clear) path[i] = moved;
    }
}

std::vector<Vector3f> spread_along(const std::vector<Vector3f>& path, std::size_t count) {
  std::vector<float> length_to{0.0f};
  for (std::size_t i = 1; i < path.size(); ++i) length_to.push_back(length_to.back() + (path[i] - path[i - 1]).norm());
  std::vector<Vector3f> out;
  std::size_t leg = 1;
  for (std::size_t i = 0; i < count; ++i) {
    const float at = length_to.back() * (count > 1 ? float(i) / float(count - 1) : 0.0f);
    while (leg + 1 < path.size() && length_to[leg] < at) ++leg;
    if (path.size() < 2) {
      out.push_back(path.front());
      continue;
    }
    const float step = length_to[leg] - length_to[leg - 1];
    const float t = step > 0 ? std::clamp((at - length_to[leg - 1]) / step, 0.0f, 1.0f) : 0.0f;
    out.push_back(path[leg - 1] + t * (path[leg] - path[leg - 1]));
  }
  return out;
}

/// What the camera sees about its axis, as tangents; a little less, so that planned samples are well inside.
struct Frustum {
  float left = 0, right = 0, top = 0, bottom = 0;
  bool is_everything = false;

  explicit Frustum(const Sensor& sensor) {
    const auto* camera = std::get_if<PinholeSensor>(&sensor);
    is_everything = !camera;
    if (!camera) return;
    constexpr double kMargin = 0.97;
    left = float(kMargin * (-0.5 - camera->cx) / camera->fx);
    right = float(kMargin * (camera->width - 0.5 - camera->cx) / camera->fx);
    top = float(kMargin * (-0.5 - camera->cy) / camera->fy);
    bottom = float(kMargin * (camera->height - 0.5 - camera->cy) / camera->fy);
  }

  bool contains(const Vector3f& x_axis, const Vector3f& y_axis, const Vector3f& z_axis, const Vector3f& p) const {
    if (is_everything) return true;
    const float z = z_axis.dot(p);
    if (z <= 0) return false;
    const float x = x_axis.dot(p), y = y_axis.dot(p);
    return x >= left * z && x <= right * z && y >= top * z && y <= bottom * z;
  }
};

struct Gaze {
  Vector3f right, down, forward;
};

std::vector<Gaze> all_gazes() {
  constexpr int kHeadings = 28, kPitches = 9;
  std::vector<Gaze> out;
  for (int p = 0; p < kPitches; ++p)
    for (int h = 0; h < kHeadings; ++h) {
      const float pitch = kPi / 180 * (-60.0f + 15.0f * float(p)), heading = 2 * kPi * float(h) / kHeadings;
      const Vector3f forward(std::cos(pitch) * std::cos(heading), std::cos(pitch) * std::sin(heading), std::sin(pitch));
      const Vector3f right = forward.cross(Vector3f::UnitZ()).normalized();
      out.push_back({right, forward.cross(right), forward});
    }
  return out;
}

/// Chooses a gaze per view: first in the order of the walk, then view by view again, given all the others.
class GazePlanner {
 public:
  GazePlanner(const SurfaceSamples& samples, const Frustum& frustum, const std::vector<Vector3f>& eyes,
              std::vector<std::vector<std::uint32_t>> visible, Context& context)
      : samples_(samples),
        frustum_(frustum),
        eyes_(eyes),
        visible_(std::move(visible)),
        context_(context),
        gazes_(all_gazes()),
        times_seen_(samples.points.size(), 0),
        chosen_(eyes.size(), kNone) {}

  std::vector<Vector3f> plan() {
    for (std::size_t i = 0; i < eyes_.size(); ++i) choose(i);
    constexpr int kPasses = 4;
    for (int pass = 0; pass < kPasses; ++pass)
      for (std::size_t i = 0; i < eyes_.size(); ++i) {
        count(i, -1);
        choose(i);
      }
    std::vector<Vector3f> forward;
    for (const std::size_t gaze : chosen_) forward.push_back(gazes_[gaze].forward);
    return forward;
  }

 private:
  static constexpr std::size_t kNone = std::size_t(-1);

  void count(std::size_t view, int change) {
    const Gaze& gaze = gazes_[chosen_[view]];
    for (const std::uint32_t s : visible_[view])
      if (frustum_.contains(gaze.right, gaze.down, gaze.forward, samples_.points[s] - eyes_[view]))
        times_seen_[s] += change;
  }

  /// Between this view's gaze and that of a neighbour on the walk, over what a hand does on that way: 1 is brisk.
  float turn(std::size_t view, std::size_t gaze, std::size_t neighbor) const {
    if (neighbor >= eyes_.size() || chosen_[neighbor] == kNone) return 0;
    const float cosine = gazes_[gaze].forward.dot(gazes_[chosen_[neighbor]].forward);
    const float allowed = kPi / 180 * (25.0f + 70.0f * (eyes_[view] - eyes_[neighbor]).norm());
    return std::acos(std::clamp(cosine, -1.0f, 1.0f)) / allowed;
  }

  void choose(std::size_t view) {
    // New surface counts most; seeing it again from elsewhere still helps, up to a point.
    constexpr std::array<float, 3> kWorth{1.0f, 0.10f, 0.03f};
    std::vector<std::pair<Vector3f, float>> worth_seeing;
    for (const std::uint32_t s : visible_[view])
      if (times_seen_[s] < int(kWorth.size()))
        worth_seeing.emplace_back(samples_.points[s] - eyes_[view], kWorth[std::size_t(times_seen_[s])]);
    std::vector<float> scores(gazes_.size());
    parallel_for(context_, gazes_.size(), 16, [&](std::size_t g) {
      const Gaze& gaze = gazes_[g];
      float score = 0;
      for (const auto& [point, worth] : worth_seeing)
        if (frustum_.contains(gaze.right, gaze.down, gaze.forward, point)) score += worth;
      const float sharpest = std::max(turn(view, g, view - 1), turn(view, g, view + 1));
      // A turn that is too brisk loses to any that is not, unless all are.
      scores[g] = score / (1 + 0.3f * sharpest * sharpest) - (sharpest > 1 ? 1e6f * sharpest : 0.0f);
    });
    chosen_[view] = std::size_t(std::max_element(scores.begin(), scores.end()) - scores.begin());
    count(view, 1);
  }

  const SurfaceSamples& samples_;
  const Frustum& frustum_;
  const std::vector<Vector3f>& eyes_;
  std::vector<std::vector<std::uint32_t>> visible_;
  Context& context_;
  std::vector<Gaze> gazes_;
  std::vector<int> times_seen_;
  std::vector<std::size_t> chosen_;
};

Eigen::AlignedBox3f walking_box(const SimulatedScene& scene) {
  Eigen::AlignedBox3f box;
  for (const Vector3f& p : scene.mesh.positions_m) box.extend(p);
  const float floor = box.min().z(), ceiling = box.max().z();
  box.min().z() = floor + 0.45f;
  box.max().z() = std::min(floor + 2.15f, ceiling - 0.3f);
  return box;
}

}  // namespace

Poses plan_walk(const SimulatedScene& scene, const SensorRig& rig, const TrajectoryOptions& options, Context& context) {
  if (std::holds_alternative<OrthographicSensor>(rig.sensor))
    throw InvalidInput({}, {}, "trajectory", "a walk needs a perspective or spherical sensor");
  const RayScene rays(scene.mesh.positions_m, scene.mesh.triangles, context);
  constexpr float kClearance_m = 0.25f;
  const FreeSpace space(rays, walking_box(scene), kClearance_m, context);
  if (space.cells().empty()) throw InvalidInput({}, scene.name, "walk", "there is no room to walk in");

  const SurfaceSamples samples = sample_surface(scene.mesh, 14000, options.seed);
  const SightLimits limits{float(std::max(1.1 * rig.effects.min_range_m, 0.5)),
                           float(std::clamp(0.9 * rig.effects.max_range_m, 1.0, 6.0)), 0.2f};
  const CounterRng rng(options.seed, Stream::kTrajectory, 3);
  constexpr std::size_t kCandidates = 240;
  std::vector<std::uint32_t> cells;
  for (std::size_t i = 0; i < kCandidates; ++i) cells.push_back(space.cells()[rng.bits(i) % space.cells().size()]);
  std::sort(cells.begin(), cells.end());
  cells.erase(std::unique(cells.begin(), cells.end()), cells.end());
  std::vector<Vector3f> places;
  for (const std::uint32_t cell : cells) places.push_back(space.center(cell));
  const std::size_t stops = std::clamp<std::size_t>(std::size_t(options.views) / 3, 3, 80);
  std::vector<std::uint32_t> stop_cells;
  std::vector<Vector3f> stop_places;
  for (const std::size_t i :
       choose_places(places, find_visible_from(places, samples, rays, limits, scene.name, context),
                     samples.points.size(), stops)) {
    stop_cells.push_back(cells[i]);
    stop_places.push_back(places[i]);
  }

  const std::vector<std::size_t> tour = order_tour(stop_places);
  std::vector<Vector3f> path{stop_places[tour[0]]};
  for (std::size_t i = 1; i < tour.size(); ++i) {
    const auto leg = space.find_path(stop_cells[tour[i - 1]], stop_cells[tour[i]]);
    path.insert(path.end(), leg.begin() + 1, leg.end());
  }
  smooth_path(path, space);
  const std::vector<Vector3f> eyes = spread_along(path, std::size_t(options.views));
  const Frustum frustum(rig.sensor);
  const std::vector<Vector3f> forward =
      GazePlanner(samples, frustum, eyes, find_visible_from(eyes, samples, rays, limits, scene.name, context), context)
          .plan();

  Poses poses;
  for (std::size_t i = 0; i < eyes.size(); ++i) {
    const Vector3d eye = scene.mesh.origin_m + eyes[i].cast<double>();
    Eigen::Isometry3d T = look_at(rig.sensor, eye, eye + forward[i].cast<double>());
    // The hand is not a tripod: a few degrees about every axis.
    constexpr double kTremor_rad = 0.025;
    const CounterRng hand(options.seed, Stream::kTrajectory, 4, i);
    const Vector3d turn = kTremor_rad * Vector3d(hand.gaussian(0), hand.gaussian(1), hand.gaussian(2));
    T.linear() = T.linear() * Eigen::AngleAxisd(turn.norm(), turn.normalized()).toRotationMatrix();
    poses.push_back(T);
  }
  return poses;
}

}  // namespace lapseam::simulation
