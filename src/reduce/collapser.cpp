// Based on: M. Garland, P. Heckbert, Surface Simplification Using Quadric Error Metrics, SIGGRAPH 1997; the link
// condition of T. Dey et al., Topology Preserving Edge Contraction, 1999; regularized as in P. Trettner, L. Kobbelt,
// Fast and Robust QEF Minimization using Probabilistic Quadrics, Eurographics 2020.

#include "reduce/collapser.h"

#include <Eigen/Geometry>
#include <bit>
#include <limits>

#include "lapseam/context.h"

namespace lapseam {
namespace {

constexpr float kLargestTurnCosine = 0.4f;  ///< of a triangle's normal in one collapse: 66°
/// Twice the area over the longest side squared; under it a triangle is a sliver (3°), to be made only out of worse.
/// Stricter is worse: triangles that may not be made keep their slivers as they are (measured: docs/reduction.md).
constexpr float kSliver = 0.05f;
/// What planes leave free, a vertex keeps from the two it was: a share of A's trace. Does what the spread of normals
/// does in probabilistic quadrics, but has no part in the error. Figures hardly change from 1e-5 to 1e-2, slivers do.
constexpr float kPull = 1e-3f;
/// Where nothing is lost either way, short edges go first: times the edge's squared length.
constexpr float kTieBreak = 1e-4f;
constexpr int kSweeps = 3;                           ///< see Collapser::sweep
constexpr float kEasyShare = 0.7f;                   ///< of the error bound
constexpr std::uint32_t kPopsBetweenChecks = 16384;  ///< for cancel: some milliseconds
constexpr std::size_t kLargestFan = 40;              ///< triangles around a vertex
/// A border vertex leaves the two places it was merged from only where that lowers the error to less than this share:
/// corners of exact borders stay, ragged borders are averaged.
constexpr float kBorderGain = 0.7f;

std::uint64_t mixed(std::uint32_t x) {  // splitmix64
  std::uint64_t z = (x + 1) * 0x9E3779B97F4A7C15ull;
  z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9ull;
  return z ^ (z >> 27);
}

std::size_t bucket_of(float squared_error) {
  // Exponent and three bits of mantissa: logarithmic steps of an eighth of an octave.
  return std::bit_cast<std::uint32_t>(std::max(squared_error, 0.f)) >> 20;
}

}  // namespace

Collapser::Collapser(Piece& piece, const std::vector<Eigen::Vector3f>& source_positions_m, const Context& context)
    : piece_(piece), source_positions_m_(source_positions_m), context_(context) {
  const std::size_t n = piece.vertices.size();
  version_.assign(n, 0);
  stamp_.assign(n, 0);
  alive_ = piece.triangles.size();
  link_corners();
  mark_boundary();
}

void Collapser::link_corners() {
  next_corner_.resize(3 * piece_.triangles.size());
  for (ReduceVertex& vertex : piece_.vertices) vertex.first_corner = kInvalidIndex;
  for (std::size_t t = piece_.triangles.size(); t-- > 0;) {
    for (std::size_t k = 3; k-- > 0;) {
      std::uint32_t& first = piece_.vertices[piece_.triangles[t][k]].first_corner;
      next_corner_[3 * t + k] = first;
      first = std::uint32_t(3 * t + k);
    }
  }
}

// Around an inner vertex each neighbour is once the next corner of a triangle and once the one before: the sums of
// their hashes are equal. Around a vertex with an open edge they are not, but for a chance of 2⁻⁶⁴.
void Collapser::mark_boundary() {
  std::vector<std::uint64_t> balance(piece_.vertices.size(), 0);
  for (const Triangle& t : piece_.triangles) {
    const std::uint64_t h0 = mixed(t[0]), h1 = mixed(t[1]), h2 = mixed(t[2]);
    balance[t[0]] += h1 - h2;
    balance[t[1]] += h2 - h0;
    balance[t[2]] += h0 - h1;
  }
  is_boundary_.resize(balance.size());
  for (std::size_t v = 0; v < balance.size(); ++v) is_boundary_[v] = balance[v] != 0;
}

void Collapser::start_quadrics(const QuadricOptions& options, const std::vector<float>& squared_sigma) {
  for (const Triangle& t : piece_.triangles) {
    ReduceVertex* const corner[3] = {&piece_.vertices[t[0]], &piece_.vertices[t[1]], &piece_.vertices[t[2]]};
    const Eigen::Vector3f side = corner[1]->position_m - corner[0]->position_m;
    const Eigen::Vector3f other_side = corner[2]->position_m - corner[0]->position_m;
    const Eigen::Vector3f cross = side.cross(other_side);
    const float length = cross.norm();
    if (!(length > 0)) continue;
    const Eigen::Vector3f normal = cross / length, middle = (side + other_side) / 3 + corner[0]->position_m;
    const float area = length / 6;  // the third of the triangle that each corner stands for
    float weight = area;
    if (!squared_sigma.empty()) weight *= 3 / (squared_sigma[t[0]] + squared_sigma[t[1]] + squared_sigma[t[2]]);
    for (ReduceVertex* vertex : corner) {
      vertex->quadric.add_plane(middle - vertex->position_m, normal, weight);
      vertex->quadric.weight += options.in_sigmas ? area : weight;
    }
  }
  for (std::uint32_t v = 0; v < piece_.vertices.size(); ++v)
    if (is_boundary_[v]) add_border_planes(v, options.border_weight, squared_sigma);
}

// Planes that stand upright on the open edges of v: the surface does not shrink from its border. They have no part in
// what the error is divided by.
void Collapser::add_border_planes(std::uint32_t v, float weight_factor, const std::vector<float>& squared_sigma) {
  gather(v, fan_a_);
  tick_ += 4;
  // A neighbour's stamp: bit 0 it was the next corner of a triangle, bit 1 the one before.
  for (const std::uint32_t t : fan_a_) {
    const Triangle& triangle = piece_.triangles[t];
    for (std::uint32_t k = 0; k < 3; ++k) {
      if (triangle[k] == v) continue;
      const std::uint32_t bit = triangle[(k + 2) % 3] == v ? 1 : 2;
      std::uint32_t& stamp = stamp_[triangle[k]];
      if (stamp < tick_) stamp = tick_;
      stamp |= bit;
    }
  }
  ReduceVertex& vertex = piece_.vertices[v];
  for (const std::uint32_t t : fan_a_) {
    const Triangle& triangle = piece_.triangles[t];
    const Eigen::Vector3f cross =
        (piece_.vertices[triangle[1]].position_m - piece_.vertices[triangle[0]].position_m)
            .cross(piece_.vertices[triangle[2]].position_m - piece_.vertices[triangle[0]].position_m);
    for (const std::uint32_t other : triangle) {
      if (other == v || stamp_[other] == tick_ + 3) continue;
      const Eigen::Vector3f edge = piece_.vertices[other].position_m - vertex.position_m;
      const Eigen::Vector3f outward = edge.cross(cross);
      const float length = outward.norm();
      if (!(length > 0)) continue;
      float weight = weight_factor * edge.squaredNorm() / 2;
      if (!squared_sigma.empty()) weight *= 2 / (squared_sigma[v] + squared_sigma[other]);
      vertex.quadric.add_plane(Eigen::Vector3f::Zero(), outward / length, weight);
    }
  }
}

std::size_t Collapser::run(const CollapseLimits& limits) {
  limits_ = limits;
  if (limits_.max_squared_error < std::numeric_limits<float>::max())
    for (int i = 0; i < kSweeps; ++i) sweep(kEasyShare * kEasyShare * limits_.max_squared_error);
  push_all();
  Entry entry;
  for (std::uint32_t i = 0; alive_ > limits_.max_triangles && pop(entry); ++i) {
    if (i % kPopsBetweenChecks == 0) context_.throw_if_cancelled();
    if (version_[entry.a] == entry.version_a && version_[entry.b] == entry.version_b &&
        try_collapse(entry.a, entry.b, evaluate(entry.a, entry.b)))
      push_around(entry.a);
  }
  return alive_;
}

// Merges inner vertices in pairs, each at most once, with the first neighbour that is easy enough. Saves most of the
// queue's work; and on noise the even growth of what a vertex stands for gives fewer triangles at the same error than
// the queue's order does (measured: docs/reduction.md).
void Collapser::sweep(float easy_squared_error) {
  std::vector<std::uint8_t> is_done(piece_.vertices.size());
  for (std::size_t v = 0; v < is_done.size(); ++v) is_done[v] = piece_.is_locked[v] || is_boundary_[v];
  for (std::uint32_t v = 0; v < is_done.size() && alive_ > limits_.max_triangles; ++v) {
    if (is_done[v]) continue;
    for (std::uint32_t c = piece_.vertices[v].first_corner; c != kInvalidIndex; c = next_corner_[c]) {
      if (!is_alive(c / 3)) continue;
      const std::uint32_t w = piece_.triangles[c / 3][c % 3 == 2 ? 0 : c % 3 + 1];
      if (is_done[w]) continue;
      const Candidate candidate = evaluate(v, w);
      if (!(candidate.squared_error <= easy_squared_error) || !try_collapse(v, w, candidate)) continue;
      is_done[v] = is_done[w] = 1;
      break;
    }
  }
}

void Collapser::push_all() {
  bucket_.fill(kInvalidIndex);
  occupied_.fill(0);
  lowest_word_ = 0;
  entries_.clear();
  free_entry_ = kInvalidIndex;
  entries_.reserve(2 * piece_.triangles.size());
  for (const Triangle& t : piece_.triangles) {
    if (t[0] == kInvalidIndex) continue;
    for (std::size_t k = 0; k < 3; ++k) {
      const std::uint32_t a = t[k], b = t[(k + 1) % 3];
      // Two triangles run through an inner edge in opposite directions.
      if (a < b || (is_boundary_[a] && is_boundary_[b])) push(std::min(a, b), std::max(a, b));
    }
  }
}

Collapser::Candidate Collapser::evaluate(std::uint32_t a, std::uint32_t b) const {
  const Quadric &qa = piece_.vertices[a].quadric, &qb = piece_.vertices[b].quadric;
  const Eigen::Vector3f b_from_a = piece_.vertices[b].position_m - piece_.vertices[a].position_m;
  const Quadric sum = qa.plus(qb, b_from_a);
  const Eigen::Vector3f offset = place(a, b, sum, b_from_a);
  const float error = std::max(0.f, sum.at(offset));
  // The mean over all that the new vertex stands for, and what the collapse adds, over the smaller of the two: a small
  // detail is not outvoted by a large plane.
  const float mean = error / sum.weight;
  const float added = (error - qa.c - qb.c) / std::min(qa.weight, qb.weight);
  const float squared_error = std::max(mean, added);
  return {squared_error, squared_error + kTieBreak * b_from_a.squaredNorm(), offset};
}

Eigen::Vector3f Collapser::place(std::uint32_t a, std::uint32_t b, const Quadric& sum,
                                 const Eigen::Vector3f& b_from_a) const {
  const Eigen::Vector3f at_a = Eigen::Vector3f::Zero();
  if (is_boundary_[a] != is_boundary_[b]) return is_boundary_[a] ? at_a : b_from_a;
  if (limits_.placement == Placement::kOptimal && !is_boundary_[a]) {
    const float trace_b = piece_.vertices[b].quadric.trace(), trace = sum.trace();
    const auto best = sum.minimum_near(trace_b / trace * b_from_a, kPull * trace);
    if (best && (*best - 0.5f * b_from_a).squaredNorm() <= 4 * b_from_a.squaredNorm()) return *best;
  }
  const float error_a = sum.c, error_b = sum.at(b_from_a);
  const Eigen::Vector3f end = error_a <= error_b ? at_a : b_from_a;
  if (limits_.placement == Placement::kEndpoint) return end;
  // On the segment between the two: q is a parabola there.
  const float curvature = b_from_a.dot(sum.times(b_from_a));
  if (!(curvature > 0)) return end;
  const float s = std::clamp(-b_from_a.dot(sum.linear()) / curvature, 0.f, 1.f);
  const Eigen::Vector3f between = s * b_from_a;
  return sum.at(between) < kBorderGain * std::min(error_a, error_b) ? between : end;
}

void Collapser::push(std::uint32_t a, std::uint32_t b) {
  if (piece_.is_locked[a] || piece_.is_locked[b]) return;
  const Candidate candidate = evaluate(a, b);
  if (!(candidate.squared_error <= limits_.max_squared_error)) return;
  std::uint32_t slot = free_entry_;
  if (slot != kInvalidIndex) {
    free_entry_ = entries_[slot].next;
  } else {
    slot = std::uint32_t(entries_.size());
    entries_.emplace_back();
  }
  const std::size_t i = bucket_of(candidate.cost);
  entries_[slot] = {a, b, bucket_[i], version_[a], version_[b]};
  bucket_[i] = slot;
  occupied_[i / 64] |= std::uint64_t(1) << (i % 64);
  lowest_word_ = std::min(lowest_word_, i / 64);
}

bool Collapser::pop(Entry& entry) {
  while (lowest_word_ < occupied_.size() && occupied_[lowest_word_] == 0) ++lowest_word_;
  if (lowest_word_ == occupied_.size()) return false;
  const std::size_t i = 64 * lowest_word_ + std::size_t(std::countr_zero(occupied_[lowest_word_]));
  const std::uint32_t slot = bucket_[i];
  entry = entries_[slot];
  bucket_[i] = entry.next;
  if (entry.next == kInvalidIndex) occupied_[lowest_word_] &= ~(std::uint64_t(1) << (i % 64));
  if (entry.next != kInvalidIndex) __builtin_prefetch(&entries_[entry.next]);
  entries_[slot].next = free_entry_;
  free_entry_ = slot;
  return true;
}

void Collapser::gather(std::uint32_t v, std::vector<std::uint32_t>& fan) const {
  fan.clear();
  for (std::uint32_t c = piece_.vertices[v].first_corner; c != kInvalidIndex; c = next_corner_[c])
    if (is_alive(c / 3)) fan.push_back(c / 3);
}

bool Collapser::has_more_triangles_than(std::size_t count, std::uint32_t v) const {
  for (std::uint32_t c = piece_.vertices[v].first_corner; c != kInvalidIndex; c = next_corner_[c])
    if (is_alive(c / 3) && count-- == 0) return true;
  return false;
}

bool Collapser::try_collapse(std::uint32_t a, std::uint32_t b, const Candidate& candidate) {
  gather(a, fan_a_);
  gather(b, fan_b_);
  if (fan_a_.size() + fan_b_.size() > kLargestFan || !keeps_topology(a, b)) return false;
  const Eigen::Vector3f position_m = piece_.vertices[a].position_m + candidate.offset;
  if (!keeps_shape(a, b, fan_a_, position_m) || !keeps_shape(b, a, fan_b_, position_m)) return false;
  merge(a, b, candidate);
  return true;
}

// Vertices that are neighbours of both must be those of the one or two triangles that go (the link condition); an
// inner edge between two border vertices is a bridge; and what is left must not fold onto itself.
bool Collapser::keeps_topology(std::uint32_t a, std::uint32_t b) {
  tick_ += 4;
  std::size_t shared = 0, common = 0;
  for (const std::uint32_t t : fan_a_) {
    const Triangle& triangle = piece_.triangles[t];
    shared += triangle[0] == b || triangle[1] == b || triangle[2] == b;
    for (const std::uint32_t v : triangle) stamp_[v] = tick_;
  }
  if (shared == 0 || shared > 2 || (is_boundary_[a] && is_boundary_[b] && shared != 1)) return false;
  if (fan_a_.size() + fan_b_.size() == 2 * shared) return false;
  for (const std::uint32_t t : fan_b_) {
    for (const std::uint32_t v : piece_.triangles[t]) {
      if (v == a || v == b || stamp_[v] != tick_) continue;
      stamp_[v] = tick_ + 1;
      ++common;
      // It loses a triangle: two that are left of a closed fan would lie on each other.
      if (!has_more_triangles_than(is_boundary_[v] ? 1 : 3, v)) return false;
    }
  }
  return common == shared;
}

bool Collapser::keeps_shape(std::uint32_t v, std::uint32_t other, const std::vector<std::uint32_t>& fan,
                            const Eigen::Vector3f& position_m) const {
  const Eigen::Vector3f old_m = piece_.vertices[v].position_m;
  for (const std::uint32_t t : fan) {
    const Triangle& triangle = piece_.triangles[t];
    const std::size_t k = triangle[0] == v ? 0 : triangle[1] == v ? 1 : 2;
    const std::uint32_t next = triangle[(k + 1) % 3], last = triangle[(k + 2) % 3];
    if (next == other || last == other) continue;  // goes
    const Eigen::Vector3f &p = piece_.vertices[next].position_m, &q = piece_.vertices[last].position_m;
    const Eigen::Vector3f old_cross = (p - old_m).cross(q - old_m), new_cross = (p - position_m).cross(q - position_m);
    const float cosine = old_cross.dot(new_cross), old_square = old_cross.squaredNorm(),
                new_square = new_cross.squaredNorm();
    if (!(new_square > 0)) return false;
    if (old_square > 0 &&
        !(cosine > 0 && cosine * cosine >= kLargestTurnCosine * kLargestTurnCosine * old_square * new_square))
      return false;
    const float base = (p - q).squaredNorm();
    const float new_longest = std::max({base, (p - position_m).squaredNorm(), (q - position_m).squaredNorm()});
    if (new_square < kSliver * kSliver * new_longest * new_longest) {
      const float old_longest = std::max({base, (p - old_m).squaredNorm(), (q - old_m).squaredNorm()});
      if (new_square * old_longest * old_longest < old_square * new_longest * new_longest) return false;
    }
  }
  return true;
}

void Collapser::merge(std::uint32_t a, std::uint32_t b, const Candidate& candidate) {
  ReduceVertex &va = piece_.vertices[a], &vb = piece_.vertices[b];
  const Eigen::Vector3f b_from_a = vb.position_m - va.position_m;
  va.quadric = va.quadric.plus(vb.quadric, b_from_a);
  va.quadric.move_to(candidate.offset);
  // Onto b means exactly there.
  va.position_m = candidate.offset == b_from_a ? vb.position_m : va.position_m + candidate.offset;
  const float distance_a = (source_positions_m_[va.source] - va.position_m).squaredNorm();
  const float distance_b = (source_positions_m_[vb.source] - va.position_m).squaredNorm();
  if (distance_b < distance_a || (distance_b == distance_a && vb.source < va.source)) va.source = vb.source;
  is_boundary_[a] |= is_boundary_[b];
  ++version_[a];
  ++version_[b];

  // Triangles with both go; the others are a's, in one list without the dead.
  std::uint32_t* link = &va.first_corner;
  const auto append = [&](std::uint32_t t, std::uint32_t v) {
    Triangle& triangle = piece_.triangles[t];
    const std::uint32_t k = triangle[0] == v ? 0 : triangle[1] == v ? 1 : 2;
    triangle[k] = a;
    *link = 3 * t + k;
    link = &next_corner_[3 * t + k];
  };
  for (const std::uint32_t t : fan_a_) {
    Triangle& triangle = piece_.triangles[t];
    if (triangle[0] == b || triangle[1] == b || triangle[2] == b) {
      triangle[0] = kInvalidIndex;
      --alive_;
    } else {
      append(t, a);
    }
  }
  for (const std::uint32_t t : fan_b_)
    if (is_alive(t)) append(t, b);
  *link = kInvalidIndex;
  vb.first_corner = kInvalidIndex;
}

void Collapser::push_around(std::uint32_t v) {
  tick_ += 4;
  for (std::uint32_t c = piece_.vertices[v].first_corner; c != kInvalidIndex; c = next_corner_[c]) {
    for (const std::uint32_t w : piece_.triangles[c / 3]) {
      if (w == v || stamp_[w] == tick_) continue;
      stamp_[w] = tick_;
      push(std::min(v, w), std::max(v, w));
    }
  }
}

}  // namespace lapseam
