#pragma once

// Connected regions of triangles that one image textures, and where they lie in it.

#include <Eigen/Geometry>
#include <array>
#include <span>
#include <vector>

#include "lapseam/mesh.h"
#include "lapseam/view.h"

namespace lapseam {

/// Position of a world point in a view's colour image, in pixels. False when the camera cannot see it.
class ColorProjection {
 public:
  ColorProjection(const ViewSource& source, const Eigen::Vector3d& mesh_origin_m);
  bool project(const Eigen::Vector3f& position_m, Eigen::Vector2f& pixel) const;
  int width() const { return width_; }
  int height() const { return height_; }
  bool wraps() const { return wraps_; }

 private:
  const Sensor& camera_;
  Eigen::Isometry3d T_color_mesh_;
  int width_, height_;
  bool wraps_;
};

struct Chart {
  std::uint32_t view = 0;
  int u0 = 0, v0 = 0, width = 0,
      height = 0;              ///< rectangle in the source image, padding included; may pass its right edge
  int page = 0, x = 0, y = 0;  ///< place in the atlas
};

struct Charts {
  std::vector<Chart> charts;
  std::vector<std::uint32_t> view_of_triangle;   ///< whose image textures it; the mesh's, or a seam's other one
  std::vector<std::uint32_t> chart_of_triangle;  ///< kInvalidIndex: untextured
  std::vector<std::array<Eigen::Vector2f, 3>> source_pixels;  ///< per triangle, in its source image
};

/// A triangle is textured from its own view; where that one's camera does not see all of it (seams at the frame of an
/// image), from the first of its corners' views that does. Charts whose rectangle would exceed `largest_px` are cut
/// into pieces. Numbered by their first triangle.
Charts make_charts(const Mesh& mesh, std::span<const ViewSource> sources, int padding_px, int largest_px,
                   Context& context);

}  // namespace lapseam
