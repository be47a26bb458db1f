#pragma once

// What every report begins with: what it is, by which version, and what the stages cost.

#include <nlohmann/json.hpp>

#include "core/memory.h"
#include "lapseam/context.h"
#include "lapseam/version.h"

namespace lapseam {

inline nlohmann::ordered_json report_head(const char* format, const Context& context) {
  nlohmann::ordered_json json;
  json["format"] = format;
  json["version"] = 1;
  json["lapseam"] = kVersion;
  json["threads"] = context.threads();
  for (const StageRecord& stage : context.stages())
    json["stages"].push_back(
        {{"name", stage.name}, {"seconds", stage.seconds}, {"peak_rss_bytes", stage.peak_rss_bytes}});
  json["peak_rss_bytes"] = peak_rss_bytes();
  return json;
}

}  // namespace lapseam
