// Based on: P. Liepa, Filling Holes in Meshes, 2003 (triangulations of an outline).

#include "lapseam/close_cracks.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "core/parallel.h"
#include "mend/trim.h"
#include "mend/witnesses.h"
#include "patch/by_view.h"
#include "sew_meshes/loops.h"
#include "sew_meshes/merged.h"
#include "sew_meshes/seam_shape.h"

namespace lapseam {
namespace {

// Longer outlines are gaps between two pieces, or have holes in them: no disk closes them.
constexpr std::size_t kLongestLoop = 64;
constexpr TriangleRule kRule = {.smallest_sine = 1e-3, .fold_cosine = -0.7};
// Where nothing better fits: slits of a few edges with a fold in them.
constexpr TriangleRule kSlitRule = {.smallest_sine = 1e-4, .fold_cosine = -0.95};
constexpr std::size_t kLongestSlit = 16;
constexpr float kCrackShare = 0.5f;
constexpr float kMostSigma = 1.4f;  // noise of a witness against that of the vertices around
constexpr float kBeyond = 0.5f;     // how far beyond an edge its surface must go on, in sides of its triangle

class CrackCloser {
 public:
  CrackCloser(Mesh& mesh, std::span<const Patch> patches, const OverlapOptions& options, Context& context)
      : context_(context),
        options_(options),
        patches_(patches),
        witnesses_(patches, mesh.origin_m, options),
        normals_(measure_vertices(mesh).normals),
        mesh_(mesh),
        check_(mesh_, normals_, context),
        error_m_(expected_errors(mesh, patches)) {
    sigma_m_.resize(mesh.vertex_count());
    const VerticesByView vertices(mesh, patches.size());
    for (std::size_t i = 0; i < patches.size(); ++i) {
      for (const std::uint32_t v : vertices.of(i))
        sigma_m_[v] = witnesses_.sigma_of(std::uint32_t(i), mesh.vertex_pixel[v]);
      relieve(patches[i]);
    }
  }

  CloseCracksReport run() {
    report_.covered_triangles_removed = trim_double_layers(mesh_, check_, error_m_, options_, context_);
    close_loops(kLongestLoop, kRule);
    close_loops(kLongestSlit, kSlitRule);
    const SeamShape::Changes changes = SeamShape(mesh_, check_, context_).improve(0);
    report_.flips = changes.flips;
    report_.collapses = changes.collapses;
    return report_;
  }

  const std::vector<std::uint8_t>& alive() const { return mesh_.alive(); }

 private:
  /// A loop, the views that may see it, and along how much of it one of them measured the surface going on.
  struct Judged {
    Loop loop;
    std::vector<std::uint32_t> views;
    float crack_share = 0;
  };

