// After G. Turk, M. Levoy 1994, §4 (redundant triangles are those whose corners lie on the other mesh's interior).

#include "sew_meshes/cut.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <memory>

#include "core/disjoint_sets.h"
#include "core/parallel.h"
#include "sew_meshes/surface_probe.h"
#include "sew_meshes/triangle_check.h"
#include "spatial/kd_tree.h"

namespace lapseam {
namespace {

// Normals that differ by more are another surface: the back of a sheet, the other side of an edge.
constexpr float kAlikeCosine = 0.3f;
constexpr float kTrimCosine = 0.1f;
// Confidence grows with the distance from the border up to this many edges: borders of scans are bad, but inside of it
// a cut that wanders with the distance to two borders is no better than a straight one.
constexpr float kConfidenceReach = 8;
// A later mesh must lead by this to win, so that two equal ones do not take turns.
constexpr float kLead = 0.02f;
// Between what is left of two meshes, as a share of the edge length there.
constexpr float kGap = 0.5f;
constexpr float kTrimFactor = 1.5f;  // × overlap distance, in the second look
constexpr std::size_t kSamples = 20000;
constexpr float kNearFactor = 2;  // × edge length, how far two that keep apart may still be one
constexpr float kSpread = 0.25f;
constexpr float kSearchFactor = 16;  // × edge length, how far meshes may lie apart and be noticed
constexpr std::uint32_t kSmallestIsland = 40;
constexpr int kTidyPasses = 12;

struct Bounds {
  std::vector<Box> boxes;  // of each mesh

