#pragma once

// E57 (ASTM E2807): scans with rows and columns, or with a pose; images as colour views. docs/formats.md says what is
// read and what is not.

#include "io/codecs.h"
#include "io/grid_scan.h"

namespace lapseam {

/// Every scan of the file is a view.
Scene read_e57(const std::filesystem::path& file, const ReadSceneOptions& options, Context& context);
/// As open_scan().
std::unique_ptr<GridScan> open_e57_scan(const Source& source, std::uint32_t index, std::optional<ImageSize> known_size,
                                        Context* context);

/// The images of the scan that have a camera and a pose, those with the widest fields first.
std::vector<ColorSource> find_e57_images(const Source& source, std::uint32_t scan_index,
                                         const Eigen::Isometry3d& T_world_scan);
ColorImage read_e57_image(const Source& source, std::uint32_t image_index);
ImageSize probe_e57_image(const Source& source, std::uint32_t image_index);

}  // namespace lapseam
