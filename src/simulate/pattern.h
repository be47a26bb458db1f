#pragma once

// Procedural albedo, evaluated where a ray hits.

#include "lapseam/simulate.h"

namespace lapseam::simulation {

/// Linear reflectance at a point of a surface with this normal; both in the world (or in the mesh's local frame, if
/// that is what the material's pattern frame is relative to).
Eigen::Vector3f albedo(const Material& material, const Eigen::Vector3f& point, const Eigen::Vector3f& normal);

}  // namespace lapseam::simulation
