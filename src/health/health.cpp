#include "lapseam/health.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <numeric>
#include <utility>

#include "core/disjoint_sets.h"
#include "core/parallel.h"
#include "health/incidence.h"
#include "health/percentile.h"
#include "health/predicates.h"
#include "health/seams.h"
#include "health/self_intersection.h"
#include "health/shape.h"

namespace lapseam {
namespace {

constexpr std::size_t kVerticesPerBlock = 1024;
constexpr std::size_t kTrianglesPerBlock = 1024;

std::uint64_t edge_key(std::uint32_t a, std::uint32_t b) {
  return std::uint64_t(std::min(a, b)) << 32 | std::max(a, b);
}

/// What one block of vertices contributes. Each edge and triangle is counted at its smallest vertex.
struct BlockFindings {
  std::uint64_t edges = 0, boundary_edges = 0, nonmanifold_edges = 0, misoriented_edges = 0;
  std::uint64_t pinched_vertices = 0, duplicate_triangles = 0, unused_vertices = 0;
  double boundary_length_m = 0;
  std::vector<std::uint64_t> boundary;                                  ///< keys, in increasing order
  std::vector<std::pair<std::uint64_t, std::uint64_t>> boundary_links;  ///< boundary edges joined by a fan
};

/// One side of a triangle at a vertex: the edge to `neighbor`.
struct Spoke {
  std::uint32_t neighbor;
  std::uint32_t fan_triangle;  ///< place in the list of triangles around the vertex
  bool is_outgoing;            ///< the triangle runs from the vertex to the neighbor
};

/// Looks at the surroundings of one vertex after the other; keeps its buffers between them.
class VertexInspector {
 public:
  VertexInspector(std::span<const Eigen::Vector3f> positions_m, std::span<const Triangle> triangles,
                  const Incidence& incidence, BlockFindings& findings)
      : positions_m_(positions_m), triangles_(triangles), incidence_(incidence), findings_(findings) {}

  void inspect(std::uint32_t vertex) {
    const auto around = incidence_.around(vertex);
    if (around.empty()) {
      ++findings_.unused_vertices;
      return;
    }
    collect_spokes(vertex, around);
    fans_.reset(around.size());
    boundary_.clear();
    for (std::size_t begin = 0, end = 0; begin < spokes_.size(); begin = end) {
      while (end < spokes_.size() && spokes_[end].neighbor == spokes_[begin].neighbor) {
        fans_.unite(spokes_[begin].fan_triangle, spokes_[end].fan_triangle);
        ++end;
      }
      if (end - begin == 1) boundary_.push_back(spokes_[begin]);
      if (spokes_[begin].neighbor > vertex) count_edge(vertex, {spokes_.data() + begin, end - begin});
    }
    std::size_t fan_count = 0;
    for (std::uint32_t i = 0; i < around.size(); ++i) fan_count += fans_.find(i) == i;
    findings_.pinched_vertices += fan_count > 1;
    link_boundary(vertex);
    count_duplicates();
  }

 private:
  void collect_spokes(std::uint32_t vertex, std::span<const std::uint32_t> around) {
    spokes_.clear();
    opposite_.clear();
    for (std::uint32_t i = 0; i < around.size(); ++i) {
      const Triangle& t = triangles_[around[i]];
      const std::size_t k = t[0] == vertex ? 0 : t[1] == vertex ? 1 : 2;
      const std::uint32_t next = t[(k + 1) % 3], previous = t[(k + 2) % 3];
      spokes_.push_back({next, i, true});
      spokes_.push_back({previous, i, false});
      if (next > vertex && previous > vertex) opposite_.push_back(edge_key(next, previous));
    }
    std::sort(spokes_.begin(), spokes_.end(), [](const Spoke& a, const Spoke& b) {
      return a.neighbor != b.neighbor ? a.neighbor < b.neighbor : a.fan_triangle < b.fan_triangle;
    });
  }

  void count_edge(std::uint32_t vertex, std::span<const Spoke> edge) {
    const auto outgoing = std::count_if(edge.begin(), edge.end(), [](const Spoke& s) { return s.is_outgoing; });
    const auto incoming = std::ptrdiff_t(edge.size()) - outgoing;
    ++findings_.edges;
    findings_.nonmanifold_edges += edge.size() > 2;
    findings_.misoriented_edges += std::uint64_t(outgoing > 1) + std::uint64_t(incoming > 1);
    if (edge.size() != 1) return;
    ++findings_.boundary_edges;
    findings_.boundary.push_back(edge_key(vertex, edge[0].neighbor));
    findings_.boundary_length_m +=
        (positions_m_[vertex].cast<double>() - positions_m_[edge[0].neighbor].cast<double>()).norm();
  }

