#pragma once

// From images to pages: which pixels charts use, their first colours, and their last.

#include <span>
#include <vector>

#include "lapseam/mesh.h"
#include "texture/charts.h"
#include "texture/depth_image.h"
#include "texture/equalize.h"

namespace lapseam {

/// Of each pixel of a page.
enum PixelUse : std::uint8_t {
  kPadding = 0,
  kUsed = 1,    ///< its centre lies in a triangle
  kFringed = 2  ///< so, but near a jump of depth, where the chart has better pixels near by
};
using UseMask = Image<std::uint8_t>;

/// Marks the pixels of one chart. Those near a jump are fringed where others of the chart are not far.
void mark_used(const Charts& charts, const Chart& chart, const DepthImage* depth, UseMask& page);

/// Copies the blocks of one chart from its image; smaller charts average over the image's pixels. Triangles that are
/// no affine copies are resampled, bilinearly, with a pixel around them.
void copy_blocks(const Mesh& mesh, const Charts& charts, const Chart& chart, const ColorImage& image,
                 const ColorCamera& camera, ColorImage& page);

/// Gives all pixels of a chart that are not used, or fringed, the colour of the nearest used one.
void fill_unused(const Chart& chart, const UseMask& use, ColorImage& page);

/// What is added to a chart's pixels; see level.h.
using Correction = Image<Eigen::Vector3f>;

/// Multiplies by the view's response, adds the correction (empty: none), and rounds once.
void correct_chart(const Chart& chart, const ColorResponse& response, const ColorCamera& camera,
                   const Correction& correction, ColorImage& page);

}  // namespace lapseam
