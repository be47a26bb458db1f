#pragma once

// What the kernels work on: neighbouring views of the furnished room as an RGB-D camera measures it, made when first
// asked for and then kept, and what each stage makes of them.

#include <filesystem>
#include <vector>

#include "lapseam/mesh.h"
#include "lapseam/overlap.h"
#include "lapseam/patch.h"
#include "lapseam/triangulate.h"
#include "lapseam/view.h"

namespace lapseam::bench {

inline constexpr int kViews = 8;

/// As measured, 640 × 480.
const std::vector<View>& views();
NoiseModel noise();
/// By which neighbours in the smoothed views are told apart, as the pipeline does it.
const StepThreshold& step_threshold();
/// The views smoothed, triangulated, with confidence.
const std::vector<Patch>& patches();
/// What the views claim of each other.
const std::vector<Image<std::uint8_t>>& claims();
/// The patches sewn into one mesh, as the pipeline does it, without mending.
Mesh sewn(Context& context);
const Mesh& mesh();

std::size_t sample_count(const View& view);
std::size_t sample_count();  ///< of all views

/// The first view in a file of its own, removed at exit.
const ViewSource& exr_file();
const ViewSource& png_file();

}  // namespace lapseam::bench
