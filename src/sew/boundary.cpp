#include "sew/boundary.h"

#include <algorithm>

namespace lapseam {
namespace {

// Vertices with an edge that only one triangle has. Sort-based, one word per half-edge.
std::vector<std::uint8_t> mark_boundary_vertices(const Mesh& mesh) {
  std::vector<std::uint64_t> edges;
  edges.reserve(mesh.triangle_count() * 3);
  for (const Triangle& t : mesh.triangles)
    for (std::size_t k = 0; k < 3; ++k) {
      const std::uint64_t a = t[k], b = t[(k + 1) % 3];
      edges.push_back(a < b ? a << 32 | b : b << 32 | a);
    }
  std::sort(edges.begin(), edges.end());
  std::vector<std::uint8_t> is_boundary(mesh.vertex_count(), 0);
  for (std::size_t i = 0; i < edges.size();) {
    std::size_t j = i + 1;
    while (j < edges.size() && edges[j] == edges[i]) ++j;
    if (j - i == 1) is_boundary[edges[i] >> 32] = is_boundary[edges[i] & 0xFFFFFFFFu] = 1;
    i = j;
  }
  return is_boundary;
}

void erase_value(std::vector<std::uint32_t>& list, std::uint32_t value) {
  list.erase(std::find(list.begin(), list.end(), value));
}

}  // namespace

Boundary::Boundary(const Mesh& mesh) : slot_(mesh.vertex_count(), kInvalidIndex) {
  const std::vector<std::uint8_t> is_boundary = mark_boundary_vertices(mesh);
  for (std::uint32_t v = 0; v < is_boundary.size(); ++v)
    if (is_boundary[v]) {
      slot_[v] = std::uint32_t(vertices_.size());
      vertices_.push_back(v);
    }
  out_.resize(vertices_.size());
  open_out_.resize(vertices_.size());
  open_in_.resize(vertices_.size());
  for (const Triangle& t : mesh.triangles)
    for (std::size_t k = 0; k < 3; ++k) {
      const std::uint32_t a = t[k], b = t[(k + 1) % 3];
      if (is_boundary[a] && is_boundary[b]) out_[slot_[a]].push_back(b);
    }
  for (const std::uint32_t a : vertices_)
    for (const std::uint32_t b : out_[slot_[a]])
      if (!has_half_edge(b, a)) {
        open_out_[slot_[a]].push_back(b);
        open_in_[slot_[b]].push_back(a);
      }
}

bool Boundary::has_half_edge(std::uint32_t a, std::uint32_t b) const {
  if (slot_[a] == kInvalidIndex) return false;
  const auto& heads = out_[slot_[a]];
  return std::find(heads.begin(), heads.end(), b) != heads.end();
}

void Boundary::add_half_edge(std::uint32_t a, std::uint32_t b) {
  out_[slot_[a]].push_back(b);
  if (has_half_edge(b, a)) {
    erase_value(open_out_[slot_[b]], a);
    erase_value(open_in_[slot_[a]], b);
  } else {
    open_out_[slot_[a]].push_back(b);
    open_in_[slot_[b]].push_back(a);
  }
}

void Boundary::add(const Triangle& t) {
  for (std::size_t k = 0; k < 3; ++k) add_half_edge(t[k], t[(k + 1) % 3]);
}

}  // namespace lapseam
