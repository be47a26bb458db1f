#pragma once

// The shape of one triangle.

#include <Eigen/Core>

namespace lapseam {

struct TriangleShape {
  float min_angle_deg = 0;
  float middle_side_m = 0;
  double area_m2 = 0;
};

TriangleShape shape_of(const Eigen::Vector3f& a, const Eigen::Vector3f& b, const Eigen::Vector3f& c);

}  // namespace lapseam
