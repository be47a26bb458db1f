#pragma once

// The advancing front: one open edge after another is given the triangle that sees it under the largest angle.

#include <unordered_set>
#include <vector>

#include "lapseam/sew.h"
#include "sew/boundary.h"
#include "spatial/kd_tree.h"

namespace lapseam {

class Front {
 public:
  Front(Mesh& mesh, std::span<const BoundaryEdge> active_edges, const SewOptions& options, Context& context);

  /// Grows until nothing valid is left; adds to the report.
  void grow(SewReport& report);
  /// Closes the small loops that are left and consist mostly of edges that were cut or sewn.
  void close_loops(SewReport& report);

 private:
  struct Candidate {
    float cosine;  // of the angle at c; smaller is better
    std::uint32_t a, b, c;
  };
  struct IsWorse {
    bool operator()(const Candidate& x, const Candidate& y) const;
  };
  static std::uint64_t key(std::uint32_t a, std::uint32_t b) { return std::uint64_t(a) << 32 | b; }

  void measure_vertices();
  float extra_reach(int round) const;
  std::vector<float> gather_spacing() const;
  void spread_edge_length(std::uint32_t a, std::uint32_t b);
  float find_around(std::uint32_t a, std::uint32_t b, int round, std::vector<Neighbor>& around) const;
  bool find_best(std::uint32_t a, std::uint32_t b, int round, Candidate& best) const;
  bool is_well_shaped(std::uint32_t a, std::uint32_t b, std::uint32_t c, int round) const;
  bool is_valid(std::uint32_t a, std::uint32_t b, std::uint32_t c, const std::vector<Neighbor>& around) const;
  void add_triangle(const Triangle& t);
  bool close_loop(const std::vector<std::uint32_t>& loop, SewReport& report);

  Mesh& mesh_;
  const SewOptions& options_;
  Context& context_;
  Boundary boundary_;
  KdTree tree_;  // over boundary_.vertices()
  std::vector<Eigen::Vector3f> normals_;
  std::vector<float> spacing_;         // mean length of the edges at a vertex
  std::vector<float> edge_reach_;      // longest open edge whose ends may lie this far from a vertex and still pass it
  float widest_spacing_ = 0;           // what all but a few boundary vertices stay below
  std::vector<std::uint64_t> active_;  // open edges that want a triangle, in order
  std::unordered_set<std::uint64_t>
      cut_;  // membership only: edges that were cut or sewn, as opposed to natural borders
};

/// Closes loops; see Front::close_loops. Vertices in the order of the open half-edges. Empty when there is no good
/// filling.
std::vector<Triangle> triangulate_loop(const std::vector<std::uint32_t>& loop,
                                       const std::vector<Eigen::Vector3f>& positions,
                                       const std::vector<Eigen::Vector3f>& normals, const Boundary& boundary);

}  // namespace lapseam
