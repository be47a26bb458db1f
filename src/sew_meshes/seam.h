#pragma once

// Closes what was cut: a front that advances into the gap, loops where it stops, and, where neither is possible, a
// wider cut and another try. Based on: Y. Sun, C. Dumont, M. Abidi 2000, §2.3; G. Turk, M. Levoy, Zippered Polygon
// Meshes from Range Images, 1994.

#include <memory>
#include <vector>

#include "lapseam/sew_meshes.h"
#include "sew_meshes/loops.h"
#include "sew_meshes/surface_probe.h"
#include "sew_meshes/triangle_check.h"
#include "spatial/kd_tree.h"

namespace lapseam {

class Context;

class Seam {
 public:
  /// probes: of the meshes as they came; no seam is made where none of them has a surface. layer_m: how far two meshes
  /// that show one surface may lie apart.
  Seam(LiveMesh& mesh, const MergedMeshes& merged, const SurfaceProbes& probes, float layer_m, Context& context);

  void close(SewMeshesReport& report);

 private:
  struct Candidate {
    double sine = 0;    // of the smallest angle: the best shape is made first
    double cosine = 0;  // of the angle at c, under which the edge is seen
    std::uint32_t a = 0, b = 0, c = 0;
    bool operator<(const Candidate& o) const {
      if (sine != o.sine) return sine < o.sine;
      return a != o.a ? a > o.a : b > o.b;
    }
  };
  using Edge = std::array<std::uint32_t, 2>;

  TriangleRule rule_of(int round) const;
  bool is_covered(const Triangle& t) const;
  bool goes_on_beyond(const Edge& edge) const;
  bool find_best(const Edge& edge, int round, Candidate& best) const;
  void grow(SewMeshesReport& report);
  void close_loops(int attempt, SewMeshesReport& report);
  std::vector<Loop> find_cracks() const;
  std::vector<Loop> find_pinches() const;  // loops of one vertex, in which several fans touch
  bool cut_loose_ends();
  std::vector<std::uint32_t> find_tangle(const Loop& crack) const;
  void widen(const std::vector<Loop>& cracks, int attempt, SewMeshesReport& report);

  LiveMesh& mesh_;
  const MergedMeshes& merged_;
  const SurfaceProbes& probes_;
  float layer_m_;
  Context& context_;
  TriangleCheck check_;
  std::uint32_t first_seam_;           // triangles from here on are ours
  std::vector<std::uint32_t> border_;  // vertices that the front may reach
  std::unique_ptr<KdTree> tree_;
};

}  // namespace lapseam
