#pragma once

// A mesh that loses and gains triangles, with the neighbourhoods that this needs.

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <span>
#include <unordered_map>
#include <unordered_set>
#include <vector>

#include "lapseam/mesh.h"

namespace lapseam {

/// Corners are linked around each vertex: 4 bytes a corner and a vertex, and every question is answered by walking the
/// few triangles at a vertex. A half-edge a → b belongs to the triangle on its left and is open while b → a does not
/// exist; an open one is *cut* when it is not a border of the mesh as it was given.
///
/// A draft is a mesh as it would be with some changes: it takes memory for those alone, and many drafts of one mesh are
/// worked on at the same time.
class LiveMesh {
 public:
  /// Takes the triangles as they are: each half-edge may exist once. Triangles are appended to the mesh.
  explicit LiveMesh(Mesh& mesh);
  /// The mesh, itself no draft, must outlive its drafts and stay as it is while they are in use.
  static LiveMesh draft_of(const LiveMesh& mesh) { return LiveMesh(&mesh); }
  LiveMesh(const LiveMesh&) = delete;
  LiveMesh& operator=(const LiveMesh&) = delete;

  const Eigen::Vector3f& position(std::uint32_t v) const { return mesh_.positions_m[v]; }
  const std::vector<Eigen::Vector3f>& positions() const { return mesh_.positions_m; }
  const Triangle& triangle(std::uint32_t t) const {
    return t < first_drafted_ ? mesh_.triangles[t] : drafted_[t - first_drafted_].corners;
  }
  std::size_t triangle_count() const { return mesh_.triangles.size() + drafted_.size(); }
  std::size_t vertex_count() const { return mesh_.positions_m.size(); }
  bool is_alive(std::uint32_t t) const {
    if (!original_) return alive_[t] != 0;
    return t < first_drafted_ ? original_->alive_[t] && !is_removed_.contains(t)
                              : drafted_[t - first_drafted_].is_alive;
  }
  const std::vector<std::uint8_t>& alive() const { return alive_; }
  TriangleTag tag(std::uint32_t t) const {
    return t < first_drafted_ ? mesh_.triangle_tag[t] : drafted_[t - first_drafted_].tag;
  }
  /// The view that a triangle comes from. Not of one that a draft has added.
  std::uint32_t view(std::uint32_t t) const { return mesh_.triangle_view[t]; }
  void set_tag(std::uint32_t t, TriangleTag tag) { mesh_.triangle_tag[t] = tag; }
  /// Of a draft: triangles of the mesh that are gone, in rising order.
  std::vector<std::uint32_t> removed() const;

  /// The triangle of half-edge a → b, or kInvalidIndex.
  std::uint32_t find(std::uint32_t a, std::uint32_t b) const;
  bool is_open(std::uint32_t a, std::uint32_t b) const {
    return find(a, b) != kInvalidIndex && find(b, a) == kInvalidIndex;
  }
  bool is_cut(std::uint32_t a, std::uint32_t b) const { return cut_.contains(key(a, b)); }
  /// Whether a triangle at v came or went.
  bool is_touched(std::uint32_t v) const { return is_touched_[v] != 0; }
  std::uint32_t apex(std::uint32_t t, std::uint32_t a, std::uint32_t b) const;

  /// Triangles around a vertex.
  template <class Visit>
  void for_each_around(std::uint32_t v, const Visit& visit) const {
    for (std::uint32_t corner = head(v); corner != kInvalidIndex; corner = next(corner)) visit(corner / 3);
  }
  /// Heads of the open half-edges that leave v, and tails of those that arrive.
  void open_out(std::uint32_t v, std::vector<std::uint32_t>& out) const;
  void open_in(std::uint32_t v, std::vector<std::uint32_t>& in) const;
  bool is_on_border(std::uint32_t v) const;
  /// In how many separate fans the triangles at v lie.
  std::size_t count_fans(std::uint32_t v) const;

  Eigen::Vector3d area_normal(const Triangle& t) const;  ///< of twice the area's length
  Eigen::Vector3d area_normal(std::uint32_t t) const { return area_normal(triangle(t)); }

  /// Its neighbours' edges become cut.
  void remove(std::uint32_t t);
  /// Puts a removed triangle back.
  void restore(std::uint32_t t);
  /// Half-edges must be free. Its own open edges are cut. Provenance: the view that most corners come from.
  std::uint32_t add(const Triangle& t, TriangleTag tag);
  /// Open edges that are cut, by their first vertex.
  std::vector<std::array<std::uint32_t, 2>> cut_edges() const;

 private:
  struct Drafted {
    Triangle corners;
    TriangleTag tag;
    bool is_alive;
    std::array<std::uint32_t, 3> next;
  };

  explicit LiveMesh(const LiveMesh* original);
  static std::uint64_t key(std::uint32_t a, std::uint32_t b) { return std::uint64_t(a) << 32 | b; }
  void link(std::uint32_t t);
  void unlink(std::uint32_t t);
  std::uint32_t append(const Triangle& t, TriangleTag tag);
  void set_alive(std::uint32_t t, bool is_alive);

  std::uint32_t head(std::uint32_t v) const {
    if (!original_) return head_[v];
    const auto changed = changed_head_.find(v);
    return changed != changed_head_.end() ? changed->second : original_->head_[v];
  }
  std::uint32_t next(std::uint32_t corner) const {
    if (!original_) return next_[corner];
    if (corner / 3 >= first_drafted_) return drafted_[corner / 3 - first_drafted_].next[corner % 3];
    const auto changed = changed_next_.find(corner);
    return changed != changed_next_.end() ? changed->second : original_->next_[corner];
  }
  void set_head(std::uint32_t v, std::uint32_t corner);
  void set_next(std::uint32_t corner, std::uint32_t to);

  Mesh& mesh_;
  std::vector<std::uint8_t> alive_;
  std::vector<std::uint32_t> head_, next_;  // per vertex, per corner: a corner
  std::unordered_set<std::uint64_t> cut_;   // membership only
  std::vector<std::uint8_t> is_touched_;    // per vertex: a triangle came or went

  // of a draft: what differs from the mesh
  const LiveMesh* original_ = nullptr;
  std::uint32_t first_drafted_ = kInvalidIndex;
  std::vector<Drafted> drafted_;
  std::unordered_set<std::uint32_t> is_removed_;
  std::unordered_map<std::uint32_t, std::uint32_t> changed_head_, changed_next_;
};

/// The smallest of the triangle's three sines.
double smallest_sine(const Eigen::Vector3f& a, const Eigen::Vector3f& b, const Eigen::Vector3f& c);

}  // namespace lapseam
