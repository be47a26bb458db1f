#pragma once

// ScanNet's .sens: one file with all depth and colour frames of a recording.

#include <string_view>

#include "io/codecs.h"
#include "io/scene_formats.h"

namespace lapseam {

bool looks_like_sens(std::string_view start);
Scene read_sens(const std::filesystem::path& file, const ReadSceneOptions& options, Context& context);

/// What one frame holds; 0 as offset: it is looked for from the file's beginning.
struct SensFrame {
  std::uint64_t offset = 0;  ///< where the frame begins
  Eigen::Matrix4d T_world_view = Eigen::Matrix4d::Identity();
  std::uint64_t color_bytes = 0, depth_bytes = 0;
};
Image<std::uint16_t> read_sens_depth(const Source& source, std::uint32_t index, std::uint64_t offset);
ColorImage read_sens_color(const Source& source, std::uint32_t index, std::uint64_t offset);

}  // namespace lapseam
