#include "sew_meshes/seam.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <queue>

#include "lapseam/context.h"

namespace lapseam {
namespace {

// Rounds search farther and accept more; the first ones take only well-shaped triangles in an undisturbed layer.
constexpr int kRounds = 5;
constexpr float kReach[kRounds] = {1.6f, 2.5f, 4.0f, 6.0f, 6.0f};  // × spacing
constexpr double kSmallestSine[kRounds] = {0.34, 0.25, 0.17, 0.09, 0.02};
constexpr double kFoldCosine[kRounds] = {0.2, 0.0, -0.2, -0.4, -0.6};
constexpr double kFacingCosine[kRounds] = {0.5, 0.35, 0.2, 0.1, 0.0};
constexpr double kSlack[kRounds] = {0.03, 0.06, 0.1, 0.2, 0.3};
constexpr int kFirstFarRound = 2;  // from here on, disagreement adds to the reach
// Loops are closed by what fits best; a fold sharper than this is worse than a crack.
constexpr TriangleRule kLoopRule = {.smallest_sine = 0.003, .fold_cosine = -0.6, .facing_cosine = -0.3};
constexpr std::size_t kLargestCrack = 400;
constexpr int kWidenings = 8;
constexpr int kFlipPasses = 8;
constexpr double kFlipGain = 1e-3;  // of the smaller sine, so that flips end
constexpr double kFlipFoldCosine = 0.5;

}  // namespace

Seam::Seam(LiveMesh& mesh, std::span<const Eigen::Vector3f> normals, std::span<const float> spacing_m, float layer_m,
           Context& context)
    : mesh_(mesh),
      normals_(normals),
      spacing_m_(spacing_m),
      layer_m_(layer_m),
      context_(context),
      check_(mesh, normals, context) {}

TriangleRule Seam::rule_of(int round) const {
  return {.smallest_sine = kSmallestSine[round],
          .fold_cosine = kFoldCosine[round],
          .facing_cosine = kFacingCosine[round],
          .layer_m = layer_m_,
          .slack = kSlack[round]};
}

bool Seam::find_best(const Edge& edge, int round, Candidate& best) const {
  const auto [a, b] = edge;
  const Eigen::Vector3f &pa = mesh_.position(a), &pb = mesh_.position(b);
  const float spacing = std::max((pa - pb).norm(), 0.5f * (spacing_m_[a] + spacing_m_[b]));
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
      Candidate found;
      if (find_best(edge, round, found))
        queue.push(found);
      else
        left.push_back(edge);
    };
    for (const Edge& edge : active)
      if (mesh_.is_open(edge[0], edge[1])) seek(edge);
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
  // A loop that is mostly a border of the input is one still; what was added to it only made it smoother.
  std::erase_if(loops, [&](const Loop& loop) {
    std::size_t cut = 0;
    for (std::size_t i = 0; i < loop.size(); ++i) cut += mesh_.is_cut(loop[i], loop[(i + 1) % loop.size()]);
    return 2 * cut < loop.size() || loop.size() > kLargestCrack;
  });
  return loops;
}

void Seam::close_loops(SewMeshesReport& report) {
  for (const Loop& loop : find_cracks()) {
    context_.throw_if_cancelled();
    // An earlier loop may have taken an edge.
    bool is_open = true;
    for (std::size_t i = 0; is_open && i < loop.size(); ++i)
      is_open = mesh_.is_open(loop[i], loop[(i + 1) % loop.size()]);
    if (is_open && close_loop(mesh_, check_, loop, LoopGoal::kShape, kLoopRule, TriangleTag::kSeam))
      report.loop_triangles += loop.size() - 2;
  }
}