  explicit Bounds(const MergedMeshes& merged, float margin) : boxes(merged.first_vertex.size() - 1) {
    for (std::size_t m = 0; m < boxes.size(); ++m) {
      for (std::uint32_t v = merged.first_vertex[m]; v < merged.first_vertex[m + 1]; ++v)
        boxes[m].extend(merged.mesh.positions_m[v]);
      boxes[m].low.array() -= margin;
      boxes[m].high.array() += margin;
    }
  }
  bool contain(std::size_t m, const Eigen::Vector3f& p) const { return boxes[m].overlaps({p, p}); }
};

/// 0 at the border of its own mesh, 1 far from it.
std::vector<float> measure_confidence(const MergedMeshes& merged, const LiveMesh& live, Context& context) {
  std::vector<float> confidence(merged.mesh.vertex_count(), 1.0f);
  for (std::size_t m = 0; m + 1 < merged.first_vertex.size(); ++m) {
    const std::uint32_t first = merged.first_vertex[m], count = merged.first_vertex[m + 1] - first;
    std::vector<std::uint8_t> is_border(count, 0);
    parallel_for(context, count, 1024,
                 [&](std::size_t i) { is_border[i] = live.is_on_border(first + std::uint32_t(i)); });
    std::vector<Eigen::Vector3f> border;
    for (std::uint32_t i = 0; i < count; ++i)
      if (is_border[i]) border.push_back(live.position(first + i));
    if (border.empty()) continue;
    const KdTree tree(border);
    const float reach = kConfidenceReach * merged.edge_length_m;
    parallel_blocks(context, count, 1024, [&](std::size_t begin, std::size_t end) {
      std::vector<Neighbor> nearest;
      for (std::size_t i = begin; i < end; ++i) {
        tree.find_nearest(live.position(first + std::uint32_t(i)), 1, nearest);
        confidence[first + i] = std::min(1.0f, std::sqrt(nearest[0].squared_distance) / reach);
      }
    });
  }
  return confidence;
}

/// Marks vertices at places that another mesh shows better.
std::vector<std::uint8_t> find_losers(const MergedMeshes& merged, const SurfaceProbes& probes,
                                      const std::vector<float>& confidence, float distance, StageScope& stage,
                                      Context& context) {
  const Bounds bounds(merged, distance);
  std::vector<std::uint8_t> loses(merged.mesh.vertex_count(), 0);
  parallel_blocks(context, loses.size(), 4096, [&](std::size_t begin, std::size_t end) {
    for (std::size_t v = begin; v < end; ++v) {
      const std::uint32_t own = merged.mesh_of_vertex(std::uint32_t(v));
      const Eigen::Vector3f& p = merged.mesh.positions_m[v];
      for (std::uint32_t m = 0; m < probes.size() && !loses[v]; ++m) {
        if (m == own || !bounds.contain(m, p)) continue;
        const auto other = probes[m]->closest(p, distance, &confidence);
        if (!other || other->is_border || other->normal.dot(merged.normals[v]) < kAlikeCosine) continue;
        loses[v] = m < own ? other->confidence + kLead >= confidence[v] : other->confidence > confidence[v] + kLead;
      }
    }
    stage.advance(end - begin);
  });
  return loses;
}

/// Whether the triangle lies on, or too near to, what is left of another mesh.
bool is_covered(const MergedMeshes& merged, const LiveMesh& live, std::uint32_t t, const SurfaceProbe& other,
                float distance) {
  const Triangle& c = live.triangle(t);
  const Eigen::Vector3f a = live.position(c[0]), b = live.position(c[1]), d = live.position(c[2]);
  const Eigen::Vector3f center = (a + b + d) / 3;
  const float spacing = (merged.spacing_m[c[0]] + merged.spacing_m[c[1]] + merged.spacing_m[c[2]]) / 3;
  const float size =
      std::sqrt(std::max({(a - center).squaredNorm(), (b - center).squaredNorm(), (d - center).squaredNorm()}));
  const float reach = std::hypot(distance, 2 * kGap * spacing);
  if (!other.closest(center, reach + size)) return false;
  const Eigen::Vector3f normal =
      (merged.normals[c[0]] + merged.normals[c[1]] + merged.normals[c[2]]).stableNormalized();
  for (const Eigen::Vector3f& p :
       {center, a, b, d, Eigen::Vector3f((a + b) / 2), Eigen::Vector3f((b + d) / 2), Eigen::Vector3f((d + a) / 2)}) {
    const auto near = other.closest(p, reach);
    if (!near || near->normal.dot(normal) < kTrimCosine) continue;
    if (!near->is_border && near->distance <= distance) return true;
    const Eigen::Vector3f apart = p - near->position;
    const float height = apart.dot(near->normal);
    if (std::abs(height) > distance) continue;
    const float beside = (apart - height * near->normal).norm();
    if (beside < kGap * 0.5f * (spacing + near->spacing_m)) return true;
  }
  return false;
}

void remove_marked(LiveMesh& live, const std::vector<std::uint8_t>& is_doomed) {
  for (std::uint32_t t = 0; t < is_doomed.size(); ++t)
    if (is_doomed[t] && live.is_alive(t)) live.remove(t);
}

/// Later meshes give way to what is left of earlier ones, up to the width of the gap.
void trim(const MergedMeshes& merged, LiveMesh& live, float distance, StageScope& stage, Context& context) {
  const Bounds bounds(merged, distance + 2 * merged.edge_length_m);
  const std::size_t meshes = merged.first_vertex.size() - 1;
  SurfaceProbes probes;
  for (std::uint32_t m = 0; m < meshes; ++m) {
    std::vector<std::uint8_t> is_covered_by(merged.triangle_mesh.size(), 0);
    parallel_blocks(context, is_covered_by.size(), 4096, [&](std::size_t begin, std::size_t end) {
      for (std::size_t i = begin; i < end; ++i) {
        const auto t = std::uint32_t(i);
        if (merged.triangle_mesh[t] != m || !live.is_alive(t)) continue;
        for (std::size_t j = 0; j < m && !is_covered_by[t]; ++j)
          is_covered_by[t] = bounds.contain(j, live.position(live.triangle(t)[0])) &&
                             is_covered(merged, live, t, *probes[j], distance);
        stage.advance();
      }
    });
    remove_marked(live, is_covered_by);
    probes.push_back(std::make_unique<SurfaceProbe>(merged, live, m, context));
  }
}

/// Where a new border still runs through another mesh, the later one loses the triangle.
void remove_crossings(const MergedMeshes& merged, LiveMesh& live, Context& context) {
  std::vector<BoxEntry> entries;
  for (std::uint32_t t = 0; t < merged.triangle_mesh.size(); ++t)
    if (live.is_alive(t)) entries.push_back({box_of(live, live.triangle(t)), t});
  BoxForest boxes;
  boxes.add(std::move(entries));
  std::vector<std::uint8_t> is_new_border(live.vertex_count(), 0);
  for (const auto& [a, b] : live.cut_edges()) is_new_border[a] = is_new_border[b] = 1;
  std::vector<std::vector<std::uint32_t>> crossing(merged.triangle_mesh.size());
  parallel_for(context, crossing.size(), 1024, [&](std::size_t i) {
    const auto t = std::uint32_t(i);
    if (!live.is_alive(t)) return;
    const Triangle& c = live.triangle(t);
    if (!is_new_border[c[0]] && !is_new_border[c[1]] && !is_new_border[c[2]]) return;
    boxes.find(box_of(live, c), [&](std::uint32_t s) {
      if (merged.triangle_mesh[s] != merged.triangle_mesh[t] &&
          do_triangles_cross(live.positions(), c, live.triangle(s)))
        crossing[i].push_back(merged.triangle_mesh[s] < merged.triangle_mesh[t] ? t : s);
      return false;
    });
  });
  for (const auto& losers : crossing)
    for (const std::uint32_t t : losers)
      if (live.is_alive(t)) live.remove(t);
}

/// Teeth and places where a border touches itself: a front that starts there only gets stuck.
void tidy_borders(LiveMesh& live) {
  for (int pass = 0; pass < kTidyPasses; ++pass) {
    std::vector<std::uint32_t> doomed;
    std::vector<std::uint8_t> is_seen(live.vertex_count(), 0);
    for (const auto& [a, b] : live.cut_edges()) {
      const std::uint32_t t = live.find(a, b), c = live.apex(t, a, b);
      if (live.is_open(b, c) || live.is_open(c, a)) doomed.push_back(t);
      if (is_seen[a]) continue;
      is_seen[a] = 1;
      if (live.count_fans(a) > 1) live.for_each_around(a, [&](std::uint32_t around) { doomed.push_back(around); });
    }
    for (const std::uint32_t t : doomed)
      if (live.is_alive(t)) live.remove(t);
    if (doomed.empty()) break;
  }
}

/// Small pieces that the cut left alone.
void remove_islands(LiveMesh& live) {
  DisjointSets pieces(live.triangle_count());
  for (std::uint32_t t = 0; t < live.triangle_count(); ++t) {
    if (!live.is_alive(t)) continue;
    const Triangle& c = live.triangle(t);
    for (std::size_t k = 0; k < 3; ++k)
      if (const std::uint32_t s = live.find(c[(k + 1) % 3], c[k]); s != kInvalidIndex) pieces.unite(t, s);
  }
  std::vector<std::uint32_t> size(live.triangle_count(), 0);
  std::vector<std::uint8_t> is_cut(live.triangle_count(), 0), is_doomed(live.triangle_count(), 0);
  for (std::uint32_t t = 0; t < size.size(); ++t)
    if (live.is_alive(t)) ++size[pieces.find(t)];
  for (const auto& [a, b] : live.cut_edges()) is_cut[pieces.find(live.find(a, b))] = 1;
  for (std::uint32_t t = 0; t < size.size(); ++t) {
    const std::uint32_t piece = pieces.find(t);
    is_doomed[t] = is_cut[piece] && size[piece] < kSmallestIsland;
  }
  remove_marked(live, is_doomed);
}

}  // namespace

void measure_disagreement(const MergedMeshes& merged, const SurfaceProbes& probes, SewMeshesReport& report,
                          Context& context) {
  const float radius = kSearchFactor * merged.edge_length_m;
  const Bounds bounds(merged, radius);
  const std::size_t step = std::max<std::size_t>(1, merged.mesh.vertex_count() / (kSamples * probes.size()));
  std::vector<float> distances((merged.mesh.vertex_count() + step - 1) / step, -1);
  parallel_for(context, distances.size(), 256, [&](std::size_t i) {
    const std::size_t v = i * step;
    const Eigen::Vector3f& p = merged.mesh.positions_m[v];
    for (std::uint32_t m = 0; m < probes.size(); ++m) {
      if (m == merged.mesh_of_vertex(std::uint32_t(v)) || !bounds.contain(m, p)) continue;
      const auto other = probes[m]->closest(p, radius);
      if (!other || other->is_border || other->normal.dot(merged.normals[v]) < kAlikeCosine) continue;
      if (distances[i] < 0 || other->distance < distances[i]) distances[i] = other->distance;
    }
  });
  std::erase_if(distances, [](float d) { return d < 0; });
  std::sort(distances.begin(), distances.end());
  const auto quantile = [&](double share) { return distances[std::size_t(share * double(distances.size() - 1))]; };
  // One surface that two meshes show runs now above, now below: distances from zero on. Two that lie over each other
  // keep apart; then only what is very near can be one surface.
  if (!distances.empty() && quantile(0.5) > kNearFactor * merged.edge_length_m &&
      quantile(0.1) > kSpread * quantile(0.5))
    std::erase_if(distances, [&](float d) { return d > kNearFactor * merged.edge_length_m; });
  if (!distances.empty()) report.disagreement_m = double(quantile(0.5));
  // Of distances that are spread evenly in all directions, four medians hold nearly all.
  report.overlap_distance_m = std::max(double(merged.edge_length_m), 4 * report.disagreement_m);
}

void cut_overlap(const MergedMeshes& merged, LiveMesh& live, const SurfaceProbes& probes, SewMeshesReport& report,
                 Context& context) {
  const auto distance = float(report.overlap_distance_m);
  StageScope stage(context, "overlap", merged.mesh.vertex_count() + merged.triangle_mesh.size());
  const std::vector<std::uint8_t> was_alive = live.alive();
  std::vector<std::uint8_t> is_doomed(merged.triangle_mesh.size(), 0);
  {
    const std::vector<float> confidence = measure_confidence(merged, live, context);
    const std::vector<std::uint8_t> loses = find_losers(merged, probes, confidence, distance, stage, context);
    for (std::uint32_t t = 0; t < is_doomed.size(); ++t) {
      const Triangle& c = live.triangle(t);
      is_doomed[t] = live.is_alive(t) && loses[c[0]] && loses[c[1]] && loses[c[2]];
    }
  }
  remove_marked(live, is_doomed);
  tidy_borders(live);
  trim(merged, live, kTrimFactor * distance, stage, context);
  remove_crossings(merged, live, context);
  tidy_borders(live);
  remove_islands(live);
  for (std::uint32_t t = 0; t < merged.triangle_mesh.size(); ++t)
    report.meshes[merged.triangle_mesh[t]].removed += was_alive[t] && !live.is_alive(t);
}

}  // namespace lapseam
