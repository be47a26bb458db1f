#pragma once

// A view on its way into the model: its samples, its implicit triangle mesh, and how well each sample was measured.
// The mesh of a view is never stored as indices: one byte per grid cell says which triangles exist; corners
// and neighbours follow from the grid.

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "lapseam/context.h"
#include "lapseam/image.h"
#include "lapseam/mesh.h"
#include "lapseam/noise.h"
#include "lapseam/view.h"

namespace lapseam {

/// Where a sample lies for a given range: origin + r · direction, in the sensor frame. One table serves all views of a
/// sensor. `origins` is empty when all rays start at the sensor frame's origin.
struct RayTable {
  int width = 0, height = 0;
  Pixels<Eigen::Vector3f> directions;  ///< d(point)/dr; not unit length for a pinhole, whose r is z
  Pixels<Eigen::Vector3f> origins;

  Eigen::Vector3f point(std::size_t pixel, float r) const {
    const Eigen::Vector3f p = directions[pixel] * r;
    return origins.empty() ? p : Eigen::Vector3f(p + origins[pixel]);
  }
};
std::shared_ptr<RayTable> make_ray_table(const Sensor& sensor, Context& context);

/// The triangles of one view. Cell (u, v) lies between samples (u, v), (u+1, v), (u, v+1), (u+1, v+1); the last column
/// is used only where the image wraps, the last row never. A cell holds up to two triangles, slots 0 and 1:
///   main diagonal (u,v)–(u+1,v+1): slot 0 lower left, slot 1 upper right
///   anti diagonal (u+1,v)–(u,v+1): slot 0 upper left, slot 1 lower right
/// Both splits and the four single triangles of the paper (§2.1) are the six cells with at least one triangle.
struct PatchGrid {
  static constexpr std::uint8_t kAntiDiagonal = 1;  ///< bit: which diagonal
  static constexpr std::uint8_t kExists = 2;        ///< bit of slot 0; slot 1 is the next

  int width = 0, height = 0;  ///< samples
  bool wraps = false;
  bool is_mirrored = false;    ///< u grows to the left of the viewer: winding is turned over
  Pixels<std::uint8_t> cells;  ///< width·height

  bool exists(std::size_t cell, int slot) const { return cells[cell] & (kExists << slot); }

  /// Pixel indices of a triangle's corners, counter-clockwise seen from the sensor.
  std::array<std::uint32_t, 3> corners(std::size_t cell, int slot) const;
  std::size_t triangle_count() const;
};

/// Logarithmic steps, fifteen an octave, of the inverse of an expected error, in 1/m: 1 is 10 m, 255 some 0.1 mm.
/// Views that are as good as each other within a step do not take turns.
std::uint8_t confidence_code(float per_m);
float confidence_per_m(std::uint8_t code);

/// Everything known of one view while the model grows.
struct Patch {
  View view;         ///< range already smoothed
  NoiseModel noise;  ///< of a single sample, before smoothing
  std::shared_ptr<const RayTable> rays;
  PatchGrid grid;
  Image<std::uint8_t> confidence;  ///< per sample: confidence_code; 0 where there is no triangle
  Image<std::uint8_t> incidence;   ///< per sample; cosine between normal and ray · 255, from range smoothed on purpose

  Eigen::Vector3f point_in_view(std::size_t pixel) const { return rays->point(pixel, view.range.pixels[pixel]); }
  /// Of a single measurement, along the normal of the surface, which is at an angle with this cosine to the ray.
  float sigma_across(std::size_t pixel, float cosine) const {
    const double factor = view.intensity.pixels.empty() ? 1 : noise.intensity_factor(view.intensity.pixels[pixel]);
    return float(noise.sigma_across(double(view.range.pixels[pixel]), double(cosine), factor));
  }
};

/// Of a single measurement, along the normal of the surface at the sample, metres.
float expected_error_m(const Patch& patch, std::size_t pixel);
/// The same of each vertex, by its provenance, which counts the patches.
std::vector<float> expected_errors(const Mesh& mesh, std::span<const Patch> patches);

}  // namespace lapseam