void Seam::widen(const std::vector<Loop>& cracks, int attempt, SewMeshesReport& report) {
  // First what sewing made goes, then rings of what was measured.
  std::vector<std::uint32_t> vertices;
  for (const Loop& loop : cracks) vertices.insert(vertices.end(), loop.begin(), loop.end());
  for (int ring = 0; ring < 1 + attempt / 2; ++ring) {
    std::vector<std::uint32_t> doomed;
    for (const std::uint32_t v : vertices)
      mesh_.for_each_around(v, [&](std::uint32_t t) {
        if (attempt > 0 || mesh_.tag(t) == TriangleTag::kSeam) doomed.push_back(t);
      });
    std::sort(doomed.begin(), doomed.end());
    doomed.erase(std::unique(doomed.begin(), doomed.end()), doomed.end());
    for (const std::uint32_t t : doomed) {
      for (const std::uint32_t v : mesh_.triangle(t)) vertices.push_back(v);
      report.removed_to_repair += mesh_.tag(t) != TriangleTag::kSeam;
      mesh_.remove(t);
    }
  }
}

void Seam::close(SewMeshesReport& report) {
  grow(report);
  close_loops(report);
  for (int attempt = 0; attempt < kWidenings; ++attempt) {
    const std::vector<Loop> cracks = find_cracks();
    if (cracks.empty()) break;
    report.cracks_widened += cracks.size();
    widen(cracks, attempt, report);
    close_loops(report);
    grow(report);
    close_loops(report);
  }
  improve(report);
  for (const Loop& crack : find_cracks()) report.open_edges += crack.size();
}

bool Seam::flip(std::uint32_t a, std::uint32_t b) {
  const std::uint32_t left = mesh_.find(a, b), right = mesh_.find(b, a);
  if (left == kInvalidIndex || right == kInvalidIndex) return false;
  if (mesh_.tag(left) != TriangleTag::kSeam || mesh_.tag(right) != TriangleTag::kSeam) return false;
  const std::uint32_t c = mesh_.apex(left, a, b), d = mesh_.apex(right, a, b);
  if (mesh_.find(c, d) != kInvalidIndex || mesh_.find(d, c) != kInvalidIndex) return false;
  const auto sine = [&](std::uint32_t x, std::uint32_t y, std::uint32_t z) {
    return smallest_sine(mesh_.position(x), mesh_.position(y), mesh_.position(z));
  };
  const double before = std::min(sine(a, b, c), sine(a, b, d)), after = std::min(sine(a, d, c), sine(d, b, c));
  if (after < before + kFlipGain) return false;
  const Triangle first = {a, d, c}, second = {d, b, c};
  const Eigen::Vector3d n = mesh_.area_normal(first), m = mesh_.area_normal(second);
  if (n.dot(m) < kFlipFoldCosine * n.norm() * m.norm()) return false;
  mesh_.remove(left);
  mesh_.remove(right);
  const TriangleRule rule = {.fold_cosine = 0.0, .facing_cosine = 0.0};
  if (check_.is_valid(first, rule)) {
    const std::uint32_t added = check_.add(first, TriangleTag::kSeam);
    if (check_.is_valid(second, rule)) {
      check_.add(second, TriangleTag::kSeam);
      return true;
    }
    mesh_.remove(added);
  }
  mesh_.restore(left);
  mesh_.restore(right);
  return false;
}

void Seam::improve(SewMeshesReport& report) {
  for (int pass = 0; pass < kFlipPasses; ++pass) {
    context_.throw_if_cancelled();
    std::uint64_t flips = 0;
    const auto end = std::uint32_t(mesh_.triangle_count());
    for (std::uint32_t t = 0; t < end; ++t) {
      if (!mesh_.is_alive(t) || mesh_.tag(t) != TriangleTag::kSeam) continue;
      const Triangle c = mesh_.triangle(t);
      for (std::size_t k = 0; k < 3 && mesh_.is_alive(t); ++k)
        if (flip(c[k], c[(k + 1) % 3])) ++flips;
    }
    report.flips += flips;
    if (flips == 0) break;
  }
}

}  // namespace lapseam
