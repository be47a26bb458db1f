// Based on: Y. Sun, C. Dumont, M. Abidi, Mesh-based Integration of Range and Color Images, 2000, §2.3.

#include "sew/front.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <queue>

#include "core/parallel.h"

namespace lapseam {
namespace {

using Vec2 = Eigen::Vector2f;

// Rounds search farther and farther; the first ones take only well-shaped triangles.
constexpr int kRounds = 5;
constexpr float kRadiusFactor[kRounds] = {1.6f, 3.0f, 6.0f, 0.0f, 0.0f};  // × spacing; 0: as far as a seam may reach
constexpr int kFirstFarRound = 2;  // from here on, disagreement of views adds to the reach
constexpr float kSmallestSine[kRounds] = {0.30f, 0.25f, 0.17f, 0.10f, 0.02f};  // of the smallest angle
// The triangle's normal against those of its corners: beyond 75° it folds back or bridges a crease.
constexpr float kFacingCosine = 0.26f;
// A vertex this near to an edge, as a share of the triangle's size, lies on it.
constexpr float kOnEdge = 1e-4f;
// Surroundings farther from the triangle's plane than this share of its size are another layer.
constexpr float kLayerShare = 0.8f;

std::vector<Eigen::Vector3f> gather(const std::vector<Eigen::Vector3f>& positions,
                                    const std::vector<std::uint32_t>& indices) {
  std::vector<Eigen::Vector3f> out;
  out.reserve(indices.size());
  for (const std::uint32_t i : indices) out.push_back(positions[i]);
  return out;
}

float cross(const Vec2& a, const Vec2& b) { return a.x() * b.y() - a.y() * b.x(); }
float area2(const Vec2& a, const Vec2& b, const Vec2& c) { return cross(b - a, c - a); }

// Whether open segments p–q and r–s cross in their interiors.
bool do_cross(const Vec2& p, const Vec2& q, const Vec2& r, const Vec2& s) {
  const float a = area2(p, q, r), b = area2(p, q, s), c = area2(r, s, p), d = area2(r, s, q);
  return ((a > 0) != (b > 0)) && ((c > 0) != (d > 0));
}

// Clockwise angle from direction x to direction y, in [0, 2π).
float clockwise(const Vec2& x, const Vec2& y) {
  const float angle = -std::atan2(cross(x, y), x.dot(y));
  return angle < 0 ? angle + 2 * std::numbers::pi_v<float> : angle;
}

// The plane in which a candidate triangle is judged.
class LocalPlane {
 public:
  LocalPlane(const Eigen::Vector3f& origin, const Eigen::Vector3f& normal) : origin_(origin), normal_(normal) {
    const Eigen::Vector3f axis = std::abs(normal.x()) < 0.6f ? Eigen::Vector3f::UnitX() : Eigen::Vector3f::UnitY();
    x_ = axis.cross(normal).normalized();
    y_ = normal.cross(x_);
  }
  Vec2 project(const Eigen::Vector3f& p) const { return {x_.dot(p - origin_), y_.dot(p - origin_)}; }
  float height(const Eigen::Vector3f& p) const { return normal_.dot(p - origin_); }
  const Eigen::Vector3f& normal() const { return normal_; }

