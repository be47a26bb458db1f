#pragma once

// Whether a new triangle may stand where it would stand.

#include <cstdint>
#include <functional>
#include <span>
#include <utility>
#include <vector>

#include "sew_meshes/box_forest.h"
#include "sew_meshes/live_mesh.h"

namespace lapseam {

class Context;

/// What a new triangle must satisfy beside meeting nothing.
struct TriangleRule {
  double smallest_sine = 0;   ///< of its smallest angle
  double fold_cosine = -0.9;  ///< its normal against those of the triangles across its edges
  double facing_cosine = -2;  ///< its normal against the surface's at its corners; below −1: not asked
  double corner_cosine = -2;  ///< the surface's normals at two of its corners; below: two sides of a sheet
  float layer_m = 0;  ///< a triangle that lies over or under it, nearer than this and facing alike, is in its way
  double slack = 0;   ///< but by this share of its own size they may overlap
};

/// Exact tests against all living triangles of a mesh.
class TriangleCheck {
 public:
  /// vertex_normals: of the surface, unit or zero; empty where no rule asks for facing.
  TriangleCheck(LiveMesh& mesh, std::span<const Eigen::Vector3f> vertex_normals, Context& context);
  /// Of a draft of that mesh; the mesh's own check must outlive it and stay as it is.
  TriangleCheck(LiveMesh& draft, const TriangleCheck& original)
      : mesh_(draft), normals_(original.normals_), original_(&original) {}

  /// A further condition for is_valid, asked before the costly ones.
  void set_condition(std::function<bool(const Triangle&)> condition) { condition_ = std::move(condition); }

  /// Half-edges free, no fold, shape and facing within the rule, the further condition, and clear.
  bool is_valid(const Triangle& t, const TriangleRule& rule) const;
  /// As is_valid, but for what the triangle may meet.
  bool may_fit(const Triangle& t, const TriangleRule& rule) const { return does_fit(t, rule) && meets_condition(t); }
  /// The further condition alone. A draft's check does not have that of the original.
  bool meets_condition(const Triangle& t) const { return !condition_ || condition_(t); }
  /// Whether the triangle meets no living one, and none lies over it.
  bool is_clear(const Triangle& t, const TriangleRule& rule) const;
  /// Whether the triangle fits its edges: free half-edges, area, shape, folds, facing.
  bool does_fit(const Triangle& t, const TriangleRule& rule) const;
  /// How much a triangle, living or not, is bent against what is around: cosine of the sharpest fold at its edges.
  double fold_of(const Triangle& t) const;
  /// The same between it and the surface at its corners; 1 without vertex normals.
  double facing_of(const Triangle& t) const;
  /// Calls visit(triangle) for living triangles whose boxes overlap the box, in any order, until it returns true;
  /// returns whether it did.
  template <class Visit>
  bool is_any_near(const Box& box, const Visit& visit) const {
    return find_boxes(box, [&](std::uint32_t id) { return mesh_.is_alive(id) && visit(mesh_.triangle(id)); });
  }
  /// Living triangles whose boxes overlap the box.
  std::vector<std::uint32_t> find_near(const Box& box) const;
  /// Adds a triangle to the mesh and to what is searched.
  std::uint32_t add(const Triangle& t, TriangleTag tag);

 private:
  template <class Visit>
  bool find_boxes(const Box& box, const Visit& visit) const {
    return (original_ && original_->boxes_.find(box, visit)) || boxes_.find(box, visit);
  }
  bool does_overlap(const Triangle& t, const Triangle& s, const Eigen::Vector3d& normal,
                    const TriangleRule& rule) const;

  LiveMesh& mesh_;
  std::span<const Eigen::Vector3f> normals_;
  const TriangleCheck* original_ = nullptr;  // of a draft
  BoxForest boxes_;                          // of a draft: of what it adds
  std::function<bool(const Triangle&)> condition_;
};

/// Do triangles of one mesh meet elsewhere than in shared vertices? Exact; pairs that share an edge do not.
bool do_triangles_cross(std::span<const Eigen::Vector3f> positions_m, const Triangle& t, const Triangle& s);

Box box_of(const LiveMesh& mesh, const Triangle& t);

}  // namespace lapseam
