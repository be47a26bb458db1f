#pragma once

// One exposure, white balance and vignetting for all images.

#include <cstdint>
#include <span>
#include <vector>

#include "lapseam/mesh.h"
#include "texture/color_camera.h"
#include "texture/color_response.h"
#include "texture/depth_image.h"

namespace lapseam {

class Context;

struct Equalization {
  std::vector<ColorResponse> of_view;
  std::vector<float> blur;  ///< of each view: by how much it is less sharp than others of the same surface; 0 or more
  std::uint64_t observations = 0;
  /// Median of |logarithm of a colour − that of all views' mean|, before and after.
  double residual_before = 0, residual_after = 0;
};

/// From spots of the surface that several views see: logarithms of their colours are explained by the spot's, the
/// view's gain, and the vignetting of its camera (views of one sensor id share it), each channel by itself; robustly
/// (iteratively reweighted, Cauchy), so that highlights and misplaced views count little. The gains' median is none:
/// among views that are connected by what they see, colours are as bright as those of the middle view. A view that
/// shares nothing with others is left as it is. Decodes each image once, one per thread at a time;
/// memory otherwise: the square of the number of views.
Equalization equalize(const Mesh& mesh, std::span<const ViewSource> sources, const ColorCameras& cameras,
                      std::span<const DepthImage> depths, Context& context);

}  // namespace lapseam
