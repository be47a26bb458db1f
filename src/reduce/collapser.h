#pragma once

// Edge collapses on one piece of a mesh, cheapest first, until the error or the count is reached.

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <vector>

#include "lapseam/mesh.h"
#include "lapseam/reduce.h"
#include "reduce/quadric.h"

namespace lapseam {

class Context;

/// A vertex on its way through the reduction: one cache line.
struct ReduceVertex {
  Eigen::Vector3f position_m = Eigen::Vector3f::Zero();
  Quadric quadric;           ///< about position_m
  std::uint32_t source = 0;  ///< vertex of the mesh given that was nearest, of those merged
  std::uint32_t first_corner = kInvalidIndex;
};
static_assert(sizeof(ReduceVertex) == 64);

/// A mesh that fits into the cache, with its own indices.
struct Piece {
  std::vector<ReduceVertex> vertices;
  std::vector<Triangle> triangles;      ///< the first index is invalid once a triangle is gone
  std::vector<std::uint32_t> source;    ///< per triangle, of the mesh given
  std::vector<std::uint8_t> is_locked;  ///< per vertex: neither moves nor goes
};

struct QuadricOptions {
  /// Of the planes that stand on open edges, against those of triangles. A scan's border is ragged by a sample spacing,
  /// which is more than its noise: with 1, a third more triangles are left at borders than with 0.1.
  float border_weight = 0.1f;
  bool in_sigmas = false;  ///< errors are in units of the vertices' sigma
};

struct CollapseLimits {
  float max_squared_error = 0;  ///< in the units of the quadrics; the largest float is none, and then nothing is swept
  std::size_t max_triangles = 0;  ///< stop when no more are left; 0: never
  Placement placement = Placement::kOptimal;
};

/// Works on one piece; cheap to make. Not thread-safe; deterministic.
class Collapser {
 public:
  /// source_positions_m: of the mesh given, to find the nearest source of a moved vertex. context: to be told to stop.
  Collapser(Piece& piece, const std::vector<Eigen::Vector3f>& source_positions_m, const Context& context);

  /// Sets the quadrics from triangles and open edges. squared_sigma: per vertex of the piece, or empty.
  void start_quadrics(const QuadricOptions& options, const std::vector<float>& squared_sigma);
  /// Collapses edges: first in sweeps, without order, what is well below the error; then the cheapest first. May be
  /// called again with wider limits. Returns how many triangles are left. Throws Cancelled.
  std::size_t run(const CollapseLimits& limits);

 private:
  struct Entry {
    std::uint32_t a, b, next;
    std::uint16_t version_a, version_b;
  };
  struct Candidate {
    float squared_error;
    float cost;              ///< what it is queued by
    Eigen::Vector3f offset;  ///< new position relative to that of a
  };
  static constexpr std::size_t kBuckets = 2048;

  void link_corners();
  void mark_boundary();
  void add_border_planes(std::uint32_t v, float weight_factor, const std::vector<float>& squared_sigma);
  Candidate evaluate(std::uint32_t a, std::uint32_t b) const;
  Eigen::Vector3f place(std::uint32_t a, std::uint32_t b, const Quadric& sum, const Eigen::Vector3f& b_from_a) const;
  void push(std::uint32_t a, std::uint32_t b);
  bool pop(Entry& entry);
  void push_all();
  bool try_collapse(std::uint32_t a, std::uint32_t b, const Candidate& candidate);
  void sweep(float easy_squared_error);
  void gather(std::uint32_t v, std::vector<std::uint32_t>& fan) const;
  bool keeps_topology(std::uint32_t a, std::uint32_t b);
  bool keeps_shape(std::uint32_t v, std::uint32_t other, const std::vector<std::uint32_t>& fan,
                   const Eigen::Vector3f& position_m) const;
  bool has_more_triangles_than(std::size_t count, std::uint32_t v) const;
  void merge(std::uint32_t a, std::uint32_t b, const Candidate& candidate);
  void push_around(std::uint32_t v);

  bool is_alive(std::uint32_t triangle) const { return piece_.triangles[triangle][0] != kInvalidIndex; }

  Piece& piece_;
  const std::vector<Eigen::Vector3f>& source_positions_m_;
  const Context& context_;
  CollapseLimits limits_;
  std::vector<std::uint32_t> next_corner_;  ///< of the same vertex; corner 3·t + k
  std::vector<std::uint8_t> is_boundary_;
  std::vector<std::uint16_t> version_;  ///< per vertex: a queue entry of another one is out of date
  std::vector<std::uint32_t> stamp_;    ///< per vertex, against tick_
  std::uint32_t tick_ = 0;
  std::vector<std::uint32_t> fan_a_, fan_b_;
  std::size_t alive_ = 0;

  // Queue: a list per bucket of costs that differ by less than an eighth; last in, first out, so that work stays where
  // the cache is warm.
  std::array<std::uint32_t, kBuckets> bucket_;
  std::array<std::uint64_t, kBuckets / 64> occupied_;
  std::size_t lowest_word_ = 0;
  std::vector<Entry> entries_;
  std::uint32_t free_entry_ = kInvalidIndex;
};

}  // namespace lapseam
