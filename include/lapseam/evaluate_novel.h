#pragma once

// How good do the colours of a model look? Pictures of it are held against real images, best against such as it was not
// made from, and the edges of its texture against each other.

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "lapseam/mesh.h"
#include "lapseam/view.h"

namespace lapseam {

class Context;

/// One picture of the model against the image that a camera took from there. Only pixels that the model covers wholly,
/// with front faces, count.
struct NovelViewFigures {
  std::string view;
  std::uint64_t pixels = 0;  ///< that count
  double covered_share = 0;  ///< of all pixels of the image
  double gain = 1;           ///< the picture was multiplied by this: least squares, one factor for all channels
  double psnr_db = 0;        ///< after that; infinite when the two are equal, NaN when nothing is covered
  double ssim = 0;  ///< of the luma; mean over the pixels whose 11 × 11 surroundings are covered; NaN: none is
};

/// Colour differences at edges where the texture is cut: on both sides of an edge that two triangles share, sampled
/// once a texel along it. A difference is the root mean square of the three channels', in levels of 255. Between two
/// places of pages; and, apart from these, where one side has the colours of its vertices.
struct ColorStepFigures {
  std::uint64_t samples = 0;
  std::uint64_t edges = 0;
  double length_m = 0;  ///< of the edges
  double median = 0, p95 = 0;
  std::uint64_t vertex_color_samples = 0;
  double vertex_color_median = 0, vertex_color_p95 = 0;
};

struct NovelEvaluation {
  std::vector<NovelViewFigures> views;
  double mean_psnr_db = 0, mean_ssim = 0, mean_covered_share = 0;  ///< over views that are covered at all
  double lowest_psnr_db = 0, highest_psnr_db = 0;
  ColorStepFigures steps;  ///< no samples when the model has no texture
};

/// The model has texture pages or vertex colours. views: those with a colour image are compared, each loaded once.
/// The same figures for any number of threads. Throws InvalidInput when the model has no colours or no view has an
/// image, and what load_color throws.
NovelEvaluation evaluate_novel(const Mesh& model, std::span<const ViewSource> views, Context& context);

/// The steps alone.
ColorStepFigures measure_color_steps(const Mesh& model, Context& context);

/// A table for people, and one JSON object with keys as in docs/evaluation.md.
std::string to_text(const NovelEvaluation& evaluation);
std::string to_json(const NovelEvaluation& evaluation);

}  // namespace lapseam
