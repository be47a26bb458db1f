#pragma once

#include <cmath>
#include <nlohmann/json.hpp>

namespace lapseam {

/// A number as JSON has it, which knows no infinity.
inline nlohmann::ordered_json finite_or_null(double x) {
  return std::isfinite(x) ? nlohmann::ordered_json(x) : nlohmann::ordered_json(nullptr);
}

}  // namespace lapseam
