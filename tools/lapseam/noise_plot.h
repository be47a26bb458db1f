#pragma once

#include <span>
#include <string>

#include "lapseam/survey.h"

namespace lapseam::tool {

/// An SVG picture of the noise of each sensor over range: measured (points), the fitted model (line), and the model
/// that the scene gives (dashes). Both axes are logarithmic.
std::string plot_noise(std::span<const SensorSurvey> sensors);

}  // namespace lapseam::tool
