#pragma once

// What has to be done to an image's colours for all images to match.

#include <Eigen/Core>
#include <array>

namespace lapseam {

/// What an image's values are multiplied with, channel by channel: exp(gain + falloff[0] r² + falloff[1] r⁴), where r
/// is the distance from the image's middle over half of its diagonal.
struct ColorResponse {
  Eigen::Vector3f gain = Eigen::Vector3f::Zero();
  std::array<Eigen::Vector3f, 2> falloff = {Eigen::Vector3f::Zero(), Eigen::Vector3f::Zero()};

  Eigen::Vector3f factor(float squared_radius) const {
    const Eigen::Vector3f power = gain + squared_radius * (falloff[0] + squared_radius * falloff[1]);
    return power.array().exp();
  }
};

}  // namespace lapseam
