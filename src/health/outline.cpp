#include "health/outline.h"

#include <Eigen/Geometry>
#include <algorithm>

#include "core/disjoint_sets.h"
#include "core/parallel.h"
#include "health/shape.h"

namespace lapseam {
namespace {

constexpr std::size_t kTrianglesPerBlock = 4096;

// The direction of an outline is taken over so many edges on either side: single edges of a cut along a grid zigzag.
constexpr int kChordEdges = 2;

bool has_edge(const Triangle& t, std::uint32_t a, std::uint32_t b) {
  const auto has = [&](std::uint32_t v) { return t[0] == v || t[1] == v || t[2] == v; };
  return has(a) && has(b);
}

std::vector<OutlineEdge> collect_edges(std::span<const Triangle> triangles, const Incidence& incidence,
                                       Context& context) {
  std::vector<std::vector<OutlineEdge>> blocks((triangles.size() + kTrianglesPerBlock - 1) / kTrianglesPerBlock);
  parallel_blocks(context, triangles.size(), kTrianglesPerBlock, [&](std::size_t begin, std::size_t end) {
    std::vector<OutlineEdge>& found = blocks[begin / kTrianglesPerBlock];
    for (std::size_t i = begin; i < end; ++i) {
      const Triangle& t = triangles[i];
      if (has_repeated_vertex(t)) continue;
      for (std::size_t k = 0; k < 3; ++k) {
        const std::uint32_t a = t[k], b = t[(k + 1) % 3];
        const auto around = incidence.around(a);
        const auto users = std::count_if(around.begin(), around.end(),
                                         [&](std::uint32_t other) { return has_edge(triangles[other], a, b); });
        if (users == 1) found.push_back({a, b, std::uint32_t(i)});
      }
    }
  });
  std::vector<OutlineEdge> edges;
  for (const auto& block : blocks) edges.insert(edges.end(), block.begin(), block.end());
  return edges;
}

/// Joins the boundary edges at one vertex that belong to the same fan of triangles.
class Linker {
 public:
  Linker(std::span<const Triangle> triangles, const Incidence& incidence, Outline& outline, DisjointSets& loops)
      : triangles_(triangles), incidence_(incidence), outline_(outline), loops_(loops) {}

  void link(std::uint32_t vertex, std::span<const std::uint32_t> edges) {
    find_fans(vertex);
    const auto around = incidence_.around(vertex);
    by_fan_.clear();
    for (const std::uint32_t e : edges) {
      const auto place = std::lower_bound(around.begin(), around.end(), outline_.edges[e].triangle) - around.begin();
      by_fan_.emplace_back(fans_.find(std::uint32_t(place)), e);
    }
    std::sort(by_fan_.begin(), by_fan_.end());
    for (std::size_t begin = 0, end = 0; begin < by_fan_.size(); begin = end) {
      while (end < by_fan_.size() && by_fan_[end].first == by_fan_[begin].first) ++end;
      for (std::size_t i = begin + 1; i < end; ++i) loops_.unite(by_fan_[begin].second, by_fan_[i].second);
      if (end - begin == 2) connect(vertex, by_fan_[begin].second, by_fan_[begin + 1].second);
    }
  }

 private:
  void find_fans(std::uint32_t vertex) {
    const auto around = incidence_.around(vertex);
    fans_.reset(around.size());
    spokes_.clear();
    for (std::uint32_t i = 0; i < around.size(); ++i)
      for (const std::uint32_t v : triangles_[around[i]])
        if (v != vertex) spokes_.emplace_back(v, i);
    std::sort(spokes_.begin(), spokes_.end());
    for (std::size_t i = 1; i < spokes_.size(); ++i)
      if (spokes_[i].first == spokes_[i - 1].first) fans_.unite(spokes_[i].second, spokes_[i - 1].second);
  }

  void connect(std::uint32_t vertex, std::uint32_t e, std::uint32_t f) {
    if (outline_.edges[e].b != vertex) std::swap(e, f);
    // Both leave or both arrive where triangles disagree about their orientation.
    if (outline_.edges[e].b != vertex || outline_.edges[f].a != vertex) return;
    outline_.edges[e].after = f;
    outline_.edges[f].before = e;
  }

