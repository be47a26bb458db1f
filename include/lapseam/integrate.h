#pragma once

// The whole way from a scene to a textured mesh: load, smooth, triangulate, overlap, sew, texture.

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "lapseam/close_cracks.h"
#include "lapseam/context.h"
#include "lapseam/fill_holes.h"
#include "lapseam/health.h"
#include "lapseam/mesh.h"
#include "lapseam/noise_measurement.h"
#include "lapseam/overlap.h"
#include "lapseam/reduce.h"
#include "lapseam/register.h"
#include "lapseam/sew.h"
#include "lapseam/smooth.h"
#include "lapseam/survey.h"
#include "lapseam/texture.h"
#include "lapseam/view.h"

namespace lapseam {

enum class ColorOutput {
  kNone,
  kVertices,  ///< one colour per vertex, from the texture
  kAtlas,     ///< texture pages and coordinates
};

struct IntegrateOptions {
  /// Poses are refined first; its fixed views count as the scene does. Nothing: they are taken as given.
  std::optional<RegisterOptions> registration{};
  SmoothOptions smooth{};
  OverlapOptions overlap{};  ///< its registration error is estimated when left at 0
  /// Holes that nobody measured are closed up to this size; by default they stay open.
  FillHolesOptions fill_holes{};
  /// The mesh keeps no vertex that noise alone would ask for: it may be off the planes of the triangles it stands for
  /// by this many sigmas of a single measurement, root mean square. 0: all vertices are kept.
  double reduce_sigma = 0.25;
  /// The finished mesh is reduced further when one of the limits is set.
  ReduceOptions reduce{};
  TextureOptions texture{};  ///< its registration error is the one that was found
  ColorOutput color = ColorOutput::kAtlas;
  /// Leave out every Nth view, from the first; 0: none. For measuring against views that were not used.
  int hold_out = 0;
  /// Leave out views that cannot be loaded, with a warning, instead of failing.
  bool skip_bad_views = false;
  /// Connected pieces of fewer triangles are dropped: noise, not surface.
  std::uint64_t smallest_component = 20;
  /// Count self-intersecting triangles in the report; exact, and about as slow as the sewing.
  bool check_self_intersections = false;
};

/// What became of one view.
struct ViewReport {
  std::string name;
  std::uint64_t samples = 0;             ///< valid samples in the range image
  std::uint64_t triangles = 0;           ///< after triangulation
  std::uint64_t triangles_in_model = 0;  ///< that show this view, before the result is reduced
  double smoothing_sigma_factor = 1;     ///< share of the noise that smoothing left
  ClaimCounts claims;                    ///< of its samples
};

/// The thresholds of one sensor, as they were derived from its data.
struct SensorReport {
  std::uint64_t views = 0;
  NoiseModel noise;
  bool is_noise_given = false;      ///< from the manifest, not estimated
  NoiseMeasurement measured;        ///< of up to eight of its range images
  double range_m[3] = {0, 0, 0};    ///< lowest, median, highest range seen
  double sigma_m[3] = {0, 0, 0};    ///< noise there
  double spacing_m[3] = {0, 0, 0};  ///< distance between samples there
  double step_m[3] = {0, 0, 0};     ///< range difference between neighbours that parts two surfaces there
};

struct IntegrateReport {
  std::vector<std::string> views_left_out;
  std::vector<ViewReport> views;
  std::map<std::string, SensorReport> sensors;  ///< by sensor id
  double registration_error_m = 0;
  Disagreement disagreement;             ///< of the views as integrated; pairs count `views`
  std::vector<PlacedView> placed_views;  ///< as `views`; empty: poses were taken as given
  RegisterReport registration;
  ZipperReport zipper;
  std::uint64_t outline_vertices_moved = 0;  ///< half a sample outwards, see docs/method.md
  std::uint64_t self_intersecting_triangles_removed = 0;
  CloseCracksReport cracks;
  std::uint64_t pinched_vertices_split = 0;
  std::uint64_t nonmanifold_triangles_removed = 0;
  std::uint64_t triangles_in_small_components = 0;
  FillHolesReport fill_holes;
  std::uint64_t triangles_before_reduction = 0;  ///< at the end of sewing, where the model is thinned as it grows
  TextureReport texture;
  MeshHealth health;
  MemoryUse memory;
};

struct IntegrateResult {
  Mesh mesh;
  IntegrateReport report;
};

/// What integrate() will need, resident, of the whole process: by the sizes of the images and what models took so far,
/// good to a third, of small scenes to a half. Views whose size only their file knows are not in it. Textures come on
/// top.
struct MemoryEstimate {
  std::uint64_t all_bytes = 0;    ///< with all images in memory
  std::uint64_t least_bytes = 0;  ///< with a budget of the context's: less is refused
  /// A budget that costs little time and does not grow with the number of views of one room; 0: none is needed.
  std::uint64_t usual_bytes = 0;
};
MemoryEstimate estimate_memory(const Scene& scene, const IntegrateOptions& options, int threads);

/// Views are added one after another, in the scene's order. The mesh's provenance counts views as the scene does.
/// Same bytes for any number of threads and any memory budget of the context. A budget below estimate_memory() is
/// refused; the model itself is kept in memory, and what it takes over the budget is warned of.
/// Throws InvalidInput, IoError, Cancelled.
IntegrateResult integrate(const Scene& scene, const IntegrateOptions& options, Context& context);

/// The report with the context's stages and warnings, as JSON text.
std::string to_json(const IntegrateReport& report, const Context& context);

}  // namespace lapseam
