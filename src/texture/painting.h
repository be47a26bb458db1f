#pragma once

// From images to pages: which pixels show which image, their first colours, and their last.

#include <span>
#include <vector>

#include "lapseam/mesh.h"
#include "texture/charts.h"
#include "texture/color_response.h"
#include "texture/depth_image.h"

namespace lapseam {

/// Of each pixel of a page: which of its chart's parts it belongs to, counted from 1 (0: outside of all charts, or not
/// yet known), and marks.
using PartMap = Image<std::uint16_t>;
inline constexpr std::uint16_t kPartBits = 0x1fff;
inline constexpr std::uint16_t kForeignBit = 0x2000;  ///< of those near a jump: the colour is that of what is behind
inline constexpr std::uint16_t kPaddingBit = 0x4000;  ///< its centre lies in no triangle
inline constexpr std::uint16_t kNearStepBit =
    0x8000;  ///< near a jump of depth: the colour may be that of the other side
/// Both: it lies in a triangle, and the image shows something else there.
inline constexpr std::uint16_t kHiddenBits = kPaddingBit | kNearStepBit;
inline constexpr std::size_t kMostParts = kPartBits - 1;

/// Lies in a triangle.
inline bool is_used(std::uint16_t pixel) {
  return pixel != 0 && ((pixel & kPaddingBit) == 0 || (pixel & kHiddenBits) == kHiddenBits);
}
/// Has a colour of its own.
inline bool is_shown(std::uint16_t pixel) { return pixel != 0 && (pixel & kPaddingBit) == 0; }
inline std::size_t part_of(std::uint16_t pixel) { return std::size_t(pixel & kPartBits) - 1; }

/// An image, and what turns its colours into those of the model.
struct Photograph {
  const ColorImage& image;
  const ColorCamera& camera;
  const ColorResponse& response;
  const DepthImage& depth;

  /// Means over `size_px` pixels each way, or bilinear where that is 1.
  Eigen::Vector3f color_at(const Eigen::Vector2f& pixel, float size_px) const;
};

/// Marks the pixels of one chart. Where parts overlap by a hair, its own image has the last word; slivers, which may
/// lie over anything, have the first.
void mark_parts(const Charts& charts, const Chart& chart, PartMap& map);

/// Colours a triangle's pixels: those of the image as they are, times its response. Resampled where the triangle says
/// so. Marks those near a jump of depth, and those that something else lies before.
void paint_triangle(const Mesh& mesh, const Charts& charts, std::uint32_t triangle, const Photograph& photograph,
                    PartMap& map, ColorImage& page);

/// Gives pixels whose colours are foreign that of the nearest clean one, then those near a jump of depth the colour of
/// the nearest clean one of the chart, where there is one within `fringe_px` of the image: beyond the fringe of one
/// jump there are others all around, and nothing is better than what is there. These are smoothed among each other.
/// Then those in no triangle, and those that are hidden, that of the nearest other one, whose part they join. The
/// number of pixels in triangles whose colours were replaced.
std::uint64_t fill_unused(const Chart& chart, int fringe_px, PartMap& map, ColorImage& page);

/// What is added to a chart's pixels; see level.h.
using Correction = Image<Eigen::Vector3f>;

/// Adds the correction, and rounds.
void correct_chart(const Chart& chart, const Correction& correction, ColorImage& page);

}  // namespace lapseam
