#pragma once

// How different two images of one size are, over the pixels of a mask.

#include "lapseam/image.h"

namespace lapseam {

struct ImageDifference {
  std::uint64_t pixels = 0;  ///< of the mask
  double gain = 1;           ///< that brings the picture closest to the photograph in the sense of least squares
  double psnr_db = 0;        ///< after the gain; infinite when equal, NaN without pixels
  double ssim = 0;           ///< of the luma, after the gain; NaN when no pixel's window lies in the mask
};

/// mask: pixels that are not 0 count. SSIM as in Z. Wang et al., Image Quality Assessment: From Error Visibility to
/// Structural Similarity, 2004: Gaussian windows of 11 × 11, σ = 1.5 pixels.
ImageDifference compare_images(const ColorImage& picture, const ColorImage& photograph,
                               const Image<std::uint8_t>& mask);

}  // namespace lapseam
