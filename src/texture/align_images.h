#pragma once

// Images bent by some pixels until they agree on the surface.

#include <cstdint>
#include <span>
#include <vector>

#include "lapseam/mesh.h"
#include "texture/color_camera.h"
#include "texture/color_response.h"
#include "texture/depth_image.h"

namespace lapseam {

class Context;

struct Alignment {
  /// Of each image: how far it is from what all show together, as a deviation; 0: not known.
  std::vector<float> displacement_px;
  double before_px = 0, after_px = 0;  ///< their medians
  bool is_aligned = false;             ///< cameras have changed
  /// Of each image, if they are aligned: the logarithm of its contrast over that of the mean of all; blurred ones have
  /// less. NaN: not known.
  std::vector<float> sharpness;
  std::uint64_t bent = 0;  ///< images
};

/// Poses that are some millimetres off displace images by some pixels on the surface, cameras that are not quite known
/// displace parts of them. In turn each image is moved (six degrees of freedom), then bent (a coarse lattice), towards
/// the mean of what all images show at the same spots of the surface, where that makes them agree better. error_m: what
/// is expected; where that is none, nothing is done. Panoramas and images with parallel rays stay as they are. Images
/// are decoded once, one per thread at a time; two bytes for each value of the depth images, and 32 for each
/// observation (a spot in an image, some millions) are kept meanwhile.
Alignment align_images(const Mesh& mesh, std::span<const ViewSource> sources, ColorCameras& cameras,
                       std::span<const DepthImage> depths, std::span<const ColorResponse> responses, double error_m,
                       Context& context);

}  // namespace lapseam