  void link_boundary(std::uint32_t vertex) {
    for (Spoke& s : boundary_) s.fan_triangle = fans_.find(s.fan_triangle);
    std::sort(boundary_.begin(), boundary_.end(), [](const Spoke& a, const Spoke& b) {
      return a.fan_triangle != b.fan_triangle ? a.fan_triangle < b.fan_triangle : a.neighbor < b.neighbor;
    });
    for (std::size_t i = 1; i < boundary_.size(); ++i)
      if (boundary_[i].fan_triangle == boundary_[i - 1].fan_triangle)
        findings_.boundary_links.emplace_back(edge_key(vertex, boundary_[i - 1].neighbor),
                                              edge_key(vertex, boundary_[i].neighbor));
  }

  void count_duplicates() {
    std::sort(opposite_.begin(), opposite_.end());
    for (std::size_t i = 1; i < opposite_.size(); ++i)
      findings_.duplicate_triangles += opposite_[i] == opposite_[i - 1];
  }

  std::span<const Eigen::Vector3f> positions_m_;
  std::span<const Triangle> triangles_;
  const Incidence& incidence_;
  BlockFindings& findings_;
  DisjointSets fans_;  ///< of the triangles around the vertex
  std::vector<Spoke> spokes_, boundary_;
  std::vector<std::uint64_t> opposite_;
};

std::uint64_t count_loops(const std::vector<BlockFindings>& blocks, std::uint64_t boundary_edges) {
  std::vector<std::uint64_t> edges;
  edges.reserve(boundary_edges);
  for (const BlockFindings& block : blocks) edges.insert(edges.end(), block.boundary.begin(), block.boundary.end());
  const auto index_of = [&](std::uint64_t key) {
    return std::uint32_t(std::lower_bound(edges.begin(), edges.end(), key) - edges.begin());
  };
  DisjointSets loops(edges.size());
  for (const BlockFindings& block : blocks)
    for (const auto& [a, b] : block.boundary_links) loops.unite(index_of(a), index_of(b));
  std::uint64_t count = 0;
  for (std::uint32_t i = 0; i < edges.size(); ++i) count += loops.find(i) == i;
  return count;
}

void inspect_vertices(std::span<const Eigen::Vector3f> positions_m, std::span<const Triangle> triangles,
                      const Incidence& incidence, MeshHealth& health, Context& context) {
  std::vector<BlockFindings> blocks((positions_m.size() + kVerticesPerBlock - 1) / kVerticesPerBlock);
  parallel_blocks(context, positions_m.size(), kVerticesPerBlock, [&](std::size_t begin, std::size_t end) {
    VertexInspector inspector(positions_m, triangles, incidence, blocks[begin / kVerticesPerBlock]);
    for (std::size_t v = begin; v < end; ++v) inspector.inspect(std::uint32_t(v));
  });
  for (const BlockFindings& block : blocks) {
    health.edges += block.edges;
    health.boundary_edges += block.boundary_edges;
    health.nonmanifold_edges += block.nonmanifold_edges;
    health.misoriented_edges += block.misoriented_edges;
    health.pinched_vertices += block.pinched_vertices;
    health.duplicate_triangles += block.duplicate_triangles;
    health.unused_vertices += block.unused_vertices;
    health.boundary_length_m += block.boundary_length_m;
  }
  health.boundary_loops = count_loops(blocks, health.boundary_edges);
}

/// How many of the largest areas make up the share of their sum.
std::uint64_t count_up_to_share(std::vector<double> areas, double share) {
  std::sort(areas.begin(), areas.end(), std::greater<>());
  const double needed = share * std::accumulate(areas.begin(), areas.end(), 0.0);
  double sum = 0;
  std::uint64_t count = 0;
  for (; count < areas.size() && sum < needed; ++count) sum += areas[count];
  return count;
}

void count_components(std::span<const Eigen::Vector3f> positions_m, std::span<const Triangle> triangles,
                      MeshHealth& health) {
  const std::size_t vertices = positions_m.size();
  DisjointSets sets(vertices);
  std::uint64_t total = 0;
  for (const Triangle& t : triangles) {
    if (has_repeated_vertex(t)) continue;
    sets.unite(t[0], t[1]);
    sets.unite(t[0], t[2]);
    ++total;
  }
  std::vector<std::uint32_t> size(vertices, 0);
  std::vector<double> area(vertices, 0);
  for (const Triangle& t : triangles) {
    if (has_repeated_vertex(t)) continue;
    const std::uint32_t root = sets.find(t[0]);
    ++size[root];
    area[root] += shape_of(positions_m[t[0]], positions_m[t[1]], positions_m[t[2]]).area_m2;
  }
  std::uint32_t largest = 0;
  for (const std::uint32_t s : size) {
    if (s == 0) continue;
    ++health.components;
    health.components_100_triangles += s >= 100;
    largest = std::max(largest, s);
    if (health.smallest_component_triangles == 0 || s < health.smallest_component_triangles)
      health.smallest_component_triangles = s;
  }
  std::erase(area, 0.0);
  health.components_99_percent_area = count_up_to_share(std::move(area), 0.99);
  if (total > 0) health.largest_component_share = double(largest) / double(total);
}

void measure_triangles(std::span<const Eigen::Vector3f> positions_m, std::span<const Triangle> triangles,
                       MeshHealth& health, Context& context) {
  std::vector<std::uint32_t> proper;  // triangles of three vertices
  proper.reserve(triangles.size());
  for (std::size_t i = 0; i < triangles.size(); ++i)
    if (!has_repeated_vertex(triangles[i])) proper.push_back(std::uint32_t(i));
  health.degenerate_triangles = triangles.size() - proper.size();
  if (proper.empty()) return;

  std::vector<float> angles(proper.size()), sides(proper.size());
  struct Sum {
    double area = 0;
    std::uint64_t flat = 0, sharp = 0;
  };
  const Sum sum = parallel_reduce(
      context, proper.size(), kTrianglesPerBlock, Sum{},
      [&](std::size_t begin, std::size_t end, Sum s) {
        for (std::size_t i = begin; i < end; ++i) {
          const Triangle& t = triangles[proper[i]];
          const Eigen::Vector3f &a = positions_m[t[0]], &b = positions_m[t[1]], &c = positions_m[t[2]];
          const TriangleShape shape = shape_of(a, b, c);
          angles[i] = shape.min_angle_deg;
          sides[i] = shape.middle_side_m;
          s.area += shape.area_m2;
          s.flat += dominant_plane(a, b, c) < 0;
          s.sharp += shape.min_angle_deg < 10;
        }
        return s;
      },
      [](const Sum& a, const Sum& b) {
        return Sum{a.area + b.area, a.flat + b.flat, a.sharp + b.sharp};
      });
  health.area_m2 = sum.area;
  health.degenerate_triangles += sum.flat;
  health.min_angle_below_10_deg_share = double(sum.sharp) / double(proper.size());
  parallel_sort(context, angles.begin(), angles.end(), std::less<>());
  parallel_sort(context, sides.begin(), sides.end(), std::less<>());
  constexpr std::array<double, 4> kPercents = {1, 5, 25, 50};
  for (std::size_t i = 0; i < kPercents.size(); ++i)
    health.min_angle_percentiles_deg[i] = percentile(angles, kPercents[i]);
  health.edge_length_median_m = percentile(sides, 50);
}

}  // namespace

MeshHealth check_health(const Mesh& mesh, const HealthOptions& options, Context& context) {
  check_mesh(mesh);
  WeldedSurface welded;
  if (options.weld) welded = weld_surface(mesh, context);
  const std::span<const Eigen::Vector3f> positions_m = options.weld ? welded.positions_m : mesh.positions_m;
  const std::span<const Triangle> triangles = options.weld ? welded.triangles : mesh.triangles;

  MeshHealth health;
  health.vertices = positions_m.size();
  health.triangles = triangles.size();
  measure_triangles(positions_m, triangles, health, context);
  count_components(positions_m, triangles, health);
  const Incidence incidence = build_incidence(positions_m.size(), triangles);
  inspect_vertices(positions_m, triangles, incidence, health, context);
  SelfIntersections found;
  if (options.self_intersections) {
    found = find_self_intersections(positions_m, triangles, context);
    health.self_intersections_checked = true;
    health.self_intersecting_triangles = found.triangles;
    health.self_intersecting_pairs = found.pairs.size();
  }
  if (!mesh.triangle_tag.empty() && !mesh.triangle_view.empty())
    health.seams = measure_seams({positions_m, triangles, mesh.triangle_tag, mesh.triangle_view, found.is_meeting},
                                 incidence, SeamOptions{}.island_triangles, context);
  return health;
}

}  // namespace lapseam
