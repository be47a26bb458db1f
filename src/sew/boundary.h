#pragma once

// The open edges of a mesh while it is being sewn, and the half-edges around them.

#include <cstdint>
#include <span>
#include <vector>

#include "lapseam/mesh.h"

namespace lapseam {

/// Half-edges among vertices that lie (or lay) on the boundary. A half-edge a → b belongs to the triangle on its left
/// and is open while b → a does not exist. Vertices elsewhere cannot take part in sewing and cost nothing.
class Boundary {
 public:
  explicit Boundary(const Mesh& mesh);

  /// Boundary vertices of the mesh as it was, in ascending order.
  const std::vector<std::uint32_t>& vertices() const { return vertices_; }

  bool has_half_edge(std::uint32_t a, std::uint32_t b) const;
  bool is_open(std::uint32_t a, std::uint32_t b) const { return has_half_edge(a, b) && !has_half_edge(b, a); }
  /// Heads of open half-edges that leave v.
  std::span<const std::uint32_t> open_out(std::uint32_t v) const { return list(open_out_, v); }
  /// Tails of open half-edges that arrive at v.
  std::span<const std::uint32_t> open_in(std::uint32_t v) const { return list(open_in_, v); }
  bool is_on_boundary(std::uint32_t v) const { return !open_out(v).empty(); }

  /// Adds a triangle whose half-edges are all free.
  void add(const Triangle& t);

 private:
  using Lists = std::vector<std::vector<std::uint32_t>>;
  std::span<const std::uint32_t> list(const Lists& lists, std::uint32_t v) const {
    return slot_[v] == kInvalidIndex ? std::span<const std::uint32_t>()
                                     : std::span<const std::uint32_t>(lists[slot_[v]]);
  }
  void add_half_edge(std::uint32_t a, std::uint32_t b);

  std::vector<std::uint32_t> vertices_;
  std::vector<std::uint32_t> slot_;  // of each mesh vertex, its place in the lists
  Lists out_;                        // heads of all half-edges between boundary vertices
  Lists open_out_, open_in_;
};

}  // namespace lapseam
