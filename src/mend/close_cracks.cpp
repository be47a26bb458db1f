#include "lapseam/close_cracks.h"

#include <Eigen/Geometry>
#include <nlohmann/json.hpp>

#include "core/parallel.h"
#include "lapseam/sensor.h"
#include "mend/crack_loops.h"
#include "mend/outline_slivers.h"
#include "mend/seen_through.h"
#include "mend/trim.h"
#include "patch/by_view.h"
#include "sew_meshes/merged.h"
#include "sew_meshes/seam_shape.h"

namespace lapseam {
namespace {

constexpr TriangleRule kRule = {.smallest_sine = 1e-3, .fold_cosine = -0.7};
// Where nothing better fits: slits of a few edges with a fold in them.
constexpr TriangleRule kSlitRule = {.smallest_sine = 1e-4, .fold_cosine = -0.95};
constexpr std::size_t kLongestSlit = 16;
// Noisy surfaces are full of folds; one sharper than this is nearly shut, and noise did not make it.
constexpr double kMostBentCosine = -0.9;
// Of a loop that cannot be closed, corners are filled: ten degrees or more, and no folds.
constexpr TriangleRule kCornerRule = {.smallest_sine = 0.17, .fold_cosine = 0.5};

struct VertexSamples {
  std::vector<float> sigma_m, spacing_m;
};

VertexSamples samples_of(const Mesh& mesh, std::span<const Patch> patches, const Witnesses& witnesses) {
  VertexSamples samples{std::vector<float>(mesh.vertex_count()), std::vector<float>(mesh.vertex_count())};
  const VerticesByView vertices(mesh, patches.size());
  for (std::size_t i = 0; i < patches.size(); ++i) {
    const auto width = std::uint32_t(patches[i].grid.width);
    for (const std::uint32_t v : vertices.of(i)) {
      const std::uint32_t pixel = mesh.vertex_pixel[v];
      samples.sigma_m[v] = witnesses.sigma_of(std::uint32_t(i), pixel);
      samples.spacing_m[v] = float(sample_spacing(patches[i].view.sensor, double(pixel % width), double(pixel / width),
                                                  double(patches[i].view.range.pixels[pixel])));
    }
    relieve(patches[i]);
  }
  return samples;
}

}  // namespace

CloseCracksReport close_cracks(Mesh& mesh, std::span<const Patch> patches, const OverlapOptions& options,
                               Context& context) {
  CloseCracksReport report;
  if (mesh.triangles.empty()) return report;
  StageScope stage(context, "close cracks");
  const Witnesses witnesses(patches, mesh.origin_m, options);
  const std::vector<Eigen::Vector3f> normals = measure_vertices(mesh).normals;
  const std::vector<float> error_m = expected_errors(mesh, patches);
  const VertexSamples samples = samples_of(mesh, patches, witnesses);
  LiveMesh live(mesh);
  TriangleCheck check(live, normals, context);
  const Layers layers(live, check, {error_m, samples.spacing_m}, options);
  CrackLoops cracks(live, check, layers, witnesses, {error_m, samples.sigma_m}, report, context);

  report.outline_slivers_removed = remove_outline_slivers(live, witnesses, context);
  report.seen_through_removed = remove_seen_through(live, check, witnesses, error_m, options, context);
  report.covered_triangles_removed = trim_double_layers(live, layers, context);
  cracks.close(kLongestLoop, kRule);
  cracks.close(kLongestSlit, kSlitRule);
  cracks.fill_corners(kCornerRule);
  // Where more surface has come, more of it lies over others.
  report.covered_triangles_removed += trim_double_layers(live, layers, context);
  cracks.close(kLongestLoop, kRule);
  // Only now: what is filled in parts is in the way of what could have been closed whole.
  cracks.fill(kRule);
  cracks.fill_corners(kCornerRule);
  const SeamShape::Changes changes = SeamShape(live, check, kMostBentCosine, context).improve(0);
  report.flips = changes.flips;
  report.collapses = changes.collapses;
  report.outline_slivers_removed += remove_outline_slivers(live, witnesses, context);
  // Slivers that went leave small holes, and edges that were turned let in what did not fit before.
  cracks.close(kLongestLoop, kRule);
  cracks.close(kLongestSlit, kSlitRule);
  mesh = compact(mesh, live.alive());
  return report;
}

std::string to_json(const CloseCracksReport& report) {
  const nlohmann::ordered_json json = {{"outline_slivers_removed", report.outline_slivers_removed},
                                       {"seen_through_removed", report.seen_through_removed},
                                       {"covered_triangles_removed", report.covered_triangles_removed},
                                       {"crack_loops", report.crack_loops},
                                       {"loops_closed", report.loops_closed},
                                       {"loops_filled", report.loops_filled},
                                       {"loop_triangles", report.loop_triangles},
                                       {"triangles_replaced", report.triangles_replaced},
                                       {"corners_filled", report.corners_filled},
                                       {"flips", report.flips},
                                       {"collapses", report.collapses}};
  return json.dump(2);
}

}  // namespace lapseam
