#pragma once

// One view's turn at the growing model: its image, where in it something is to be done, and what was found at its
// samples and cells so far.

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>

#include "lapseam/image.h"
#include "sew/grown_model.h"
#include "sew/view_canvas.h"

namespace lapseam {

class ModelInView {
 public:
  // bits of `sample`
  static constexpr std::uint8_t kCovered = 1;   ///< by the model
  static constexpr std::uint8_t kNear = 2;      ///< the model's border
  static constexpr std::uint8_t kEmitted = 4;   ///< in a triangle that the view added
  static constexpr std::uint8_t kShadowed = 8;  ///< the model is near, but views disagree about where
  // bits of `cell`
  static constexpr std::uint8_t kWall = 1;     ///< the model's border passes through
  static constexpr std::uint8_t kBlocked = 2;  ///< nothing may be made here

  /// A sample this many tolerances from the model is still no new surface, but one that views disagree about.
  static constexpr float kShadowFactor = 2;
  static constexpr int kTile_px = 8;

  /// `wanted` has one value per pixel, 0 for samples that the view is not to add; both must outlive this. All of the
  /// image is in focus, or nothing.
  ModelInView(const GrownModel& model, std::uint32_t index, const Image<std::uint8_t>& wanted, int shift,
              bool is_all_in_focus);

  const GrownModel& model;
  const Patch& patch;
  const Image<std::uint8_t>& wanted;
  const ViewCanvas canvas;
  const int width, height;
  Image<std::uint8_t> sample, cell;

  // ---- where to work: tiles of kTile_px
  void focus_on_nothing();
  void focus_around(float u, float v, float radius_px);
  /// Tiles with wanted samples, and those around them. False: there are none.
  bool focus_on_wanted();
  bool is_focused(int u, int v) const { return focus_.at(u / kTile_px, v / kTile_px) != 0; }
  /// visit(u, v) for every pixel in focus, row by row.
  template <typename Visit>
  void for_each_in_focus(const Visit& visit) const {
    for_each_in_focus(0, height, visit);
  }
  /// Of rows [begin, end).
  template <typename Visit>
  void for_each_in_focus(int begin, int end, const Visit& visit) const {
    for (int v = begin; v < end; ++v)
      for (int x = 0; x < focus_.width; ++x) {
        if (!focus_.at(x, v / kTile_px)) continue;
        for (int u = x * kTile_px; u < std::min(width, (x + 1) * kTile_px); ++u) visit(u, v);
      }
  }
  bool is_in_focus(float u_low, float u_high, float v_low, float v_high) const;

  // ---- the view's own triangles
  /// Whether the view adds this sample.
  bool is_usable(int u, int v) const {
    if (!is_focused(u, v)) return false;
    const std::size_t pixel = canvas.pixel(u, v);
    return wanted.pixels[pixel] != 0 && patch.confidence.pixels[pixel] > 0 && !(sample.at(u, v) & (kShadowed | kNear));
  }
  bool is_cell_in(int u, int v) const { return u >= 0 && v >= 0 && u < width - 1 && v < height - 1; }
  std::uint8_t grid_cell(int u, int v) const { return patch.grid.cells[canvas.pixel(u, v)]; }
  bool exists(int u, int v, int slot) const { return grid_cell(u, v) & (PatchGrid::kExists << slot); }

  /// Corners of a triangle as (u, v), counter-clockwise seen from the sensor.
  std::array<Eigen::Vector2i, 3> corners_of(int u, int v, int slot) const {
    std::array<Eigen::Vector2i, 3> c;
    const Eigen::Vector2i p00(u, v), p10(u + 1, v), p01(u, v + 1), p11(u + 1, v + 1);
    if (grid_cell(u, v) & PatchGrid::kAntiDiagonal)
      c = slot == 0 ? std::array{p00, p01, p10} : std::array{p10, p01, p11};
    else
      c = slot == 0 ? std::array{p00, p01, p11} : std::array{p00, p11, p10};
    if (patch.grid.is_mirrored) std::swap(c[1], c[2]);
    return c;
  }

  // ---- geometry in the image
  bool is_front(const Eigen::Vector3f& position, const CoarseNormal& normal) const {
    return canvas.ray_to(position).dot(normal.cast<float>()) < 0;
  }
  /// Positive where a, b, c turn left.
  float turn(const CanvasPoint& a, const CanvasPoint& b, const CanvasPoint& c) const {
    const float area = (b.u - a.u) * (c.v - a.v) - (b.v - a.v) * (c.u - a.u);
    return patch.grid.is_mirrored ? area : -area;  // rows run down
  }
  /// Distance between neighbouring rays at a point.
  float pixel_size_m(const CanvasPoint& at) const;
  /// Straight edges are curved in the images of sensors that are no plain pinhole: by up to this much, in pixels.
  float bulge_of(float extent_px) const;
  /// Whether a ray from the sensor meets a triangle given in the sensor's frame.
  static bool passes_through(const std::array<Eigen::Vector3f, 3>& corner, const Eigen::Vector3f& ray);

  // ---- depth
  /// Whether something between two ranges may be what the view measured in a rectangle of pixels.
  bool is_at_measured_depth(int u0, int u1, int v0, int v1, float low_r, float high_r, float error_m) const;
  /// Whether the view measured a surface here, without a step, and about at this range.
  bool is_surface(float u, float v, float range, float error_m) const;

 private:
  // Ranges in blocks of the image, widened by the largest tolerance there: most of what a view could see of the model
  // is hidden from it, and need not be drawn.
  struct DepthBlock {
    float low = 3e38f, high = 0;
  };
  static constexpr int kDepthBlock_px = 8;

  void find_depth_blocks();
  bool is_in_footprint(float u, float v, float range, float error_m) const;

  Image<std::uint8_t> focus_;  // tiles
  Image<DepthBlock> depth_;
  float pixel_angle_ = 0;
};

}  // namespace lapseam
