#pragma once

// Where each triangle lies before sheets of triangles are cut into charts.

#include <span>
#include <vector>

#include "lapseam/mesh.h"
#include "texture/blocks.h"
#include "texture/color_camera.h"

namespace lapseam {

class Context;

struct Layout {
  std::vector<std::uint32_t> sheet;  ///< of each triangle, kInvalidIndex: no image shows it
  std::vector<std::uint32_t> frame;  ///< of each sheet, the view whose pixels its own are, where not resampled
  std::vector<Corners> pixels;       ///< of each triangle in its sheet
  /// The triangle shows another image than it is laid out in, or one that is no affine copy of it, to a quarter pixel.
  std::vector<std::uint8_t> is_resampled;
};

/// The triangles of each sheet.
std::vector<std::vector<std::uint32_t>> triangles_of_sheets(std::span<const std::uint32_t> sheet, std::size_t sheets);

/// Triangles of one frame whose blocks meet are a sheet, laid out as that image has them, or would have them if it were
/// larger. view_of_triangle: whose image it shows, kInvalidIndex for none; frame_of_triangle: as whose image it is laid
/// out. Sheets are numbered by first triangle.
Layout project_frames(const Mesh& mesh, const ColorCameras& cameras, std::span<const std::uint32_t> view_of_triangle,
                      std::span<const std::uint32_t> frame_of_triangle, Context& context);

/// Corners in the image, brought to one side of a panorama's seam. False where the camera cannot say.
bool project_corners(const Mesh& mesh, std::uint32_t triangle, const ColorCamera& camera, Corners& p);

/// The same; false too where it does not know the middles of sides, by which is_copy says whether the image is affine.
bool project_triangle(const Mesh& mesh, std::uint32_t triangle, const ColorCamera& camera, Corners& p, bool& is_copy);

}  // namespace lapseam
