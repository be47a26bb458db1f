#pragma once

// A mesh that loses and gains triangles, with the neighbourhoods that this needs.

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <span>
#include <unordered_set>
#include <vector>

#include "lapseam/mesh.h"

namespace lapseam {

/// Corners are linked around each vertex: 4 bytes a corner and a vertex, and every question is answered by walking the
/// few triangles at a vertex. A half-edge a → b belongs to the triangle on its left and is open while b → a does not
/// exist; an open one is *cut* when it is not a border of the mesh as it was given.
class LiveMesh {
 public:
  /// Takes the triangles as they are: each half-edge may exist once. Triangles are appended to the mesh.
  explicit LiveMesh(Mesh& mesh);

  const Eigen::Vector3f& position(std::uint32_t v) const { return mesh_.positions_m[v]; }
  const std::vector<Eigen::Vector3f>& positions() const { return mesh_.positions_m; }
  const Triangle& triangle(std::uint32_t t) const { return mesh_.triangles[t]; }
  std::size_t triangle_count() const { return mesh_.triangles.size(); }
  std::size_t vertex_count() const { return mesh_.positions_m.size(); }
  bool is_alive(std::uint32_t t) const { return alive_[t] != 0; }
  const std::vector<std::uint8_t>& alive() const { return alive_; }
  TriangleTag tag(std::uint32_t t) const { return mesh_.triangle_tag[t]; }
  void set_tag(std::uint32_t t, TriangleTag tag) { mesh_.triangle_tag[t] = tag; }

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
    for (std::uint32_t corner = head_[v]; corner != kInvalidIndex; corner = next_[corner]) visit(corner / 3);
  }
  /// Heads of the open half-edges that leave v, and tails of those that arrive.
  void open_out(std::uint32_t v, std::vector<std::uint32_t>& out) const;
  void open_in(std::uint32_t v, std::vector<std::uint32_t>& in) const;
  bool is_on_border(std::uint32_t v) const;
  /// In how many separate fans the triangles at v lie.
  std::size_t count_fans(std::uint32_t v) const;

  Eigen::Vector3d area_normal(const Triangle& t) const;  ///< of twice the area's length
  Eigen::Vector3d area_normal(std::uint32_t t) const { return area_normal(mesh_.triangles[t]); }

  /// Its neighbours' edges become cut.
  void remove(std::uint32_t t);
  /// Puts a removed triangle back.
  void restore(std::uint32_t t);
  /// Half-edges must be free. Its own open edges are cut. Provenance: the view that most corners come from.
  std::uint32_t add(const Triangle& t, TriangleTag tag);
  /// Open edges that are cut, by their first vertex.
  std::vector<std::array<std::uint32_t, 2>> cut_edges() const;

 private:
  static std::uint64_t key(std::uint32_t a, std::uint32_t b) { return std::uint64_t(a) << 32 | b; }
  void link(std::uint32_t t);
  void unlink(std::uint32_t t);

  Mesh& mesh_;
  std::vector<std::uint8_t> alive_;
  std::vector<std::uint32_t> head_, next_;  // per vertex, per corner: a corner
  std::unordered_set<std::uint64_t> cut_;   // membership only
  std::vector<std::uint8_t> is_touched_;    // per vertex: a triangle came or went
};

/// The smallest of the triangle's three sines.
double smallest_sine(const Eigen::Vector3f& a, const Eigen::Vector3f& b, const Eigen::Vector3f& c);

}  // namespace lapseam
