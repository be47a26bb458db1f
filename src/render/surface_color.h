#pragma once

// What a point of the mesh looks like, before lines are drawn over it.

#include <Eigen/Core>
#include <vector>

#include "lapseam/render.h"
#include "spatial/ray_scene.h"

namespace lapseam {

/// sRGB, 0…255.
using Color = Eigen::Vector3f;

inline Color to_color(Rgb8 c) { return {float(c.r), float(c.g), float(c.b)}; }

/// Not normalised: its length is twice the area.
Eigen::Vector3f geometric_normal(const Mesh& mesh, std::uint32_t triangle);

/// Area-weighted, unit length (or zero), one per vertex.
std::vector<Eigen::Vector3f> vertex_normals(const Mesh& mesh);

/// Bilinear; the page's border continues outwards. Coordinates outside of 0…1, which only other programs write, repeat.
Color sample_page(const ColorImage& page, Eigen::Vector2f uv);

/// A colour for a view, far from those of its neighbours in the list.
Color view_color(std::uint32_t view);

class SurfaceColor {
 public:
  /// normals: of the vertices, for smooth shading; empty for flat. Throws InvalidInput when the mode lacks its data.
  SurfaceColor(const Mesh& mesh, RenderMode mode, const std::vector<Eigen::Vector3f>& normals,
               const Eigen::Vector3f& sky);

  Color shade(const RayHit& hit, const Eigen::Vector3f& ray_direction, bool is_backface) const;

 private:
  Color base_color(const RayHit& hit) const;
  Color vertex_color(const RayHit& hit) const;
  float light(const RayHit& hit, const Eigen::Vector3f& ray_direction, bool is_backface) const;

  const Mesh& mesh_;
  RenderMode mode_;
  const std::vector<Eigen::Vector3f>& normals_;
  Eigen::Vector3f sky_;
};

}  // namespace lapseam
