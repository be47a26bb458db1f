#pragma once

// Range images that go beside a manifest.

#include <string>
#include <vector>

#include "lapseam/io.h"

namespace lapseam {

/// File names for the views' range images: theirs where that is safe in any file system, otherwise with what is not
/// replaced. No two are alike.
std::vector<std::string> range_file_names(const std::vector<ViewSource>& views);

/// Where a view's ranges are once they have been written to `file` with write_range_exr. Its image of intensities, if
/// it has one, stays where it is.
RangeSource written_range(const RangeSource& given, const std::filesystem::path& file, const Sensor& sensor);

}  // namespace lapseam
