#include "sew_meshes/seam.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <queue>

#include "core/parallel.h"
#include "sew_meshes/seam_shape.h"

namespace lapseam {
namespace {

// Rounds search farther and accept more; the first ones take only well-shaped triangles in an undisturbed layer.
constexpr int kRounds = 5;
constexpr float kReach[kRounds] = {1.6f, 2.5f, 4.0f, 6.0f, 6.0f};  // × spacing
constexpr double kSmallestSine[kRounds] = {0.34, 0.25, 0.17, 0.09, 0.02};
constexpr double kFoldCosine[kRounds] = {0.2, 0.0, -0.2, -0.4, -0.6};
constexpr double kFacingCosine[kRounds] = {0.5, 0.35, 0.2, 0.1, 0.0};
constexpr double kCornerCosine = -0.5;  // corners that face apart by more are on two sides of a sheet
constexpr double kSlack[kRounds] = {0.03, 0.06, 0.1, 0.2, 0.3};
// A seam goes where an input had a surface: within this many layers' distance, and up to this share of the spacing
// beyond its border. Where there is none this far beyond an edge, the edge is a border like those of the inputs.
constexpr float kCoverFactor = 2;
constexpr float kBesideBorder = 0.3f;
constexpr float kBeyond = 0.3f;
constexpr int kFirstFarRound = 2;  // from here on, disagreement adds to the reach
// Loops are closed by what fits best; a fold sharper than this is worse than a crack.
constexpr TriangleRule kLoopRule = {
    .smallest_sine = 0.003, .fold_cosine = -0.6, .facing_cosine = -0.3, .corner_cosine = kCornerCosine};
// In a tangle of surfaces, where normals mean nothing, a small loop that withstood is closed by whatever meets nothing.
constexpr TriangleRule kLooseRule = {.smallest_sine = 1e-3, .fold_cosine = -0.95};
constexpr int kFirstLooseAttempt = 2;
constexpr std::size_t kLargestLoose = 24;
constexpr std::size_t kLargestCrack = 400;
// Most gaps need one or two; where surfaces run through each other, twelve leave some that thirty do not.
constexpr int kWidenings = 30;
constexpr int kFirstTangleAttempt = 3;
constexpr float kTangleReach = 2;  // × spacing
constexpr int kPinchWidenings = 2;

}  // namespace

Seam::Seam(LiveMesh& mesh, const MergedMeshes& merged, const SurfaceProbes& probes, float layer_m, Context& context)
    : mesh_(mesh),
      merged_(merged),
      probes_(probes),
      layer_m_(layer_m),
      context_(context),
      check_(mesh, merged.normals, context),
      first_seam_(std::uint32_t(mesh.triangle_count())) {
  check_.set_condition([this](const Triangle& t) { return is_covered(t); });
}

bool Seam::is_covered(const Triangle& t) const {
  const Eigen::Vector3f center = (mesh_.position(t[0]) + mesh_.position(t[1]) + mesh_.position(t[2])) / 3;
  const float spacing = (merged_.spacing_m[t[0]] + merged_.spacing_m[t[1]] + merged_.spacing_m[t[2]]) / 3;
  const Eigen::Vector3f normal = mesh_.area_normal(t).stableNormalized().cast<float>();
  return is_surface_at(probes_, center, normal, kCoverFactor * layer_m_, kBesideBorder * spacing);
}

bool Seam::goes_on_beyond(const Edge& edge) const {
  const Eigen::Vector3f a = mesh_.position(edge[0]), b = mesh_.position(edge[1]);
  const Eigen::Vector3f normal = mesh_.area_normal(mesh_.find(edge[0], edge[1])).stableNormalized().cast<float>();
  const float spacing = std::max((b - a).norm(), 0.5f * (merged_.spacing_m[edge[0]] + merged_.spacing_m[edge[1]]));
  const Eigen::Vector3f outward = (b - a).cross(normal).stableNormalized();
  return is_surface_at(probes_, 0.5f * (a + b) + kBeyond * spacing * outward, normal, layer_m_, 0);
}

TriangleRule Seam::rule_of(int round) const {
  return {.smallest_sine = kSmallestSine[round],
          .fold_cosine = kFoldCosine[round],
          .facing_cosine = kFacingCosine[round],
          .corner_cosine = kCornerCosine,
          .layer_m = layer_m_,
          .slack = kSlack[round]};
}

bool Seam::find_best(const Edge& edge, int round, Candidate& best) const {
  const auto [a, b] = edge;
  const Eigen::Vector3f &pa = mesh_.position(a), &pb = mesh_.position(b);
  const float spacing = std::max((pa - pb).norm(), 0.5f * (merged_.spacing_m[a] + merged_.spacing_m[b]));
  const float radius = kReach[round] * spacing + (round >= kFirstFarRound ? 2 * layer_m_ : 0.0f);
  std::vector<Neighbor> around;
  tree_->find_in_radius(0.5f * (pa + pb), radius, around);
  const TriangleRule rule = rule_of(round);
  std::vector<Candidate> candidates;
  for (const Neighbor& neighbor : around) {
    const std::uint32_t c = border_[neighbor.index];
    if (c == a || c == b) continue;
    const Eigen::Vector3f& pc = mesh_.position(c);
    const double sine = smallest_sine(pa, pb, pc);
    if (sine < rule.smallest_sine) continue;
    const double cosine = double((pa - pc).normalized().dot((pb - pc).normalized()));
    candidates.push_back({sine, cosine, a, b, c});
  }
  std::sort(candidates.begin(), candidates.end(), [](const Candidate& x, const Candidate& y) {
    return x.cosine != y.cosine ? x.cosine < y.cosine : x.c < y.c;
  });
  for (const Candidate& candidate : candidates)
    if (mesh_.is_on_border(candidate.c) && check_.is_valid({b, a, candidate.c}, rule)) {
      best = candidate;
      return true;
    }
  return false;
}

void Seam::grow(SewMeshesReport& report) {
  std::vector<Edge> active = mesh_.cut_edges();
  std::erase_if(active, [&](const Edge& edge) { return !goes_on_beyond(edge); });
  if (active.empty()) return;
  border_.clear();
  std::vector<Eigen::Vector3f> points;
  for (std::uint32_t v = 0; v < mesh_.vertex_count(); ++v)
    if (mesh_.is_on_border(v)) {
      border_.push_back(v);
      points.push_back(mesh_.position(v));
    }
  tree_ = std::make_unique<KdTree>(points);
  for (int round = 0; round < kRounds; ++round) {
    context_.throw_if_cancelled();
    std::priority_queue<Candidate> queue;
    std::vector<Edge> left;
    const auto seek = [&](const Edge& edge) {
      Candidate best;
      if (find_best(edge, round, best))
        queue.push(best);
      else
        left.push_back(edge);
    };
    // The search for the first candidates is most of the work, and reads only.
    std::vector<Candidate> first(active.size());
    std::vector<std::uint8_t> found(active.size(), 0);
    parallel_for(context_, active.size(), 64, [&](std::size_t i) {
      found[i] = mesh_.is_open(active[i][0], active[i][1]) && find_best(active[i], round, first[i]);
    });
    for (std::size_t i = 0; i < active.size(); ++i) {
      if (found[i])
        queue.push(first[i]);
      else
        left.push_back(active[i]);
    }
    while (!queue.empty()) {
      const Candidate next = queue.top();
      queue.pop();
      if (!mesh_.is_open(next.a, next.b)) continue;
      const Triangle t = {next.b, next.a, next.c};
      if (!mesh_.is_on_border(next.c) || !check_.is_valid(t, rule_of(round))) {
        seek({next.a, next.b});
        continue;
      }
      check_.add(t, TriangleTag::kSeam);
      ++report.front_triangles;
      for (std::size_t k = 1; k < 3; ++k)
        if (mesh_.is_open(t[k], t[(k + 1) % 3])) seek({t[k], t[(k + 1) % 3]});
      if ((report.front_triangles & 1023) == 0) context_.throw_if_cancelled();
    }
    active.swap(left);
  }
}

std::vector<Loop> Seam::find_cracks() const {
  const std::vector<Edge> edges = mesh_.cut_edges();
  std::vector<Loop> loops = trace_loops(mesh_, edges);
  // Where no surface went on, the loop is a border; what was added to it only made it smoother.
  std::erase_if(loops, [&](const Loop& loop) {
    std::size_t cracked = 0;
    for (std::size_t i = 0; i < loop.size(); ++i) {
      const Edge edge = {loop[i], loop[(i + 1) % loop.size()]};
      cracked += mesh_.is_cut(edge[0], edge[1]) && goes_on_beyond(edge);
    }
    return 2 * cracked < loop.size() || loop.size() > kLargestCrack;
  });
  return loops;
}

void Seam::close_loops(int attempt, SewMeshesReport& report) {
  for (const Loop& loop : find_cracks()) {
    context_.throw_if_cancelled();
    // An earlier loop may have taken an edge.
    bool is_open = true;
    for (std::size_t i = 0; is_open && i < loop.size(); ++i)
      is_open = mesh_.is_open(loop[i], loop[(i + 1) % loop.size()]);
    if (!is_open) continue;
    bool is_closed = close_loop(mesh_, check_, loop, LoopGoal::kShape, kLoopRule, TriangleTag::kSeam);
    if (!is_closed && attempt >= kFirstLooseAttempt && loop.size() <= kLargestLoose) {
      check_.set_condition({});
      is_closed = close_loop(mesh_, check_, loop, LoopGoal::kShape, kLooseRule, TriangleTag::kSeam);
      check_.set_condition([this](const Triangle& t) { return is_covered(t); });
    }
    if (is_closed) report.loop_triangles += loop.size() - 2;
  }
}

/// Triangles near a loop that run through others: nothing can be sewn to them without meeting what they run through.
std::vector<std::uint32_t> Seam::find_tangle(const Loop& crack) const {
  Box box;
  float spacing = 0;
  for (const std::uint32_t v : crack) {
    box.extend(mesh_.position(v));
    spacing = std::max(spacing, merged_.spacing_m[v]);
  }
  box.low.array() -= kTangleReach * spacing;
  box.high.array() += kTangleReach * spacing;
  std::vector<std::uint32_t> tangle;
  for (const std::uint32_t t : check_.find_near(box))
    if (!check_.is_clear(mesh_.triangle(t), {})) tangle.push_back(t);
  return tangle;
}

void Seam::widen(const std::vector<Loop>& cracks, int attempt, SewMeshesReport& report) {
  // First what sewing made goes, then a ring of what was measured, then what is tangled.
  std::vector<std::uint32_t> doomed;
  for (const Loop& loop : cracks) {
    for (const std::uint32_t v : loop)
      mesh_.for_each_around(v, [&](std::uint32_t t) {
        if (attempt > 0 || mesh_.tag(t) == TriangleTag::kSeam) doomed.push_back(t);
      });
    if (attempt < kFirstTangleAttempt) continue;
    const std::vector<std::uint32_t> tangle = find_tangle(loop);
    doomed.insert(doomed.end(), tangle.begin(), tangle.end());
  }
  for (const std::uint32_t t : doomed) {
    if (!mesh_.is_alive(t)) continue;
    report.removed_to_repair += mesh_.tag(t) != TriangleTag::kSeam;
    mesh_.remove(t);
  }
}

std::vector<Loop> Seam::find_pinches() const {
  std::vector<Loop> pinches;
  for (std::uint32_t v = 0; v < mesh_.vertex_count(); ++v)
    if (mesh_.is_touched(v) && mesh_.count_fans(v) > 1) pinches.push_back({v});
  return pinches;
}

bool Seam::cut_loose_ends() {
  bool is_any = false;
  for (bool is_done = false; !is_done;) {
    is_done = true;
    for (const Loop& pinch : find_pinches()) {
      std::vector<std::uint32_t> at_border, seam, doomed;
      mesh_.for_each_around(pinch[0], [&](std::uint32_t t) {
        const Triangle& c = mesh_.triangle(t);
        const bool is_at_border = mesh_.is_open(c[0], c[1]) || mesh_.is_open(c[1], c[2]) || mesh_.is_open(c[2], c[0]);
        const bool is_seam = mesh_.tag(t) == TriangleTag::kSeam;
        if (is_at_border) at_border.push_back(t);
        if (is_seam) seam.push_back(t);
        if (is_at_border && is_seam) doomed.push_back(t);
      });
      if (doomed.empty()) doomed = at_border.empty() ? seam : at_border;
      for (const std::uint32_t t : doomed) mesh_.remove(t);
      is_done = is_done && doomed.empty();
      is_any = is_any || !doomed.empty();
    }
  }
  return is_any;
}

void Seam::close(SewMeshesReport& report) {
  grow(report);
  close_loops(0, report);
  for (int attempt = 0; attempt < kWidenings; ++attempt) {
    // A fan that touches another is first cut free and sewn again, later only cut free.
    if (attempt >= kPinchWidenings) cut_loose_ends();
    std::vector<Loop> defects = find_cracks();
    if (attempt < kPinchWidenings)
      for (Loop& pinch : find_pinches()) defects.push_back(std::move(pinch));
    if (defects.empty() && attempt >= kPinchWidenings) break;
    report.defects_widened += defects.size();
    widen(defects, attempt, report);
    close_loops(attempt, report);
    grow(report);
    close_loops(attempt, report);
  }
  cut_loose_ends();
  const SeamShape::Changes changes = SeamShape(mesh_, check_, 0, context_).improve(first_seam_);
  report.flips += changes.flips;
  report.collapses += changes.collapses;
  for (const Loop& crack : find_cracks()) report.open_edges += crack.size();
}

}  // namespace lapseam
