#pragma once

// The boundary of a mesh: its edges, the outlines that they form, and what lies beyond each.

#include <Eigen/Core>
#include <cstdint>
#include <span>
#include <vector>

#include "health/incidence.h"

namespace lapseam {

class Context;

/// The edge a → b of exactly one triangle, which lies to its left.
struct OutlineEdge {
  std::uint32_t a = 0, b = 0;
  std::uint32_t triangle = 0;
  std::uint32_t loop = 0;
  std::uint32_t before = kInvalidIndex;  ///< the edge of the same outline that ends in a; none where fans branch
  std::uint32_t after = kInvalidIndex;   ///< the one that begins in b
};

struct Outline {
  std::vector<OutlineEdge> edges;  ///< by triangle and corner
  std::uint32_t loops = 0;         ///< as MeshHealth counts them; numbered by their first edge
};

/// Deterministic; about 0.1 µs a triangle.
Outline find_outline(std::size_t vertices, std::span<const Triangle> triangles, const Incidence& incidence,
                     Context& context);

/// Where an outline edge is, and where the surface would go on.
struct OutlineFrame {
  Eigen::Vector3f middle = Eigen::Vector3f::Zero();
  Eigen::Vector3f inside = Eigen::Vector3f::Zero();   ///< centroid of the edge's triangle
  Eigen::Vector3f outward = Eigen::Vector3f::Zero();  ///< unit; in the plane of the surroundings, across the outline
  Eigen::Vector3f normal = Eigen::Vector3f::Zero();   ///< unit; mean of the triangles up to two away: noise tilts one
  float length_m = 0;
  float side_m = 0;  ///< middle one of the triangle's sides: how densely the surface was sampled
};
/// One for each edge of the outline. outward is zero where the surroundings have no area.
std::vector<OutlineFrame> outline_frames(std::span<const Eigen::Vector3f> positions_m,
                                         std::span<const Triangle> triangles, const Incidence& incidence,
                                         const Outline& outline, Context& context);

}  // namespace lapseam
