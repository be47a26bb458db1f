"""Figures by name, read from what was measured of a scene: the run, and `lapseam evaluate`."""

# Figures by name: where each is in what was measured of a scene, or how it follows. A path that leads nowhere, as of
# figures that need a truth, gives none.
PATHS = {
    "wall_s": "run.wall_s",
    "nonmanifold": "evaluation.mesh.nonmanifold_edges",
    "misoriented": "evaluation.mesh.misoriented_edges",
    "duplicate": "evaluation.mesh.duplicate_triangles",
    "degenerate": "evaluation.mesh.degenerate_triangles",
    "triangles": "evaluation.mesh.triangles",
    "components_99": "evaluation.mesh.components_99_percent_area",
    "smallest_component": "evaluation.mesh.smallest_component_triangles",
    "seam_self_intersecting": "evaluation.mesh.seams.self_intersecting_seam_triangles",
    "seam_angle_p5": "evaluation.mesh.seams.seam_min_angle_p5_deg",
    "seam_length_per_area": "evaluation.mesh.seams.seam_length_per_area_per_m",
    "islands": "evaluation.mesh.seams.islands",
    "miss_percent": "evaluation.rays.miss_percent",
    "floating_percent": "evaluation.rays.floating_percent",
    "behind_percent": "evaluation.rays.behind_percent",
    "double_layer_percent": "evaluation.rays.double_layer_percent",
    "double_layer_measured_percent": "evaluation.against_views.ranges.double_layer_percent",
    "crack_percent": "evaluation.boundary.crack_percent",
    "crack_loop_percent": "evaluation.boundary.crack_loop_percent",
    "crack_loop_measured_percent": "evaluation.against_views.boundary.crack_loop_percent",
    "crack_measured_percent": "evaluation.against_views.boundary.crack_percent",
    "accuracy_median_mm": "evaluation.accuracy.median_mm",
    "accuracy_p90_mm": "evaluation.accuracy.p90_mm",
    "bias_mm": "evaluation.accuracy.bias_median_mm",
    "normal_median_deg": "evaluation.accuracy.normal_deviation_median_deg",
    "reference_median_mm": "reference.accuracy.median_mm",
    "held_out_median_mm": "held_out.against_views.ranges.median_absolute_mm",
    "held_out_within_percent": "held_out.against_views.ranges.within_percent",
    "held_out_miss_percent": "held_out.against_views.ranges.miss_percent",
    "held_out_double_layer_percent": "held_out.against_views.ranges.double_layer_percent",
    "held_out_nonmanifold": "held_out.mesh.nonmanifold_edges",
    "held_out_misoriented": "held_out.mesh.misoriented_edges",
    "held_out_duplicate": "held_out.mesh.duplicate_triangles",
    "held_out_degenerate": "held_out.mesh.degenerate_triangles",
}
DISTANCES_MM = (1, 2, 5, 10)


def at_path(measured, path):
    for key in path.split("."):
        if not isinstance(measured, dict) or measured.get(key) is None:
            return None
        measured = measured[key]
    return measured


def figures_of(measured):
    """Name to number, for one scene."""
    figures = {name: at_path(measured, path) for name, path in PATHS.items()}
    figures["peak_rss_mb"] = measured["run"]["peak_rss_bytes"] / 1e6
    mesh = measured["evaluation"]["mesh"]
    if mesh["self_intersecting_triangles"] is not None and mesh["triangles"]:
        figures["self_intersecting_percent"] = 100 * mesh["self_intersecting_triangles"] / mesh["triangles"]
    for distance in measured["evaluation"]["distances"]:
        figures[f"f_score_{distance['at_mm']:g}"] = distance["f_score_percent"]
        figures[f"completeness_{distance['at_mm']:g}"] = distance["completeness_percent"]
    return {name: figure for name, figure in figures.items() if figure is not None}