 private:
  Eigen::Vector3f origin_, normal_, x_, y_;
};

// Whether directions from v to both p and q (clockwise in this order) lie in one open sector at v: right of an open
// edge that leaves v, up to the next open edge that arrives.
bool in_open_sector(const Boundary& boundary, const LocalPlane& plane, const std::vector<Eigen::Vector3f>& positions,
                    std::uint32_t v, std::uint32_t p, std::uint32_t q) {
  const Vec2 at = plane.project(positions[v]);
  const auto direction = [&](std::uint32_t i) { return Vec2(plane.project(positions[i]) - at); };
  const Vec2 to_p = direction(p), to_q = direction(q);
  for (const std::uint32_t head : boundary.open_out(v)) {
    const Vec2 start = direction(head);
    float end = 2 * std::numbers::pi_v<float>;
    std::uint32_t last = kInvalidIndex;
    for (const std::uint32_t tail : boundary.open_in(v)) {
      const float angle = tail == head ? 2 * std::numbers::pi_v<float> : clockwise(start, direction(tail));
      if (angle < end || last == kInvalidIndex) end = angle, last = tail;
    }
    const float angle_p = p == head ? 0.0f : p == last ? end : clockwise(start, to_p);
    const float angle_q = q == head ? 0.0f : q == last ? end : clockwise(start, to_q);
    if (angle_p <= angle_q && angle_q <= end) return true;
  }
  return false;
}

}  // namespace

bool Front::IsWorse::operator()(const Candidate& x, const Candidate& y) const {
  if (x.cosine != y.cosine) return x.cosine > y.cosine;
  if (x.a != y.a) return x.a > y.a;
  return x.b > y.b;
}

Front::Front(Mesh& mesh, std::span<const BoundaryEdge> active_edges, const SewOptions& options, Context& context)
    : mesh_(mesh),
      options_(options),
      context_(context),
      boundary_(mesh),
      tree_(gather(mesh.positions_m, boundary_.vertices())) {
  for (const BoundaryEdge& edge : active_edges) {
    active_.push_back(key(edge.a, edge.b));
    cut_.insert(active_.back());
  }
  measure_vertices();
}

void Front::measure_vertices() {
  normals_.assign(mesh_.vertex_count(), Eigen::Vector3f::Zero());
  spacing_.assign(mesh_.vertex_count(), 0);
  std::vector<std::uint16_t> edges(mesh_.vertex_count(), 0);
  for (const Triangle& t : mesh_.triangles) {
    const auto& p = mesh_.positions_m;
    const Eigen::Vector3f normal = (p[t[1]] - p[t[0]]).cross(p[t[2]] - p[t[0]]);
    for (std::size_t k = 0; k < 3; ++k) {
      normals_[t[k]] += normal;
      const float length = (p[t[k]] - p[t[(k + 1) % 3]]).norm();
      for (const std::uint32_t v : {t[k], t[(k + 1) % 3]}) {
        spacing_[v] += length;
        ++edges[v];
      }
    }
  }
  // One round of averaging over neighbours: at a cut, a vertex has only half of its triangles.
  std::vector<Eigen::Vector3f> averaged = normals_;
  for (const Triangle& t : mesh_.triangles)
    for (std::size_t k = 0; k < 3; ++k) averaged[t[k]] += normals_[t[(k + 1) % 3]] + normals_[t[(k + 2) % 3]];
  parallel_for(context_, mesh_.vertex_count(), 65536, [&](std::size_t v) {
    normals_[v] = averaged[v].stableNormalized();
    if (edges[v]) spacing_[v] /= float(edges[v]);
  });
  edge_reach_.assign(mesh_.vertex_count(), 0);
  for (const std::uint32_t a : boundary_.vertices())
    for (const std::uint32_t b : boundary_.open_out(a)) spread_edge_length(a, b);
  std::vector<float> sorted = gather_spacing();
  if (sorted.empty()) return;
  const auto nth = sorted.begin() + std::ptrdiff_t(double(sorted.size() - 1) * 0.98);
  std::nth_element(sorted.begin(), nth, sorted.end());
  widest_spacing_ = *nth;
}

std::vector<float> Front::gather_spacing() const {
  std::vector<float> out;
  for (const std::uint32_t v : boundary_.vertices()) out.push_back(spacing_[v]);
  return out;
}

// Twice the median disagreement covers most of it.
float Front::extra_reach(int round) const {
  return round >= kFirstFarRound ? 2.0f * float(options_.registration_error_m) : 0.0f;
}

// Tells the boundary vertices that an open edge may pass how far away its ends are.
void Front::spread_edge_length(std::uint32_t a, std::uint32_t b) {
  const auto &p = mesh_.positions_m[a], &q = mesh_.positions_m[b];
  const float length = (p - q).norm();
  thread_local std::vector<Neighbor> near;
  tree_.find_in_radius(0.5f * (p + q), length, near);
  for (const Neighbor& neighbor : near) {
    float& reach = edge_reach_[boundary_.vertices()[neighbor.index]];
    reach = std::max(reach, length);
  }
}

// Boundary vertices around an edge; returns how far candidates may be from its middle. What is found reaches farther,
// so that both ends of every edge that could cross are among it.
float Front::find_around(std::uint32_t a, std::uint32_t b, int round, std::vector<Neighbor>& around) const {
  const float reach = float(options_.reach_factor);
  const float own = std::max({spacing_[a], spacing_[b], (mesh_.positions_m[a] - mesh_.positions_m[b]).norm()});
  const Eigen::Vector3f middle = 0.5f * (mesh_.positions_m[a] + mesh_.positions_m[b]);
  const float factor = kRadiusFactor[round];
  const float extra = extra_reach(round);
  const float radius = (factor > 0 ? std::min(factor, reach) * own : reach * own) + extra;
  const float margin = std::max({0.5f * radius, edge_reach_[a], edge_reach_[b]});
  tree_.find_in_radius(middle, radius + margin, around);
  if (factor > 0) return radius;
  // Last rounds: a coarser patch near by may be reached from farther away.
  float coarsest = own;
  for (const Neighbor& neighbor : around) coarsest = std::max(coarsest, spacing_[boundary_.vertices()[neighbor.index]]);
  coarsest = std::min(coarsest, std::max(own, widest_spacing_));
  if (coarsest < 1.2f * own) return radius;
  tree_.find_in_radius(middle, reach * coarsest + extra + margin, around);
  return reach * coarsest + extra;
}

bool Front::is_well_shaped(std::uint32_t a, std::uint32_t b, std::uint32_t c, int round) const {
  const auto &pa = mesh_.positions_m[a], &pb = mesh_.positions_m[b], &pc = mesh_.positions_m[c];
  const float ab = (pb - pa).norm(), bc = (pc - pb).norm(), ca = (pa - pc).norm();
  const float longest_allowed =
      float(options_.reach_factor) * std::max({spacing_[a], spacing_[b], spacing_[c]}) + extra_reach(round);
  if (std::max(bc, ca) > std::max(longest_allowed, ab)) return false;
  const Eigen::Vector3f normal = (pa - pb).cross(pc - pb);
  const float twice_area = normal.norm();
  // Sine of the smallest angle: height over the longest edge, by the middle one.
  const float longest = std::max({ab, bc, ca}), shortest = std::min({ab, bc, ca});
  const float middle = ab + bc + ca - longest - shortest;
  if (!(twice_area > kSmallestSine[round] * longest * middle)) return false;
  const float facing = kFacingCosine * twice_area;
  return normal.dot(normals_[a]) > facing && normal.dot(normals_[b]) > facing && normal.dot(normals_[c]) > facing;
}

bool Front::is_valid(std::uint32_t a, std::uint32_t b, std::uint32_t c, const std::vector<Neighbor>& around) const {
  if (!boundary_.is_on_boundary(c) || !boundary_.is_open(a, b)) return false;
  if (boundary_.has_half_edge(a, c) || boundary_.has_half_edge(c, b)) return false;
  const auto& p = mesh_.positions_m;
  const Eigen::Vector3f normal = (normals_[a] + normals_[b] + normals_[c]).stableNormalized();
  const LocalPlane plane(p[a], normal);
  const Vec2 qa = plane.project(p[a]), qb = plane.project(p[b]), qc = plane.project(p[c]);
  if (!(area2(qb, qa, qc) > 0)) return false;
  // Clockwise at each corner: a from b to c, b from c to a, c from a to b.
  if (!in_open_sector(boundary_, plane, p, a, b, c) || !in_open_sector(boundary_, plane, p, b, c, a) ||
      !in_open_sector(boundary_, plane, p, c, a, b))
    return false;
  const float size = std::max({(p[a] - p[b]).norm(), (p[b] - p[c]).norm(), (p[c] - p[a]).norm()});
  const float slack = -kOnEdge * size * size;
  const bool is_ac_new = !boundary_.has_half_edge(c, a), is_bc_new = !boundary_.has_half_edge(b, c);
  for (const Neighbor& neighbor : around) {
    const std::uint32_t v = boundary_.vertices()[neighbor.index];
    if (v == a || v == b || v == c) continue;
    if (normals_[v].dot(normal) < 0 || std::abs(plane.height(p[v])) > kLayerShare * size) continue;
    if (!boundary_.is_on_boundary(v)) continue;
    const Vec2 qv = plane.project(p[v]);
    // On an edge counts as inside: an edge through a vertex would leave a gap of no width that nothing can close.
    if (area2(qb, qa, qv) > slack && area2(qa, qc, qv) > slack && area2(qc, qb, qv) > slack) return false;
    for (const std::uint32_t w : boundary_.open_out(v)) {
      if (w == a || w == b || w == c) {
        // An edge that ends at a corner may still cross the side opposite to it.
        const Vec2 qw = w == a ? qa : w == b ? qb : qc;
        if (w == a && is_bc_new && do_cross(qb, qc, qv, qw)) return false;
        if (w == b && is_ac_new && do_cross(qa, qc, qv, qw)) return false;
        continue;
      }
      const Vec2 qw = plane.project(p[w]);
      if (is_ac_new && do_cross(qa, qc, qv, qw)) return false;
      if (is_bc_new && do_cross(qb, qc, qv, qw)) return false;
    }
  }
  // Open edges that leave the corners themselves.
  for (const std::uint32_t w : boundary_.open_out(a))
    if (w != b && w != c && is_bc_new && do_cross(qb, qc, qa, plane.project(p[w]))) return false;
  for (const std::uint32_t w : boundary_.open_out(b))
    if (w != a && w != c && is_ac_new && do_cross(qa, qc, qb, plane.project(p[w]))) return false;
  return !options_.is_seen_through || !options_.is_seen_through(mesh_, {b, a, c});
}

bool Front::find_best(std::uint32_t a, std::uint32_t b, int round, Candidate& best) const {
  const auto& p = mesh_.positions_m;
  thread_local std::vector<Neighbor> around;
  const float radius = find_around(a, b, round, around);
  thread_local std::vector<Candidate> candidates;
  candidates.clear();
  for (const Neighbor& neighbor : around) {
    if (neighbor.squared_distance > radius * radius) continue;
    const std::uint32_t c = boundary_.vertices()[neighbor.index];
    if (c == a || c == b || !boundary_.is_on_boundary(c) || !is_well_shaped(a, b, c, round)) continue;
    const Eigen::Vector3f ca = (p[a] - p[c]).normalized(), cb = (p[b] - p[c]).normalized();
    candidates.push_back({ca.dot(cb), a, b, c});
  }
  std::sort(candidates.begin(), candidates.end(), [](const Candidate& x, const Candidate& y) {
    return x.cosine != y.cosine ? x.cosine < y.cosine : x.c < y.c;
  });
  for (const Candidate& candidate : candidates)
    if (is_valid(a, b, candidate.c, around)) {
      best = candidate;
      return true;
    }
  return false;
}

void Front::add_triangle(const Triangle& t) {
  for (std::size_t k = 0; k < 3; ++k) {
    const std::uint32_t a = t[k], b = t[(k + 1) % 3];
    if (boundary_.has_half_edge(b, a)) continue;
    active_.push_back(key(a, b));
    cut_.insert(key(a, b));
  }
  boundary_.add(t);
  for (std::size_t k = 0; k < 3; ++k)
    if (boundary_.is_open(t[k], t[(k + 1) % 3])) spread_edge_length(t[k], t[(k + 1) % 3]);
  // A seam triangle is textured from the view that most of its corners come from; the first of them on a tie.
  std::uint32_t view = kInvalidIndex;
  if (!mesh_.vertex_view.empty()) {
    const std::uint32_t x = mesh_.vertex_view[t[0]], y = mesh_.vertex_view[t[1]], z = mesh_.vertex_view[t[2]];
    view = y == z ? y : x;
  }
  mesh_.triangles.push_back(t);
  if (!mesh_.triangle_view.empty()) mesh_.triangle_view.push_back(view);
  if (!mesh_.triangle_tag.empty()) mesh_.triangle_tag.push_back(TriangleTag::kSeam);
}

void Front::grow(SewReport& report) {
  report.active_edges = active_.size();
  for (int round = 0; round < kRounds; ++round) {
    context_.throw_if_cancelled();
    std::vector<std::uint64_t> edges;
    edges.swap(active_);
    std::sort(edges.begin(), edges.end());
    std::vector<Candidate> best(edges.size());
    std::vector<std::uint8_t> found(edges.size(), 0);
    parallel_for(context_, edges.size(), 256, [&](std::size_t i) {
      const auto a = std::uint32_t(edges[i] >> 32), b = std::uint32_t(edges[i]);
      found[i] = boundary_.is_open(a, b) && find_best(a, b, round, best[i]);
    });
    std::priority_queue<Candidate, std::vector<Candidate>, IsWorse> queue;
    std::vector<std::uint64_t> left;
    for (std::size_t i = 0; i < edges.size(); ++i) {
      if (found[i])
        queue.push(best[i]);
      else
        left.push_back(edges[i]);
    }
    std::vector<Neighbor> around;
    while (!queue.empty()) {
      const Candidate next = queue.top();
      queue.pop();
      if (!boundary_.is_open(next.a, next.b)) continue;
      find_around(next.a, next.b, round, around);
      if (!is_valid(next.a, next.b, next.c, around)) {
        Candidate other;
        if (find_best(next.a, next.b, round, other))
          queue.push(other);
        else
          left.push_back(key(next.a, next.b));
        continue;
      }
      active_.clear();
      add_triangle({next.b, next.a, next.c});
      ++report.front_triangles;
      for (const std::uint64_t edge : active_) {
        Candidate other;
        const auto a = std::uint32_t(edge >> 32), b = std::uint32_t(edge);
        if (find_best(a, b, round, other))
          queue.push(other);
        else
          left.push_back(edge);
      }
    }
    active_.swap(left);
  }
  report.open_edges = std::uint64_t(std::count_if(active_.begin(), active_.end(), [&](std::uint64_t edge) {
    return boundary_.is_open(std::uint32_t(edge >> 32), std::uint32_t(edge));
  }));
}

}  // namespace lapseam
