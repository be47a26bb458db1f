#pragma once

// A noise model as manifests and reports write it.

#include <nlohmann/json.hpp>

#include "lapseam/noise.h"

namespace lapseam {

inline nlohmann::ordered_json noise_to_json(const NoiseModel& noise) {
  return {{"s0_m", noise.s0_m},
          {"s1", noise.s1},
          {"s2_per_m", noise.s2_per_m},
          {"floor_m", noise.floor_m},
          {"correlation", noise.correlation},
          {"pointing_rad", noise.pointing_rad},
          {"intensity_power", noise.intensity_power},
          {"intensity_reference", noise.intensity_reference}};
}

}  // namespace lapseam
