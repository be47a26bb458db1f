#pragma once

// Which images show a cell of triangles, and how well.

#include <span>
#include <vector>

#include "lapseam/mesh.h"
#include "texture/cells.h"
#include "texture/color_camera.h"
#include "texture/color_response.h"
#include "texture/depth_image.h"

namespace lapseam {

class Context;

/// Of one cell: with fewer, neighbouring cells would lack a common image.
inline constexpr std::size_t kMostCandidates = 64;

struct Candidate {
  std::uint32_t view = kInvalidIndex;
  float cost = 0;  ///< 0 is best; the logarithm of how many times coarser it shows the cell, and penalties
  Rgb8 color{};    ///< of the middle of the cell's first triangle in it, equalized
};

struct Candidates {
  std::vector<Candidate> all;        ///< cell after cell, by view
  std::vector<std::uint64_t> begin;  ///< of each cell in it, and the end of the last
  std::vector<float> density_px;     ///< of each cell in its best image, pixels per metre; 0: no image shows it
  std::vector<float> area_px;        ///< there
  std::vector<float> hidden;      ///< of each cell in the image that shows the most of it, the share that is not shown
  std::vector<float> largest_px;  ///< as density_px, of each cell's largest triangle by itself

  std::span<const Candidate> of(std::size_t cell) const {
    return {all.data() + begin[cell], all.data() + begin[cell + 1]};
  }
};

/// An image is a candidate when all of the cell lies in it, faces it, and nothing is before it, but for a few
/// hundredths of its area, which noise turns away. `blur[view]` is added to the costs of a view. The `kMostCandidates`
/// best are kept.
Candidates find_candidates(const Mesh& mesh, const Cells& cells, const ColorCameras& cameras,
                           std::span<const DepthImage> depths, std::span<const float> blur, Context& context);

/// Sets the candidates' colours, and adds to the costs of those that are overexposed. Decodes each image once, one per
/// thread at a time.
void sample_colors(const Mesh& mesh, const Cells& cells, std::span<const ViewSource> sources,
                   const ColorCameras& cameras, std::span<const ColorResponse> responses, Candidates& candidates,
                   Context& context);

/// As a camera sees a triangle; false when it is no candidate. fringe: share of it that lies near a jump of depth;
/// hidden: of these, what lies on the nearer side of the jump.
struct TriangleSight {
  float density_px = 0;
  float fringe = 0;
  float hidden = 0;
};
bool look_at_triangle(const std::array<Eigen::Vector3f, 3>& corners_m, const ColorCamera& camera,
                      const DepthImage& depth, TriangleSight& sight);

}  // namespace lapseam
