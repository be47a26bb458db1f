#pragma once

// The model as one view sees it: in its image plane nothing that the view can see overlaps, and crossings cannot hide.

#include <Eigen/Geometry>
#include <cstdint>
#include <vector>

#include "lapseam/image.h"
#include "lapseam/overlap.h"
#include "lapseam/patch.h"

namespace lapseam {

/// A world point as the view sees it: continuous pixel coordinates and range.
struct CanvasPoint {
  float u = 0, v = 0, r = 0;
  bool is_in = false;  ///< projects into the image
};

/// Where a surface that is seen at a pixel lies relative to what the view measured there.
enum class Agreement : std::uint8_t { kNothingThere, kAgrees, kDiffers };

/// Projection into one view, and comparison with its samples. Image columns may be turned by `shift` pixels, so that
/// the cut of a panorama lies elsewhere.
class ViewCanvas {
 public:
  ViewCanvas(const Patch& patch, const Eigen::Vector3d& origin_m, const OverlapOptions& options, int shift);

  const Patch& patch() const { return patch_; }
  int width() const { return width_; }
  int height() const { return height_; }
  /// Index into the patch's images.
  std::size_t pixel(int u, int v) const {
    const int turned = u + shift_ < width_ ? u + shift_ : u + shift_ - width_;
    return std::size_t(v) * std::size_t(width_) + std::size_t(turned);
  }
  bool has_sample(int u, int v) const { return patch_.confidence.pixels[pixel(u, v)] > 0; }

  CanvasPoint project(const Eigen::Vector3f& position_m) const;
  /// Position of a sample, relative to the origin.
  Eigen::Vector3f position(std::size_t pixel) const { return T_model_view_ * patch_.point_in_view(pixel); }
  /// Direction from the sensor to a point, any length.
  Eigen::Vector3f ray_to(const Eigen::Vector3f& position_m) const;
  bool is_central() const { return patch_.rays->origins.empty(); }
  bool is_pinhole() const { return pinhole_ != nullptr; }
  /// Of the ray through a point between samples, in the view's frame; for central sensors.
  Eigen::Vector3f direction(float u, float v) const;
  const Eigen::Isometry3f& T_view_model() const { return T_view_model_; }
  const Eigen::Isometry3f& T_model_view() const { return T_model_view_; }

  /// Largest difference along the ray at which a surface with this expected error along its normal is still the one
  /// that the view measured in this pixel.
  float tolerance(std::size_t pixel, float error_m) const;
  /// No tolerance at samples up to this range is larger.
  float largest_tolerance(float range_m, float error_m) const;
  Agreement compare(const CanvasPoint& point, float error_m) const;
  /// Steps along u and v of the sample spacing, for slack between a sample and a point up to half a pixel off.
  float slope_slack(int u, int v) const;

 private:
  const Patch& patch_;
  OverlapOptions options_;
  int shift_, width_, height_;
  const PinholeSensor* pinhole_ = nullptr;  // without distortion: projected in float
  Eigen::Isometry3d T_view_model_d_;
  Eigen::Isometry3f T_view_model_, T_model_view_;
  Eigen::Vector3f sensor_position_m_, axis_;
};

}  // namespace lapseam
