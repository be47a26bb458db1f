#pragma once

// How far a measured range may be off, along its ray.

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <span>

#include "lapseam/image.h"
#include "lapseam/sensor.h"

namespace lapseam {

class Context;
struct View;

/// Standard deviation of the range along the ray, metres, of a surface that faces the sensor: sigma(r) =
/// max(floor, s0 + s1·r + s2·r²). At an angle θ between ray and normal comes r · tan θ · pointing_rad in square: what
/// the direction of a ray is off by, and what a pixel or beam spreads over, moves the range by as much. correlation:
/// how many neighbouring samples have one error between them, at least 1; where ranges are rounded to steps larger than
/// their noise, those on one step are off alike, and a mean of them by as much as each.
struct NoiseModel {
  double s0_m = 0;
  double s1 = 0;
  double s2_per_m = 0;
  double floor_m = 0;
  double correlation = 1;
  double pointing_rad = 0;
  /// Where views have intensities: what the facing sigma is times (intensity_reference / intensity)^intensity_power, by
  /// no more than kLargestFactor (Wujanz et al. 2017, Intensity-based stochastic models for terrestrial laser
  /// scanners).
  double intensity_power = 0, intensity_reference = 128;
  static constexpr double kLargestFactor = 8;
  /// The noise is symmetric in the range (times of flight), not in its inverse (disparities): means of inverse ranges
  /// are over that of the surface by its relative variance.
  bool is_symmetric_in_range = false;

  double sigma(double range_m) const {
    const double s = s0_m + range_m * (s1 + range_m * s2_per_m);
    return s > floor_m ? s : floor_m;
  }
  /// Of a returned intensity from 0 to 255.
  double intensity_factor(std::uint8_t intensity) const {
    if (intensity_power == 0) return 1;
    const double factor = std::pow(intensity_reference / std::max(1.0, double(intensity)), intensity_power);
    return std::clamp(factor, 1 / kLargestFactor, kLargestFactor);
  }
  /// Along the normal, where it and the ray are at an angle with this cosine.
  double sigma_across(double range_m, double cosine, double factor = 1) const {
    const double facing = cosine * factor * sigma(range_m);
    if (pointing_rad == 0) return facing;
    return std::sqrt(facing * facing + (1 - cosine * cosine) * squared(pointing_rad * range_m));
  }
  /// Along the ray there, which must not lie in the surface.
  double sigma(double range_m, double cosine, double factor = 1) const {
    return sigma_across(range_m, cosine, factor) / cosine;
  }
  /// No smaller than any sigma_across at this range.
  double largest_across(double range_m) const {
    return (intensity_power == 0 ? 1 : kLargestFactor) * sigma(range_m) + pointing_rad * range_m;
  }
  /// Of samples that are off by so many times as much.
  NoiseModel scaled(double factor) const {
    NoiseModel out = *this;
    for (double* term : {&out.s0_m, &out.s1, &out.s2_per_m, &out.floor_m, &out.pointing_rad}) *term *= factor;
    return out;
  }

 private:
  static double squared(double x) { return x * x; }
};

/// The noise of a sensor, from range images of unknown scenes. What neighbouring samples disagree by on surfaces that
/// are smooth over five samples is noise; edges and texture are outvoted (median absolute deviation per bin of range).
/// Exact for planes under any sensor. Covers what differs from sample to sample; an error that whole neighbourhoods
/// share, as of calibration, does not show. The floor is what rounding of the stored values alone makes (correlation:
/// where it exceeds the roughness, by how much, squared, up to 4); without any noise the model is tiny but positive.
/// sigma does not fall with range. Noise is taken for symmetric in the range where its skew in the inverse range says
/// so, which takes a few million samples. views: one or more, loaded, all of one sensor. Parallel over views,
/// deterministic; about 3 ms for a view, and 5 ns for each of its samples. Throws InvalidInput when there is no view or
/// no sample in them.
NoiseModel estimate_noise(std::span<const View* const> views, Context& context);

}  // namespace lapseam
