#pragma once

// Colour for the integrated mesh, from the images its triangles were measured with. After Sun et al. 2000, §2.4.

#include <cstdint>
#include <span>

#include "lapseam/mesh.h"
#include "lapseam/view.h"

namespace lapseam {

class Context;

struct AtlasOptions {
  int page_size = 4096;  ///< largest width and height of a page, pixels; at least 64
  int padding_px = 2;    ///< source pixels kept around each chart, so that filtering finds the right neighbours
};

struct AtlasReport {
  std::uint64_t charts = 0;
  std::uint64_t pages = 0;
  std::uint64_t page_pixels = 0;
  std::uint64_t chart_pixels = 0;          ///< pixels of chart rectangles, padding included
  std::uint64_t untextured_triangles = 0;  ///< their view has no colour, or its camera does not see them
};

/// Gives each triangle coordinates in the image of its view (triangle_view) by projection (a seam triangle that this
/// view's camera sees only in part gets another of its corners' views), and packs the used rectangles of all images
/// into pages. A chart is a set of connected triangles of one view. Source pixels are copied, not resampled. Images are
/// decoded in parallel, at most one per thread at a time. `sources[i]` is view i of the mesh's provenance.
/// Deterministic. Throws what load_color throws.
AtlasReport build_atlas(Mesh& mesh, std::span<const ViewSource> sources, const AtlasOptions& options, Context& context);

/// Gives each vertex the colour of its own view (bilinear); mid grey where that view has no colour or does not see it.
void color_vertices(Mesh& mesh, std::span<const ViewSource> sources, Context& context);

}  // namespace lapseam
