#include "range_files.h"

#include <algorithm>
#include <set>

namespace lapseam {

std::vector<std::string> range_file_names(const std::vector<ViewSource>& views) {
  const auto is_safe = [](char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '-' || c == '_' ||
           c == '.';
  };
  constexpr std::size_t kLongest = 100;
  std::set<std::string> used;
  std::vector<std::string> out;
  for (const ViewSource& view : views) {
    std::string stem = view.name.substr(0, kLongest);
    std::replace_if(
        stem.begin(), stem.end(), [&](char c) { return !is_safe(c); }, '_');
    if (stem.empty() || stem.front() == '.') stem.insert(0, "view");
    std::string name = stem;
    for (int i = 2; !used.insert(name).second; ++i) name = stem + "-" + std::to_string(i);
    out.push_back(name + ".exr");
  }
  return out;
}

RangeSource written_range(const RangeSource& given, const std::filesystem::path& file, const Sensor& sensor) {
  RangeSource written;
  written.format = RangeFormat::kExr;
  written.file = file;
  const bool is_spherical = std::holds_alternative<SphericalSensor>(sensor);
  written.quantity = is_spherical ? RangeQuantity::kDistance : RangeQuantity::kZ;
  written.intensity_file = given.intensity_file;
  return written;
}

}  // namespace lapseam
