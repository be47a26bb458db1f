#pragma once

// A few samples of a view that stand for all of them when views are compared.

#include <Eigen/Geometry>
#include <vector>

#include "lapseam/noise.h"
#include "lapseam/view.h"

namespace lapseam {

struct ProbeSample {
  Eigen::Vector3d point_in_world;
  Eigen::Vector3d normal_in_world;  ///< unit, towards the sensor; zero where the surface is not smooth
  double sigma_m;                   ///< of the range
  double cosine;                    ///< between the normal and the ray
  double spacing_m;
};

struct ViewProbe {
  std::vector<ProbeSample> samples;
  Eigen::AlignedBox3d box_in_world;  ///< of samples all over the image
  double spacing_m = 0;              ///< median
};

/// Takes `count` valid samples evenly over the image.
ViewProbe make_probe(const View& view, const NoiseModel& noise, int count);

/// Sensor-frame normal at a pixel, unit, towards the sensor, over two samples each way; zero where a neighbour is
/// missing or belongs to another surface.
Eigen::Vector3d normal_at(const View& view, const NoiseModel& noise, const SpacingLine& spacing, int u, int v);

}  // namespace lapseam
