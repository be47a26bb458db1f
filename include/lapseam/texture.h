#pragma once

// Colour for the integrated mesh, from the images of its views. After Sun et al. 2000, §2.4, and beyond:
// docs/textures.md.

#include <cstdint>
#include <span>
#include <string>

#include "lapseam/mesh.h"
#include "lapseam/view.h"

namespace lapseam {

class Context;

struct TextureOptions {
  int page_size = 4096;            ///< largest width and height of a page, pixels; at least 64
  std::uint64_t memory_bytes = 0;  ///< most that all pages may take, three bytes a pixel; 0: no limit
  double texel_m = 0;              ///< no region gets finer pixels than this, on the mean; 0: those of its image
  bool equalize = true;            ///< one exposure, white balance and vignetting for all images
  bool level = true;               ///< take the steps out of the borders between images
  bool choose = true;              ///< let better images take over from those that triangles were measured with
  /// How far views are apart from each other: images are aligned where that brings them together, and colour near jumps
  /// of depth is not trusted within what is left.
  double registration_error_m = 0;
};

struct TextureReport {
  std::uint64_t charts = 0;
  std::uint64_t pages = 0;
  std::uint64_t page_pixels = 0;
  std::uint64_t used_pixels = 0;    ///< whose centres lie in a triangle
  std::uint64_t chart_pixels = 0;   ///< of the charts' blocks: used ones and the padding that filtering reads
  std::uint64_t fringe_pixels = 0;  ///< of the used ones, those that were replaced for lying near a jump of depth
  std::uint64_t vertex_colored_triangles = 0;  ///< that have the colours of their vertices instead of a place on a page
  std::uint64_t unseen_triangles = 0;          ///< that no image shows: they have vertex colours of what is around them
  std::uint64_t retaken_triangles = 0;         ///< that show another image than the one they were measured with
  double scale = 1;                            ///< by which the memory limit made all images smaller
  std::uint64_t observations = 0;              ///< that exposures were estimated from
  double lowest_gain = 1, highest_gain = 1;    ///< of the views, mean of the channels
  double color_residual_before = 0, color_residual_after = 0;  ///< median, as a share of the colour
  /// How far images are apart on the surface, pixels, before and after they are aligned (median of their deviations).
  double displacement_before_px = 0, displacement_after_px = 0;
  std::uint64_t bent_images = 0;  ///< that had to be bent for it, beside what their cameras were moved
  /// Colour steps at all borders between images, between charts and within, levels: equalized alone, and with what
  /// levelling has left, before pages are coded. Without levelling both are the same.
  double step_before = 0, step_before_p95 = 0;
  double step_after = 0, step_after_p95 = 0;
  /// Of these, those within charts, which nothing in the model shows.
  double inner_step_before = 0, inner_step_before_p95 = 0;
  double inner_step_after = 0, inner_step_after_p95 = 0;

  /// Of the pages' pixels, those that triangles show.
  double fill() const { return page_pixels > 0 ? double(used_pixels) / double(page_pixels) : 0; }
};

/// Gives each triangle coordinates in one of the images that show it wholly and unoccluded, and packs what is used of
/// all images into pages: pixels are copied, not resampled, unless a limit, a large triangle under perspective, or a
/// place in the chart of another image, which saves the padding between the two, demands it. Charts of triangles as
/// small as pixels that would fill little of the blocks they own get vertex colours instead. Triangles that no image
/// shows have no page either, and are marked as unseen; their vertex colours continue those around them. `sources[i]`
/// is view i of the mesh's provenance; views without colour are no candidates, those with several images are one for
/// each. The mesh's provenance stays as it is; without it, any view may show any triangle. Images are decoded at most
/// five times, one per thread at a time; memory otherwise: five bytes for each pixel of the pages, and about 100 bytes
/// a triangle. The same bytes for any number of threads. Throws InvalidInput when a limit cannot be met, and what
/// load_color throws.
TextureReport texture(Mesh& mesh, std::span<const ViewSource> sources, const TextureOptions& options, Context& context);

/// As JSON text.
std::string to_json(const TextureReport& report);

/// The colour that the texture has at each vertex (mean over its triangles). Vertices of untextured triangles alone
/// keep the mesh's colours; where it has none, they take those around them, mid grey where nothing is around.
std::vector<Rgb8> vertex_colors(const Mesh& mesh, Context& context);

/// Gives the mesh these colours.
void color_vertices(Mesh& mesh, Context& context);

}  // namespace lapseam
