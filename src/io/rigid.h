#pragma once

#include <Eigen/Geometry>
#include <string>

#include "io/source.h"

namespace lapseam {

/// The rigid motion of a 4 × 4 matrix. Refuses what is not finite, has another last row than 0 0 0 1, or deviates from
/// a rotation (reflection, scale, shear) by more than `tolerance`; smaller deviations, which come from rounding in text
/// files, are taken out. A matrix that is a rotation to double precision comes back unchanged.
Eigen::Isometry3d to_rigid(const Eigen::Matrix4d& matrix, const Source& source, const std::string& field,
                           double tolerance = 1e-4);

}  // namespace lapseam
