#pragma once

#include "io/source.h"

namespace lapseam {

/// Walks the headers of an EXR file before OpenEXR does, which allocates what they ask for: refuses attributes that are
/// longer than the file and images that it cannot hold. What else may be wrong is left for OpenEXR to find.
void check_exr_headers(const Source& source);

}  // namespace lapseam
