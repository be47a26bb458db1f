#pragma once

// Builds a scene out of simple solids. All shapes are closed (or meant to be seen from one side only) and wind
// counter-clockwise seen from outside; triangles without area are left out.

#include <Eigen/Geometry>
#include <functional>
#include <span>
#include <vector>

#include "lapseam/simulate.h"

namespace lapseam::simulation {

/// 0xRRGGBB in sRGB to linear reflectance.
Eigen::Vector3f linear_color(std::uint32_t srgb);

class MeshBuilder {
 public:
  /// Shapes that follow are placed by this frame, and so are patterns.
  void set_frame(const Eigen::Isometry3d& T_world_object) { T_world_object_ = T_world_object; }
  const Eigen::Isometry3d& frame() const { return T_world_object_; }
  /// Shapes that follow have this material; its pattern frame becomes the current frame.
  void use(Material material);

  void add_quad(const Eigen::Vector3d& a, const Eigen::Vector3d& b, const Eigen::Vector3d& c, const Eigen::Vector3d& d);
  void add_box(const Eigen::Vector3d& low, const Eigen::Vector3d& high);
  /// Points (radius, z) turned about z; outside is to the right when walking along the profile with z up.
  void add_revolution(std::span<const Eigen::Vector2d> profile, int segments);
  /// A round rod along a polyline, with flat ends.
  void add_tube(std::span<const Eigen::Vector3d> path, double diameter_m, int sides);
  void add_rod(const Eigen::Vector3d& a, const Eigen::Vector3d& b, double diameter_m, int sides = 12);
  void add_torus(const Eigen::Vector3d& center, double radius_m, double tube_radius_m, int segments, int sides);
  /// Exponents 1 give an ellipsoid, smaller ones a pillow and then a box.
  void add_superellipsoid(const Eigen::Vector3d& center, const Eigen::Vector3d& radii, double exponent_vertical,
                          double exponent_horizontal, int segments);
  /// A sphere by subdivision of the icosahedron: 20·4^levels triangles.
  void add_icosphere(double radius_m, int levels);
  /// A sheet that stands on a line in the plane z = z0, thickness_m thick.
  void add_curtain(std::span<const Eigen::Vector2d> line, double thickness_m, double z0, double z1);

  /// The scene so far; vertices are coloured by their materials.
  SimulatedScene finish(std::string name);

 private:
  std::uint32_t add_vertex(const Eigen::Vector3d& object_point);
  void add_triangle(std::uint32_t a, std::uint32_t b, std::uint32_t c);
  /// (nu + 1) × (nv + 1) grid of points; u × v points outward; the last column equals the first when closed_u.
  void add_grid(int nu, int nv, bool closed_u, bool closed_v, const std::function<Eigen::Vector3d(int, int)>& point);

  Eigen::Isometry3d T_world_object_ = Eigen::Isometry3d::Identity();
  SimulatedScene scene_;
};

}  // namespace lapseam::simulation
