#pragma once

// What lies over another layer of the same surface, at the borders of either.

#include <cstdint>

#include "mend/layers.h"

namespace lapseam {

class Context;

/// Removes border triangles whose middle another one covers; then what came to the border by that. The least sure go
/// first (seams, then by error). Returns how many went. Same result for any number of threads.
std::uint64_t trim_double_layers(LiveMesh& mesh, const Layers& layers, Context& context);

}  // namespace lapseam
