#pragma once

// Which mesh shows a surface that several show, and taking it away from the others.

#include "lapseam/sew_meshes.h"
#include "sew_meshes/live_mesh.h"
#include "sew_meshes/merged.h"
#include "sew_meshes/surface_probe.h"

namespace lapseam {

class Context;

/// probes: of the meshes as they came. How far the meshes lie apart where they overlap, and the distance up to which
/// surfaces count as one.
void measure_disagreement(const MergedMeshes& merged, const SurfaceProbes& probes, SewMeshesReport& report,
                          Context& context);

/// Removes what another mesh shows better, so that a gap of about half an edge is left between what remains, and tidies
/// the borders that it makes. Uses report.overlap_distance_m.
void cut_overlap(const MergedMeshes& merged, LiveMesh& live, const SurfaceProbes& probes, SewMeshesReport& report,
                 Context& context);

}  // namespace lapseam
