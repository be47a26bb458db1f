#pragma once

// PTX: scans as text, one after another.

#include "io/grid_scan.h"

namespace lapseam {

bool looks_like_ptx(std::string_view start);
Scene read_ptx(const std::filesystem::path& file, const ReadSceneOptions& options, Context& context);
/// offset: where the scan begins; 0: it is looked for from the file's beginning.
std::unique_ptr<GridScan> open_ptx_scan(const Source& source, std::uint32_t index, std::uint64_t offset);

}  // namespace lapseam
