#include "lapseam/sew_meshes.h"

#include <nlohmann/json.hpp>

#include "health/predicates.h"
#include "lapseam/context.h"
#include "lapseam/error.h"
#include "sew_meshes/cut.h"
#include "sew_meshes/seam.h"

namespace lapseam {
namespace {

/// No predicate says anything about them, so they may not stay; what they leave open is closed like any cut.
void remove_flat_triangles(const MergedMeshes& merged, LiveMesh& live, SewMeshesReport& report) {
  for (std::uint32_t t = 0; t < live.triangle_count(); ++t) {
    const Triangle& c = live.triangle(t);
    if (dominant_plane(live.position(c[0]), live.position(c[1]), live.position(c[2])) >= 0) continue;
    live.remove(t);
    ++report.meshes[merged.triangle_mesh[t]].defects;
  }
}

}  // namespace

Mesh sew_meshes(std::span<const Mesh> meshes, const SewMeshesOptions& options, SewMeshesReport& report,
                Context& context) {
  if (!(options.overlap_distance_m >= 0 && options.overlap_distance_m < 1e30))
    throw InvalidInput({}, {}, "overlap_distance_m", "must be a distance or 0");
  report = {};
  MergedMeshes merged = merge_meshes(meshes, report, context);
  LiveMesh live(merged.mesh);
  const std::size_t given = live.triangle_count();
  // Before flat triangles go: what they leave open is no border.
  const SurfaceProbes probes = make_probes(merged, live, context);
  remove_flat_triangles(merged, live, report);
  if (meshes.size() > 1) {
    measure_disagreement(merged, probes, report, context);
    if (options.overlap_distance_m > 0) report.overlap_distance_m = options.overlap_distance_m;
    cut_overlap(merged, live, probes, report, context);
  }
  {
    StageScope stage(context, "sew");
    Seam seam(live, merged, probes, float(report.overlap_distance_m), context);
    seam.close(report);
  }
  for (std::uint32_t t = 0; t < given; ++t) report.meshes[merged.triangle_mesh[t]].triangles_kept += live.is_alive(t);
  for (std::size_t t = given; t < live.triangle_count(); ++t) report.seam_triangles += live.is_alive(std::uint32_t(t));
  return compact(merged.mesh, live.alive());
}

std::string to_json(const SewMeshesReport& report) {
  nlohmann::ordered_json json = {{"edge_length_m", report.edge_length_m},
                                 {"disagreement_m", report.disagreement_m},
                                 {"overlap_distance_m", report.overlap_distance_m}};
  for (const SewnMesh& mesh : report.meshes)
    json["meshes"].push_back({{"triangles", mesh.triangles},
                              {"defects", mesh.defects},
                              {"removed", mesh.removed},
                              {"triangles_kept", mesh.triangles_kept}});
  json["seam_triangles"] = report.seam_triangles;
  json["front_triangles"] = report.front_triangles;
  json["loop_triangles"] = report.loop_triangles;
  json["defects_widened"] = report.defects_widened;
  json["removed_to_repair"] = report.removed_to_repair;
  json["flips"] = report.flips;
  json["collapses"] = report.collapses;
  json["open_edges"] = report.open_edges;
  return json.dump(2);
}

}  // namespace lapseam