  std::span<const Triangle> triangles_;
  const Incidence& incidence_;
  Outline& outline_;
  DisjointSets& loops_;
  DisjointSets fans_;
  std::vector<std::pair<std::uint32_t, std::uint32_t>> spokes_, by_fan_;
};

}  // namespace

Outline find_outline(std::size_t vertices, std::span<const Triangle> triangles, const Incidence& incidence,
                     Context& context) {
  Outline outline;
  outline.edges = collect_edges(triangles, incidence, context);
  std::vector<std::uint32_t> first(vertices + 1, 0), edges_at(2 * outline.edges.size());
  for (const OutlineEdge& e : outline.edges) ++first[e.a + 1], ++first[e.b + 1];
  for (std::size_t v = 0; v < vertices; ++v) first[v + 1] += first[v];
  std::vector<std::uint32_t> next(first.begin(), first.end() - 1);
  for (std::uint32_t i = 0; i < outline.edges.size(); ++i) {
    edges_at[next[outline.edges[i].a]++] = i;
    edges_at[next[outline.edges[i].b]++] = i;
  }
  DisjointSets loops(outline.edges.size());
  Linker linker(triangles, incidence, outline, loops);
  for (std::uint32_t v = 0; v < vertices; ++v)
    if (first[v + 1] > first[v]) linker.link(v, {edges_at.data() + first[v], first[v + 1] - first[v]});
  // The smallest edge is the root, so it is met first.
  for (std::uint32_t i = 0; i < outline.edges.size(); ++i) {
    const std::uint32_t root = loops.find(i);
    outline.edges[i].loop = root == i ? outline.loops++ : outline.edges[root].loop;
  }
  return outline;
}

namespace {

class Framer {
 public:
  Framer(std::span<const Eigen::Vector3f> positions_m, std::span<const Triangle> triangles, const Incidence& incidence,
         const Outline& outline)
      : positions_m_(positions_m), triangles_(triangles), incidence_(incidence), outline_(outline) {}

  OutlineFrame frame(std::uint32_t index) const {
    const OutlineEdge& edge = outline_.edges[index];
    const Triangle& t = triangles_[edge.triangle];
    const Eigen::Vector3f &a = positions_m_[edge.a], &b = positions_m_[edge.b];
    OutlineFrame frame;
    frame.middle = (a + b) / 2;
    frame.inside = (positions_m_[t[0]] + positions_m_[t[1]] + positions_m_[t[2]]) / 3;
    frame.length_m = (b - a).norm();
    frame.side_m = shape_of(positions_m_[t[0]], positions_m_[t[1]], positions_m_[t[2]]).middle_side_m;
    const Eigen::Vector3d normal = mean_normal(edge);
    const Eigen::Vector3d outward = chord(index).cross(normal);
    if (normal.isZero(0) || !(outward.norm() > 0)) return frame;
    frame.normal = normal.cast<float>();
    frame.outward = outward.normalized().cast<float>();
    return frame;
  }

 private:
  Eigen::Vector3d mean_normal(const OutlineEdge& edge) const {
    Eigen::Vector3d sum = Eigen::Vector3d::Zero();
    for (const std::uint32_t end : {edge.a, edge.b})
      for (const std::uint32_t near : incidence_.around(end))
        for (const std::uint32_t corner : triangles_[near])
          for (const std::uint32_t t : incidence_.around(corner)) sum += area_vector(triangles_[t]);
    const double length = sum.norm();
    return length > 0 ? Eigen::Vector3d(sum / length) : Eigen::Vector3d::Zero();
  }

  Eigen::Vector3d area_vector(const Triangle& t) const {
    const Eigen::Vector3f& a = positions_m_[t[0]];
    return (positions_m_[t[1]] - a).cast<double>().cross((positions_m_[t[2]] - a).cast<double>());
  }

  Eigen::Vector3d chord(std::uint32_t index) const {
    const OutlineEdge& edge = outline_.edges[index];
    std::uint32_t first = index, last = index;
    for (int k = 0; k < kChordEdges; ++k) {
      if (outline_.edges[first].before != kInvalidIndex) first = outline_.edges[first].before;
      if (outline_.edges[last].after != kInvalidIndex) last = outline_.edges[last].after;
    }
    const Eigen::Vector3d own = (positions_m_[edge.b] - positions_m_[edge.a]).cast<double>();
    const Eigen::Vector3d chord =
        (positions_m_[outline_.edges[last].b] - positions_m_[outline_.edges[first].a]).cast<double>();
    // Round a tip the chord says nothing, and at small holes it has gone all the way round.
    return chord.dot(own) > 0.5 * own.squaredNorm() ? chord : own;
  }

  std::span<const Eigen::Vector3f> positions_m_;
  std::span<const Triangle> triangles_;
  const Incidence& incidence_;
  const Outline& outline_;
};

}  // namespace

std::vector<OutlineFrame> outline_frames(std::span<const Eigen::Vector3f> positions_m,
                                         std::span<const Triangle> triangles, const Incidence& incidence,
                                         const Outline& outline, Context& context) {
  const Framer framer(positions_m, triangles, incidence, outline);
  std::vector<OutlineFrame> frames(outline.edges.size());
  parallel_for(context, frames.size(), 256, [&](std::size_t i) { frames[i] = framer.frame(std::uint32_t(i)); });
  return frames;
}

}  // namespace lapseam
