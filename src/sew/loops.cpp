// Small loops that the front leaves open, closed by the best of all their triangulations.
// Based on: G. Barequet, M. Sharir, Filling Gaps in the Boundary of a Polyhedron, 1995 (dynamic programming over
// chains).

#include <algorithm>
#include <cmath>
#include <limits>

#include "sew/front.h"

namespace lapseam {
namespace {

// At least this share of a loop must have been cut or sewn; else it is a hole that nobody measured.
constexpr double kCutShare = 0.5;
// A triangle's normal against those of its corners; in a warped loop some may turn far.
constexpr float kFacingCosine = -0.2f;

// Smallest angle's quality of a triangle as 2·area / longest², 0 for a degenerate one.
float shape_of(const Eigen::Vector3f& a, const Eigen::Vector3f& b, const Eigen::Vector3f& c) {
  const float longest = std::max({(a - b).squaredNorm(), (b - c).squaredNorm(), (c - a).squaredNorm()});
  return longest > 0 ? (b - a).cross(c - a).norm() / longest : 0.0f;
}

// How good a triangle of a filling is: its shape, less where it faces away from its surroundings; −1: not at all.
float quality_of(const Triangle& t, const std::vector<Eigen::Vector3f>& positions,
                 const std::vector<Eigen::Vector3f>& normals) {
  const Eigen::Vector3f normal = (positions[t[1]] - positions[t[0]]).cross(positions[t[2]] - positions[t[0]]);
  const float facing = normal.dot((normals[t[0]] + normals[t[1]] + normals[t[2]]).stableNormalized());
  if (!(facing > kFacingCosine * normal.norm())) return -1;
  const float shape = shape_of(positions[t[0]], positions[t[1]], positions[t[2]]);
  return facing < 0 ? 0.1f * shape : shape;
}

}  // namespace

std::vector<Triangle> triangulate_loop(const std::vector<std::uint32_t>& loop,
                                       const std::vector<Eigen::Vector3f>& positions,
                                       const std::vector<Eigen::Vector3f>& normals, const Boundary& boundary) {
  // worst[i][j]: the worst triangle in the best triangulation of the chain i … j; split[i][j]: its third corner.
  const std::size_t n = loop.size();
  constexpr float kImpossible = -1;
  std::vector<float> worst(n * n, kImpossible);
  std::vector<std::size_t> split(n * n, 0);
  for (std::size_t i = 0; i + 1 < n; ++i) worst[i * n + i + 1] = std::numeric_limits<float>::infinity();
  for (std::size_t length = 2; length < n; ++length)
    for (std::size_t i = 0; i + length < n; ++i) {
      const std::size_t j = i + length;
      const bool is_outline = length + 1 == n;  // the chord from last to first is an edge of the loop itself
      if (!is_outline && (boundary.has_half_edge(loop[i], loop[j]) || boundary.has_half_edge(loop[j], loop[i])))
        continue;
      for (std::size_t k = i + 1; k < j; ++k) {
        const float quality =
            std::min({worst[i * n + k], worst[k * n + j], quality_of({loop[k], loop[i], loop[j]}, positions, normals)});
        if (quality > worst[i * n + j]) {
          worst[i * n + j] = quality;
          split[i * n + j] = k;
        }
      }
    }
  if (!(worst[n - 1] > 0)) return {};
  std::vector<Triangle> triangles;
  std::vector<std::pair<std::size_t, std::size_t>> chains = {{0, n - 1}};
  while (!chains.empty()) {
    const auto [i, j] = chains.back();
    chains.pop_back();
    if (j - i < 2) continue;
    const std::size_t k = split[i * n + j];
    triangles.push_back({loop[k], loop[i], loop[j]});
    chains.emplace_back(i, k);
    chains.emplace_back(k, j);
  }
  return triangles;
}

bool Front::close_loop(const std::vector<std::uint32_t>& loop, SewReport& report) {
  std::size_t cut = 0;
  for (std::size_t i = 0; i < loop.size(); ++i) cut += cut_.count(key(loop[i], loop[(i + 1) % loop.size()]));
  if (double(cut) < kCutShare * double(loop.size())) return false;
  std::vector<std::uint32_t> sorted = loop;
  std::sort(sorted.begin(), sorted.end());
  if (std::adjacent_find(sorted.begin(), sorted.end()) != sorted.end()) return false;
  const std::vector<Triangle> triangles = triangulate_loop(loop, mesh_.positions_m, normals_, boundary_);
  if (triangles.empty()) return false;
  // Diagonals of one filling may meet twice only as the two sides of one edge.
  std::vector<std::uint64_t> half_edges;
  for (const Triangle& t : triangles) {
    if (options_.is_seen_through && options_.is_seen_through(mesh_, t)) return false;
    for (std::size_t k = 0; k < 3; ++k) {
      half_edges.push_back(key(t[k], t[(k + 1) % 3]));
      if (boundary_.has_half_edge(t[k], t[(k + 1) % 3])) return false;
    }
  }
  std::sort(half_edges.begin(), half_edges.end());
  if (std::adjacent_find(half_edges.begin(), half_edges.end()) != half_edges.end()) return false;
  for (const Triangle& t : triangles) add_triangle(t);
  report.loop_triangles += triangles.size();
  return true;
}

void Front::close_loops(SewReport& report) {
  std::vector<std::uint8_t> is_done(mesh_.vertex_count(), 0);
  for (const std::uint32_t start : boundary_.vertices()) {
    if (is_done[start] || boundary_.open_out(start).size() != 1) continue;
    std::vector<std::uint32_t> loop;
    std::uint32_t v = start;
    bool is_simple = true;
    do {
      loop.push_back(v);
      is_done[v] = 1;
      // Where several fans touch, which way the loop goes on is not known: left for the next stage.
      if (boundary_.open_out(v).size() != 1)
        is_simple = false;
      else
        v = boundary_.open_out(v)[0];
    } while (is_simple && v != start && loop.size() <= std::size_t(options_.largest_loop));
    if (is_simple && v == start && loop.size() >= 3 && loop.size() <= std::size_t(options_.largest_loop))
      close_loop(loop, report);
  }
}

}  // namespace lapseam
