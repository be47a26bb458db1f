#pragma once

// The triangle mesh that stages pass on and files hold. Structure of arrays; optional arrays are empty or full.

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "lapseam/image.h"

namespace lapseam {

/// The one invalid index: of a vertex, triangle, view, pixel or page.
inline constexpr std::uint32_t kInvalidIndex = 0xFFFFFFFFu;

/// Where a triangle comes from.
enum class TriangleTag : std::uint8_t {
  kMeasured = 0,  ///< three neighbouring samples of one range image
  kSeam = 1,      ///< joins patches; its vertices are samples, its interior was not measured by one view
  kFilled = 2,    ///< closes a hole that nobody measured, because filling was asked for
};

using Triangle = std::array<std::uint32_t, 3>;

/// Indices wind counter-clockwise seen from the sensor side: normals point out of the solid.
struct Mesh {
  /// Positions are relative to this point, so that floats keep their precision far from the world origin.
  Eigen::Vector3d origin_m = Eigen::Vector3d::Zero();
  std::vector<Eigen::Vector3f> positions_m;
  std::vector<Triangle> triangles;

  // per vertex
  std::vector<Rgb8> colors;
  std::vector<std::uint32_t> vertex_view;   ///< index into the scene's views
  std::vector<std::uint32_t> vertex_pixel;  ///< v·width + u in that view's range image

  // per triangle
  std::vector<std::uint32_t>
      triangle_view;  ///< view that measured it; of a seam triangle, that of most of its vertices
  std::vector<TriangleTag> triangle_tag;

  // texture: three coordinates a triangle, origin at the top left of the page, in [0, 1]
  std::vector<std::array<Eigen::Vector2f, 3>> texcoords;
  std::vector<std::uint32_t> triangle_page;  ///< kInvalidIndex: untextured
  std::vector<ColorImage> pages;
  /// Per triangle: 1 where no image shows it, and its colour is made up of what is around it. Untextured triangles with
  /// 0 have colours of their vertices that images show.
  std::vector<std::uint8_t> is_unseen;

  std::size_t vertex_count() const { return positions_m.size(); }
  std::size_t triangle_count() const { return triangles.size(); }
};

/// Throws InvalidInput when an array has the wrong length, an index is out of range, or a position is not finite.
void check_mesh(const Mesh& mesh);

/// Leaves the mesh without texture coordinates and pages.
void drop_texture(Mesh& mesh);

/// Drops triangles where keep is 0, then vertices that nothing uses; order is kept. keep: one per triangle.
Mesh compact(const Mesh& mesh, const std::vector<std::uint8_t>& keep);

}  // namespace lapseam
