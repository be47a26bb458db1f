#pragma once

// Faulty and open edges, drawn over the picture wherever they are not hidden.

#include <functional>
#include <vector>

#include "lapseam/mesh.h"
#include "render/ray_maker.h"

namespace lapseam {

class Context;

struct MarkedEdge {
  std::uint32_t a, b;
  std::uint32_t triangle;  ///< the first that has it
  bool is_faulty;          ///< three or more triangles, or two that are wound alike; else: one triangle
};

/// Ordered by (smaller, larger) vertex.
std::vector<MarkedEdge> find_marked_edges(const Mesh& mesh, Context& context);

/// How much of each pixel the lines cover, 0…1.
struct EdgeCoverage {
  Image<float> boundary, faulty;
};

/// True when a point of this triangle's edge, on this ray, shows if nothing that is nearer than free_until_m hides it.
using EdgeShows = std::function<bool(const Ray& ray, double free_until_m, std::uint32_t triangle)>;

EdgeCoverage cover_edges(const Mesh& mesh, const std::vector<MarkedEdge>& edges, const RayMaker& rays,
                         const EdgeShows& shows, double width_px, Context& context);

}  // namespace lapseam