  Judged judge(const Loop& loop) const {
    Judged out{loop, {}, 0};
    Eigen::AlignedBox3f box;
    for (const std::uint32_t v : loop) box.extend(mesh_.position(v));
    out.views = witnesses_.find_views(box.center(), 0.5f * box.diagonal().norm());
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

  bool goes_on_beyond(std::uint32_t a, std::uint32_t b, std::span<const std::uint32_t> views) const {
    const std::uint32_t t = mesh_.find(a, b);
    const Eigen::Vector3f p = mesh_.position(a), q = mesh_.position(b);
    const Eigen::Vector3f normal = mesh_.area_normal(t).stableNormalized().cast<float>();
    const Eigen::Vector3f outward = (q - p).cross(normal).stableNormalized();
    const Triangle& c = mesh_.triangle(t);
    std::array<float, 3> sides;
    for (std::size_t k = 0; k < 3; ++k) sides[k] = (mesh_.position(c[k]) - mesh_.position(c[(k + 1) % 3])).norm();
    std::sort(sides.begin(), sides.end());
    const Eigen::Vector3f beyond = 0.5f * (p + q) + kBeyond * sides[1] * outward;
    const float error = std::max(error_m_[a], error_m_[b]);
    return is_confirmed(witnesses_.ask(views, beyond, normal, error), std::max(sigma_m_[a], sigma_m_[b]));
  }

  // A view that is much less sure than those that measured the surroundings sees surface everywhere near one.
  static bool is_confirmed(const Hearing& hearing, float sigma_m) {
    return hearing.is_surface() && hearing.surface_sigma_m <= kMostSigma * sigma_m;
  }

  // Whether a view that can tell looked through a triangle, or none saw its middle.
  bool is_contradicted(const Triangle& t, std::span<const std::uint32_t> views) const {
    constexpr int kSteps = 4;
    const Eigen::Vector3f normal = mesh_.area_normal(t).stableNormalized().cast<float>();
    const float error = std::max({error_m_[t[0]], error_m_[t[1]], error_m_[t[2]]});
    for (int i = 1; i < kSteps; ++i)
      for (int j = 1; i + j < kSteps; ++j) {
        const Eigen::Vector3f p = (float(i) * mesh_.position(t[0]) + float(j) * mesh_.position(t[1]) +
                                   float(kSteps - i - j) * mesh_.position(t[2])) /
                                  kSteps;
        if (witnesses_.ask(views, p, normal, error).is_empty()) return true;
      }
    const Eigen::Vector3f middle = (mesh_.position(t[0]) + mesh_.position(t[1]) + mesh_.position(t[2])) / 3;
    const float sigma = std::max({sigma_m_[t[0]], sigma_m_[t[1]], sigma_m_[t[2]]});
    return !is_confirmed(witnesses_.ask(views, middle, normal, error), sigma);
  }

  // An earlier loop may have taken an edge.
  bool is_open(const Loop& loop) const {
    for (std::size_t i = 0; i < loop.size(); ++i)
      if (!mesh_.is_open(loop[i], loop[(i + 1) % loop.size()])) return false;
    return true;
  }

  void close_loops(std::size_t longest, const TriangleRule& rule) {
    std::vector<Loop> loops = trace_loops(mesh_, open_edges(mesh_));
    std::erase_if(loops, [&](const Loop& loop) { return loop.size() > longest; });
    std::vector<Judged> judged(loops.size());
    parallel_for(context_, loops.size(), 4, [&](std::size_t i) {
      judged[i] = judge(loops[i]);
      relieve(patches_.front());
    });
    std::erase_if(judged, [](const Judged& j) { return j.crack_share < kCrackShare; });
    // Short ones first: what they take is little.
    std::stable_sort(judged.begin(), judged.end(),
                     [](const Judged& a, const Judged& b) { return a.loop.size() < b.loop.size(); });
    report_.crack_loops = std::max<std::uint64_t>(report_.crack_loops, judged.size());
    for (const Judged& j : judged) {
      context_.throw_if_cancelled();
      if (!is_open(j.loop)) continue;
      relieve(patches_.front());
      check_.set_condition([&](const Triangle& t) { return !is_contradicted(t, j.views); });
      if (!close_loop(mesh_, check_, j.loop, LoopGoal::kArea, rule, TriangleTag::kSeam)) continue;
      ++report_.loops_closed;
      report_.loop_triangles += j.loop.size() - 2;
    }
    check_.set_condition({});
  }

  Context& context_;
  const OverlapOptions& options_;
  std::span<const Patch> patches_;
  Witnesses witnesses_;
  std::vector<Eigen::Vector3f> normals_;
  LiveMesh mesh_;
  TriangleCheck check_;
  std::vector<float> error_m_, sigma_m_;  // per vertex: along its normal, along its ray
  CloseCracksReport report_;
};

}  // namespace

CloseCracksReport close_cracks(Mesh& mesh, std::span<const Patch> patches, const OverlapOptions& options,
                               Context& context) {
  if (mesh.triangles.empty()) return {};
  StageScope stage(context, "close cracks");
  CrackCloser closer(mesh, patches, options, context);
  const CloseCracksReport report = closer.run();
  mesh = compact(mesh, closer.alive());
  return report;
}

std::string to_json(const CloseCracksReport& report) {
  const nlohmann::ordered_json json = {{"covered_triangles_removed", report.covered_triangles_removed},
                                       {"crack_loops", report.crack_loops},
                                       {"loops_closed", report.loops_closed},
                                       {"loop_triangles", report.loop_triangles},
                                       {"flips", report.flips},
                                       {"collapses", report.collapses}};
  return json.dump(2);
}

}  // namespace lapseam
