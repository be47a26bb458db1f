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
    "seen_pieces": "evaluation.completeness.seen_pieces",
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
    """Name to number, for one scene. What was not measured has no figure; `figures` among the measurements are taken as they
    are."""
    figures = {name: at_path(measured, path) for name, path in PATHS.items()}
    if "run" in measured:
        figures["peak_rss_mb"] = measured["run"]["peak_rss_bytes"] / 1e6
    evaluation = measured.get("evaluation")
    if evaluation:
        mesh = evaluation["mesh"]
        if mesh["self_intersecting_triangles"] is not None and mesh["triangles"]:
            figures["self_intersecting_percent"] = 100 * mesh["self_intersecting_triangles"] / mesh["triangles"]
        for distance in evaluation.get("distances") or []:
            figures[f"f_score_{distance['at_mm']:g}"] = distance["f_score_percent"]
            figures[f"completeness_{distance['at_mm']:g}"] = distance["completeness_percent"]
    if figures["components_99"] is not None and figures["seen_pieces"] is not None:
        figures["components_99_more_than_seen"] = max(0, figures["components_99"] - figures["seen_pieces"])
    if figures["bias_mm"] is not None:
        figures["bias_absolute_mm"] = abs(figures["bias_mm"])
    figures.update(measured.get("figures", {}))
    return {name: figure for name, figure in figures.items() if figure is not None}


def ratio(a, b):
    return a / b if a is not None and b else None


def figures_beside_peers(by_program):
    """Of one scene of bench/peers: lapseam against the others of the same run."""
    ran = {key: result for key, result in by_program.items() if not result.get("failed")}
    out = {}
    if "lapseam" not in ran:
        return out
    ours = ran["lapseam"]
    for key in ("tsdf20", "tsdf10"):
        if key in ran:
            out[f"wall_over_{key}"] = ratio(ours["median"]["wall_s"], ran[key]["median"]["wall_s"])
            out[f"peak_over_{key}"] = ratio(ours["median"]["peak_rss_bytes"], ran[key]["median"]["peak_rss_bytes"])
    for name, best in (("median_mm", min), ("within_percent", max), ("miss_percent", min)):
        theirs = [ran[key]["figures"].get(f"held_out_{name}") for key in ("tsdf20", "tsdf10") if key in ran]
        mine = ours["figures"].get(f"held_out_{name}")
        if mine is not None and theirs and None not in theirs:
            out[f"held_out_{name}_over_tsdf"] = mine - best(theirs)
    return {name: figure for name, figure in out.items() if figure is not None}
