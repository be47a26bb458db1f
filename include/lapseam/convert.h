#pragma once

// Scenes from one format to another.

#include <filesystem>
#include <string_view>
#include <vector>

#include "lapseam/view.h"

namespace lapseam {

class Context;

enum class SceneFormat { kManifest, kE57, kPtx, kTum, kRedwood, kNerfstudio, kPcd };

/// "scene", "e57", "ptx", "tum", "redwood", "nerfstudio", "pcd"; throws InvalidInput for another name.
SceneFormat scene_format_named(std::string_view name);
std::vector<std::string_view> scene_format_names();
/// By the ending of a file's name (.e57, .ptx); a folder with manifest and EXR images for all else.
SceneFormat scene_format_of(const std::filesystem::path& output);

struct ConvertOptions {
  SceneFormat format = SceneFormat::kManifest;
  bool with_color = true;
  bool skip_bad_views = false;  ///< a view whose pixels cannot be read is left out with a warning
};

struct ConvertReport {
  std::uint64_t views = 0, with_color = 0, samples = 0;
};

/// Writes all views of a scene. The output appears under its name when it is complete; until then an older one stays
/// as it is. Of folders, only one that is empty or was written by this function is replaced. Files are read and images
/// encoded in parallel; the bytes do not depend on the number of threads. A few views are in memory at a time.
/// Throws InvalidInput for what the format cannot say (lens distortion in TUM folders, say).
ConvertReport convert_scene(const Scene& scene, const std::filesystem::path& output, const ConvertOptions& options,
                            Context& context);

}  // namespace lapseam
