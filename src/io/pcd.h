#pragma once

// PCD: point clouds of the Point Cloud Library. Organised ones are range images.

#include "io/grid_scan.h"

namespace lapseam {

bool looks_like_pcd(std::string_view start);
/// Each file is a view; named after the files.
Scene read_pcd_files(const std::filesystem::path& folder, const std::vector<std::string>& names,
                     const ReadSceneOptions& options, Context& context);
std::unique_ptr<GridScan> open_pcd(const Source& source);

}  // namespace lapseam
