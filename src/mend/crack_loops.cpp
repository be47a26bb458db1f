// Based on: P. Liepa, Filling Holes in Meshes, 2003 (triangulations of an outline).

#include "mend/crack_loops.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>

#include "core/parallel.h"
#include "mesh/longest_edge.h"

namespace lapseam {
namespace {

constexpr float kMostSigma = 1.4f;  // noise of a witness against that of the vertices around
constexpr float kBeyond = 0.5f;     // how far beyond an edge its surface must go on, in sides of its triangle
constexpr float kAnySize = std::numeric_limits<float>::infinity();
constexpr std::size_t kLargestRemnant = 16;  // edges of a loop that may be what is left of a larger one
// What a hole is widened by before it is left as it is.
constexpr int kMostRings = 4;
// Of the measured surface that is taken away around a hole, the area that may have no surface afterwards.
constexpr double kMostLost = 0.2;

// So many are worked out before the first of them is made. The same on every machine, for the mesh depends on it.
constexpr std::size_t kProposals = 512;

/// Begins with its lowest vertex, so that a loop is the same wherever it was met first.
Loop in_order(Loop loop) {
  std::rotate(loop.begin(), std::min_element(loop.begin(), loop.end()), loop.end());
  return loop;
}

}  // namespace

CrackLoops::CrackLoops(LiveMesh& mesh, TriangleCheck& check, const Layers& layers, const Witnesses& witnesses,
                       VertexNoise noise, CloseCracksReport& report, Context& context)
    : mesh_(mesh),
      check_(check),
      layers_(layers),
      witnesses_(witnesses),
      noise_(noise),
      report_(report),
      context_(context) {}

void CrackLoops::close(std::size_t longest, const TriangleRule& rule) {
  const std::vector<Judged> judged = judged_loops(longest);
  const auto cracks =
      std::uint64_t(std::count_if(judged.begin(), judged.end(), [](const Judged& j) { return j.is_crack(); }));
  report_.crack_loops = std::max(report_.crack_loops, cracks);
  report_.loops_closed += close_each(judged, rule, Extent::kWhole);
}

void CrackLoops::fill(const TriangleRule& rule) {
  std::vector<Judged> judged = judged_loops(kLongestLoop);
  std::erase_if(judged, [](const Judged& j) { return !j.is_crack(); });
  has_filled_parts_ = true;
  report_.loops_filled += close_each(judged, rule, Extent::kParts);
}

std::vector<CrackLoops::Judged> CrackLoops::judged_loops(std::size_t longest) const {
  std::vector<Loop> loops = trace_loops(mesh_, open_edges(mesh_, context_));
  std::erase_if(loops, [&](const Loop& loop) { return loop.size() > longest; });
  std::vector<Judged> judged(loops.size());
  parallel_for(context_, loops.size(), 4, [&](std::size_t i) {
    judged[i] = judge(loops[i]);
    witnesses_.relieve();
  });
  std::stable_sort(judged.begin(), judged.end(),
                   [](const Judged& a, const Judged& b) { return a.loop.size() < b.loop.size(); });
  return judged;
}

// What many would do is worked out at the same time, on drafts; few get in each other's way.
std::size_t CrackLoops::close_each(std::span<const Judged> judged, const TriangleRule& rule, Extent extent) {
  std::size_t closed = 0;
  std::vector<Proposal> proposals(kProposals);
  for (std::size_t begin = 0; begin < judged.size(); begin += kProposals) {
    const std::size_t count = std::min(kProposals, judged.size() - begin);
    parallel_for(context_, count, 1, [&](std::size_t i) {
      proposals[i] = propose(judged[begin + i], rule, extent);
      witnesses_.relieve();
    });
    for (std::size_t i = 0; i < count; ++i) {
      const std::size_t first = mesh_.triangle_count();
      if (!close_as_proposed(judged[begin + i], proposals[i], rule, extent)) continue;
      ++closed;
      for (std::size_t t = first; t < mesh_.triangle_count(); ++t)
        report_.loop_triangles += mesh_.is_alive(std::uint32_t(t));
    }
  }
  return closed;
}

std::vector<std::uint32_t> CrackLoops::views_of(std::span<const std::uint32_t> vertices) const {
  Eigen::AlignedBox3f box;
  for (const std::uint32_t v : vertices) box.extend(mesh_.position(v));
  return witnesses_.find_views(box.center(), 0.5f * box.diagonal().norm());
}

CrackLoops::Judged CrackLoops::judge(const Loop& loop) const {
  Judged out{loop, views_of(loop), 0};
  float length = 0, cracked = 0;
  for (std::size_t i = 0; i < loop.size(); ++i) {
    const std::uint32_t a = loop[i], b = loop[(i + 1) % loop.size()];
    const float side = (mesh_.position(b) - mesh_.position(a)).norm();
    length += side;
    if (goes_on_beyond(a, b, out.views)) cracked += side;
  }
  out.crack_share = length > 0 ? cracked / length : 0;
  return out;
}

bool CrackLoops::goes_on_beyond(std::uint32_t a, std::uint32_t b, std::span<const std::uint32_t> views) const {
  const std::uint32_t t = mesh_.find(a, b);
  const Eigen::Vector3f p = mesh_.position(a), q = mesh_.position(b);
  const Eigen::Vector3f normal = mesh_.area_normal(t).stableNormalized().cast<float>();
  const Eigen::Vector3f outward = (q - p).cross(normal).stableNormalized();
  const Triangle& c = mesh_.triangle(t);
  std::array<float, 3> sides;
  for (std::size_t k = 0; k < 3; ++k) sides[k] = (mesh_.position(c[k]) - mesh_.position(c[(k + 1) % 3])).norm();
  std::sort(sides.begin(), sides.end());
  const Eigen::Vector3f beyond = 0.5f * (p + q) + kBeyond * sides[1] * outward;
  const float error = std::max(noise_.error_m[a], noise_.error_m[b]);
  return is_confirmed(witnesses_.ask(views, beyond, normal, error, kAnySize),
                      std::max(noise_.sigma_m[a], noise_.sigma_m[b]));
}

// A view that is much less sure than those that measured the surroundings sees surface everywhere near one.
bool CrackLoops::is_confirmed(const Hearing& hearing, float sigma_m) const {
  return hearing.is_surface() && hearing.surface_sigma_m <= kMostSigma * sigma_m;
}

// Whether a view that can tell looked through a triangle, or none saw it.
bool CrackLoops::is_contradicted(const Triangle& t, std::span<const std::uint32_t> views, Confirmed where,
                                 float size_m) const {
  constexpr int kSteps = 4;
  const Eigen::Vector3f normal = mesh_.area_normal(t).stableNormalized().cast<float>();
  const float error = layers_.error_of(t);
  const float sigma = std::max({noise_.sigma_m[t[0]], noise_.sigma_m[t[1]], noise_.sigma_m[t[2]]});
  for (int i = 1; i < kSteps; ++i)
    for (int j = 1; i + j < kSteps; ++j) {
      const Eigen::Vector3f p = (float(i) * mesh_.position(t[0]) + float(j) * mesh_.position(t[1]) +
                                 float(kSteps - i - j) * mesh_.position(t[2])) /
                                kSteps;
      const Hearing hearing = witnesses_.ask(views, p, normal, error, size_m);
      if (hearing.is_empty()) return true;
      if (where == Confirmed::kEverywhere && !is_confirmed(hearing, sigma)) return true;
    }
  const Eigen::Vector3f middle = (mesh_.position(t[0]) + mesh_.position(t[1]) + mesh_.position(t[2])) / 3;
  return !is_confirmed(witnesses_.ask(views, middle, normal, error, size_m), sigma);
}

bool CrackLoops::is_open(const Loop& loop) const {
  for (std::size_t i = 0; i < loop.size(); ++i)
    if (!mesh_.is_open(loop[i], loop[(i + 1) % loop.size()])) return false;
  return true;
}

bool CrackLoops::is_hopeless(const Loop& loop, const TriangleRule& rule, Extent extent) const {
  return hopeless_.contains({extent, rule.fold_cosine, in_order(loop)});
}

CrackLoops::Proposal CrackLoops::propose(const Judged& judged, const TriangleRule& rule, Extent extent) const {
  Proposal proposal;
  if (is_hopeless(judged.loop, rule, extent) || !is_open(judged.loop)) return proposal;
  LiveMesh draft = LiveMesh::draft_of(mesh_);
  TriangleCheck check(draft, check_);
  const Layers layers(draft, check, layers_);
  CloseCracksReport report;
  CrackLoops loops(draft, check, layers, witnesses_, noise_, report, context_);
  loops.has_filled_parts_ = has_filled_parts_;
  proposal.is_made = loops.close_one(judged, rule, extent);
  if (!proposal.is_made) return proposal;
  proposal.removed = draft.removed();
  for (auto t = std::uint32_t(mesh_.triangle_count()); t < draft.triangle_count(); ++t)
    if (draft.is_alive(t)) proposal.added.push_back(draft.triangle(t));
  return proposal;
}

bool CrackLoops::close_as_proposed(const Judged& judged, const Proposal& proposal, const TriangleRule& rule,
                                   Extent extent) {
  if (!is_open(judged.loop)) return false;  // an earlier loop took an edge
  if (proposal.is_made && (apply(proposal, rule) || close_one(judged, rule, extent))) return true;
  hopeless_.insert({extent, rule.fold_cosine, in_order(judged.loop)});
  return false;
}

// False, and nothing changes, where an earlier one is in its way.
bool CrackLoops::apply(const Proposal& proposal, const TriangleRule& rule) {
  const auto is_alive = [&](std::uint32_t t) { return mesh_.is_alive(t); };
  if (!std::all_of(proposal.removed.begin(), proposal.removed.end(), is_alive)) return false;
  const std::size_t first = mesh_.triangle_count();
  for (const std::uint32_t t : proposal.removed) mesh_.remove(t);
  for (const Triangle& t : proposal.added) {
    if (!check_.is_valid(t, rule)) {
      remove_since(first);
      for (const std::uint32_t gone : proposal.removed) mesh_.restore(gone);
      return false;
    }
    check_.add(t, TriangleTag::kSeam);
  }
  report_.triangles_replaced += proposal.removed.size();
  return true;
}

bool CrackLoops::close_one(const Judged& judged, const TriangleRule& rule, Extent extent) {
  // An outline along which nothing goes on is where the surface ends, unless all that is within it was measured.
  const Confirmed where = judged.is_crack() ? Confirmed::kInTheMiddle : Confirmed::kEverywhere;
  // There are many ways to fill parts, and one of them, or what closes the small loops that they leave, leads up a step
  // that noise hides.
  const bool is_by_size = extent == Extent::kParts || (has_filled_parts_ && judged.loop.size() <= kLargestRemnant);
  // The same triangles are asked about again and again while triangulations are tried.
  std::map<Triangle, bool> known;
  check_.set_condition([&](const Triangle& t) {
    const auto [place, is_new] = known.try_emplace(t, false);
    const float size_m = is_by_size ? longest_edge(mesh_.positions(), t) : kAnySize;
    if (is_new) place->second = !is_contradicted(t, judged.views, where, size_m);
    return place->second;
  });
  bool is_closed = false;
  if (extent == Extent::kParts) {
    is_closed = fill_loop(mesh_, check_, judged.loop, LoopGoal::kArea, rule, TriangleTag::kSeam) > 0;
  } else {
    is_closed = close_loop(mesh_, check_, judged.loop, LoopGoal::kArea, rule, TriangleTag::kSeam, LoopEffort::kQuick) ||
                (judged.crack_share > 0 && widen_and_close(judged, rule));
  }
  check_.set_condition({});
  return is_closed;
}

// Where a triangle at the border is folded into the hole, or lies across it, nothing fits in: what is around the hole
// goes, ring by ring, until the larger hole can be closed.
bool CrackLoops::widen_and_close(const Judged& judged, const TriangleRule& rule) {
  std::vector<std::uint32_t> removed;
  std::vector<Loop> outlines = {judged.loop};
  const std::size_t first = mesh_.triangle_count();
  for (int ring = 0; ring < kMostRings; ++ring) {
    const std::size_t before = removed.size();
    for (const Loop& outline : outlines)
      for (std::size_t i = 0; i < outline.size(); ++i) {
        const std::uint32_t t = mesh_.find(outline[i], outline[(i + 1) % outline.size()]);
        if (t == kInvalidIndex) continue;  // it had two edges of the outline
        mesh_.remove(t);
        removed.push_back(t);
      }
    if (removed.size() == before) break;
    outlines = outlines_of(removed);
    if (outlines.empty()) break;
    if (close_all(outlines, rule) && keeps_surface(removed, judged.views)) {
      report_.triangles_replaced += removed.size();
      return true;
    }
    remove_since(first);
  }
  for (const std::uint32_t t : removed) mesh_.restore(t);
  return false;
}

// Of the hole that is left when triangles are gone; none where one is too long.
std::vector<Loop> CrackLoops::outlines_of(std::span<const std::uint32_t> removed) const {
  std::vector<std::array<std::uint32_t, 2>> edges;
  for (const std::uint32_t t : removed)
    for (std::size_t k = 0; k < 3; ++k) {
      const std::uint32_t a = mesh_.triangle(t)[k], b = mesh_.triangle(t)[(k + 1) % 3];
      if (mesh_.is_open(b, a)) edges.push_back({b, a});
    }
  std::vector<Loop> outlines = trace_loops(mesh_, edges);
  if (std::any_of(outlines.begin(), outlines.end(), [](const Loop& loop) { return loop.size() > kLongestLoop; }))
    outlines.clear();
  return outlines;
}

bool CrackLoops::close_all(std::span<const Loop> loops, const TriangleRule& rule) {
  return std::all_of(loops.begin(), loops.end(), [&](const Loop& loop) {
    return is_open(loop) &&
           close_loop(mesh_, check_, loop, LoopGoal::kArea, rule, TriangleTag::kSeam, LoopEffort::kQuick);
  });
}

// Whether what was taken away, as far as views measured it, has a surface where it was: thin parts must not go.
bool CrackLoops::keeps_surface(std::span<const std::uint32_t> removed, std::span<const std::uint32_t> views) const {
  double all = 0, lost = 0;
  for (const std::uint32_t t : removed) {
    if (is_contradicted(mesh_.triangle(t), views, Confirmed::kInTheMiddle, kAnySize)) continue;
    const double area = mesh_.area_normal(t).norm();
    all += area;
    if (!layers_.has_surface_at(mesh_.triangle(t))) lost += area;
  }
  return lost <= kMostLost * all;
}

void CrackLoops::remove_since(std::size_t first) {
  for (auto t = std::uint32_t(first); t < mesh_.triangle_count(); ++t)
    if (mesh_.is_alive(t)) mesh_.remove(t);
}

void CrackLoops::fill_corners(const TriangleRule& rule) {
  check_.set_condition([&](const Triangle& t) {
    return !is_contradicted(t, views_of(t), Confirmed::kInTheMiddle, kAnySize) &&
           !layers_.is_covered(t, Layers::Places::kSpread);
  });
  for (const Loop& loop : trace_loops(mesh_, open_edges(mesh_, context_))) {
    context_.throw_if_cancelled();
    witnesses_.relieve();
    if (is_open(loop)) report_.corners_filled += cut_ears(mesh_, check_, loop, rule, TriangleTag::kSeam);
  }
  check_.set_condition({});
}

}  // namespace lapseam
