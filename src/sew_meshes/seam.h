#pragma once

// Closes what was cut: a front that advances into the gap, loops where it stops, and, where neither is possible, a
// wider cut and another try. Based on: Y. Sun, C. Dumont, M. Abidi 2000, §2.3; G. Turk, M. Levoy, Zippered Polygon
// Meshes from Range Images, 1994.

#include <memory>
#include <span>
#include <vector>

#include "lapseam/sew_meshes.h"
#include "sew_meshes/loops.h"
#include "sew_meshes/triangle_check.h"
#include "spatial/kd_tree.h"

namespace lapseam {

class Context;

class Seam {
 public:
  /// Per vertex: unit normals and mean edge lengths of the meshes as they came. layer_m: how far two meshes that show
  /// one surface may lie apart.
  Seam(LiveMesh& mesh, std::span<const Eigen::Vector3f> normals, std::span<const float> spacing_m, float layer_m,
       Context& context);

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
  bool find_best(const Edge& edge, int round, Candidate& best) const;
  void grow(SewMeshesReport& report);
  void close_loops(SewMeshesReport& report);
  std::vector<Loop> find_cracks() const;
  void widen(const std::vector<Loop>& cracks, int attempt, SewMeshesReport& report);
  void improve(SewMeshesReport& report);
  bool flip(std::uint32_t a, std::uint32_t b);

  LiveMesh& mesh_;
  std::span<const Eigen::Vector3f> normals_;
  std::span<const float> spacing_m_;
  float layer_m_;
  Context& context_;
  TriangleCheck check_;
  std::vector<std::uint32_t> border_;  // vertices that the front may reach
  std::unique_ptr<KdTree> tree_;
};

}  // namespace lapseam
