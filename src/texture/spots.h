#pragma once

// Places on the surface at which images are compared.

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "lapseam/mesh.h"

namespace lapseam {

struct Spot {
  std::uint32_t triangle;
  Eigen::Vector3f position_m, normal;
};

/// Spread evenly by area, at most one for each triangle on the mean, each anywhere in its triangle.
std::vector<Spot> choose_spots(const Mesh& mesh, std::size_t most);

}  // namespace lapseam
