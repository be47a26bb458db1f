#pragma once

// Range images as pyramids of surfels: oriented points that each stand for a block of samples.

#include <Eigen/Geometry>
#include <cstdint>
#include <functional>
#include <vector>

#include "lapseam/noise.h"
#include "lapseam/view.h"

namespace lapseam {

/// A block of samples of one smooth surface, in the frame of its view.
struct Surfel {
  Eigen::Vector3f point = Eigen::Vector3f::Zero();
  Eigen::Vector3f normal = Eigen::Vector3f::Zero();  ///< unit, towards the sensor; zero: no smooth surface here
  float sigma_m = 0;                                 ///< standard deviation of the point along the normal
  float tilt_rad = 0;                                ///< standard deviation of the normal about either tangent
  bool is_usable() const { return normal.x() != 0 || normal.y() != 0 || normal.z() != 0; }
};

/// One level. Surfel (u, v) stands for the samples around factor · (u + 1/2) − 1/2, and so for v.
struct SurfelImage {
  int factor = 1;
  int width = 0, height = 0;
  bool wraps = false;
  double spacing_m = 0;  ///< between neighbouring surfels, median
  std::vector<Surfel> surfels;
  std::vector<std::uint32_t> usable;  ///< indices of those with a normal
  // Where there is colour: logarithm of the brightness, and how it changes along the surface (view frame). NaN: none.
  std::vector<float> brightness;
  std::vector<Eigen::Vector3f> brightness_gradient_per_m;
  float brightness_sigma = 0;  ///< what rounding and noise of the colours leave, roughly

  const Surfel& at(int u, int v) const { return surfels[std::size_t(v) * std::size_t(width) + std::size_t(u)]; }
  /// Index of the surfel at an image position in samples; −1 outside.
  std::int64_t index_at(double u_px, double v_px) const;
};

/// Finest first. The finest level has the most surfels that do not exceed the limit; the coarsest about a thousand.
struct SurfelPyramid {
  std::vector<SurfelImage> levels;
  Eigen::Vector3d center_in_view = Eigen::Vector3d::Zero();  ///< mean of the surfels
  Eigen::AlignedBox3d box_in_view;
  double radius_m = 0;  ///< of the middle nine tenths of the surfels about their mean
};

/// Brightness (natural logarithm, any offset) of a point in the view's frame whose surroundings of the given size are
/// seen as one; NaN where the colour camera does not see it. Empty: the view has no colour.
using BrightnessAt = std::function<float(const Eigen::Vector3f& point_in_view, float size_m)>;

/// Blocks are halved again and again: means in the quantity that planes make affine (inverse range for central
/// sensors). A block over a step has no surfel, nor has one on a crease that neither 3 × 5 surfels nor three each way
/// take for a smooth surface: shallow creases may pass. Where noise is symmetric in the range, means of inverse ranges
/// are corrected. Deterministic; about 30 ns per sample.
SurfelPyramid make_surfels(const View& view, const NoiseModel& noise, std::size_t most_surfels,
                           const BrightnessAt& brightness);

}  // namespace lapseam
