#pragma once

// Range images that go beside a manifest.

#include <string>
#include <vector>

#include "lapseam/io.h"

namespace lapseam {

/// File names for the views' range images: theirs where that is safe in any file system, otherwise with what is not
/// replaced. No two are alike.
std::vector<std::string> range_file_names(const std::vector<ViewSource>& views);

}  // namespace lapseam
