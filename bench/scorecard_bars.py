"""The bars of bench/scorecard: what lapseam sets out to reach."""
import dataclasses

from figures import DISTANCES_MM

# What is measured of each scene: methods of bench/scorecard's Bench.
PLAN = {
    "room_p16": ("mesh",),
    "room_p100": ("mesh", "budget", "threads", "texture", "texture_budget"),
    "room_s4": ("mesh",),
    "bunny": ("mesh",),
    "dragon": ("mesh", "cuts"),
    "redkitchen": ("mesh", "held_out", "texture_steps"),
    "partition": ("mesh",),
    "room_walk": ("growth",),
    "laser_100": ("budget",),
    "panoramas": ("panoramas",),
}
BUDGETS = {"room_p100": "180M", "laser_100": "2G"}
TEXTURE_BUDGET = "400M"  # what integration may take by default

ROOMS = ("room_p16", "room_p100", "room_s4")
SIMULATED = (*ROOMS, "partition")
REAL = ("bunny", "dragon", "redkitchen")
ALL = (*SIMULATED, *REAL)


@dataclasses.dataclass(frozen=True)
class Bar:
    issue: str
    scenes: tuple
    what: str
    figure: str | None  # a name of figures_of(); None: no means yet
    sense: str
    limit: float | None
    unit: str = ""
    note: str = ""


BESIDE = "in one run (--peers)"
UNCODED = "as levelled, before pages are coded"


def seams(scenes, *rest, **named):
    return Bar("seams", scenes, *rest, **named)


def accuracy(scene, *rest, **named):
    return Bar("accuracy", (scene,), *rest, **named)


def speed(scene, *rest, **named):
    return Bar("speed", (scene,), *rest, **named)


def texture(scene, *rest, **named):
    return Bar("texture", (scene,), *rest, **named)


def f_scores(scene, *limits):
    return [accuracy(scene, f"F-score at {mm} mm", f"f_score_{mm}", ">=", limit, "%")
            for mm, limit in zip(DISTANCES_MM, limits)]


BARS = [
    # ---- clean seams
    seams(ALL, "non-manifold edges", "nonmanifold", "<=", 0),
    seams(ALL, "misoriented edges", "misoriented", "<=", 0),
    seams(ALL, "duplicate triangles", "duplicate", "<=", 0),
    seams(ALL, "degenerate triangles", "degenerate", "<=", 0),
    seams(ALL, "self-intersecting triangles", "self_intersecting_percent", "<=", 0.01, "%"),
    seams(ALL, "seam triangles among them", "seam_self_intersecting", "<=", 0),
    seams(SIMULATED, "double layer", "double_layer_percent", "<=", 0.02, "%"),
    seams(("bunny", "redkitchen"), "double layer", "double_layer_measured_percent", "<=", 0.5, "%"),
    seams(("room_p100", "room_s4"), "rays that miss", "miss_percent", "<=", 0.05, "%"),
    seams(SIMULATED, "crack loops, of the boundary, by the truth", "crack_loop_percent", "<=", 1, "%"),
    seams(ALL, "crack loops, of the boundary, by the views", "crack_loop_measured_percent", "<=", 1, "%"),
    seams(ALL, "crack edges, of the boundary, by the views", "crack_measured_percent", "<=", 1, "%",
          "stricter than loops; a single view has 1.0 %"),
    seams(SIMULATED, "components that hold 99 %, more than pieces that views saw", "components_99_more_than_seen", "<=", 0),
    seams(REAL, "components that hold 99 % of the area", "components_99", "<=", 1, "",
          "what is true may have more connected seen surfaces"),
    seams(ALL, "smallest component, triangles", "smallest_component", ">=", 20),
    seams(("bunny",), "distance to bun_zipper, median", "reference_median_mm", "<=", 0.55, "mm", "the scans' own"),
    seams(("dragon",), "distance to dragon_vrip, median", "reference_median_mm", "<=", 0.26, "mm", "the scans' own"),
    seams(ALL, "seam triangles' smallest angle, 5 %", "seam_angle_p5", ">=", 10, "°"),
    seams(("dragon",), "sew of three cuts: components with 99 % of the area", "cuts_components_99", "<=", 1),
    seams(("dragon",), "sew of three cuts: open edges of cracks", "cuts_open_edges", "<=", 0),
    seams(("dragon",), "sew of three cuts: non-manifold edges", "cuts_nonmanifold", "<=", 0),
    seams(("redkitchen",), "held out: non-manifold edges", "held_out_nonmanifold", "<=", 0),
    seams(("redkitchen",), "held out: misoriented edges", "held_out_misoriented", "<=", 0),
    seams(("redkitchen",), "held out: duplicate triangles", "held_out_duplicate", "<=", 0),
    seams(("redkitchen",), "held out: degenerate triangles", "held_out_degenerate", "<=", 0),
    seams(("redkitchen",), "held out: double layer", "held_out_double_layer_percent", "<=", 0.5, "%"),
    # ---- accuracy
    accuracy("room_p100", "accuracy, median", "accuracy_median_mm", "<=", 0.35, "mm"),
    accuracy("room_p100", "accuracy, 90 %", "accuracy_p90_mm", "<=", 2.5, "mm"),
    accuracy("room_p100", "normal deviation, median", "normal_median_deg", "<=", 1.7, "°"),
    *f_scores("room_p100", 80, 89, 95, 98),
    accuracy("room_p100", "completeness at 5 mm", "completeness_5", ">=", 95, "%"),
    accuracy("room_p100", "rays floating over 2 cm in front", "floating_percent", "<=", 0.8, "%"),
    accuracy("room_p100", "rays over 2 cm behind", "behind_percent", "<=", 0.45, "%"),
    accuracy("room_p16", "accuracy, median", "accuracy_median_mm", "<=", 0.7, "mm"),
    *f_scores("room_p16", 62, 77, 89, 96),
    *f_scores("room_s4", 90, 96, 98.5, 99.5),
    accuracy("room_s4", "accuracy, median", "accuracy_median_mm", "<=", 0.25, "mm"),
    accuracy("redkitchen", "held-out views, range off, median", "held_out_median_mm", "<=", 8.0, "mm"),
    accuracy("redkitchen", "held-out views, within 2 cm", "held_out_within_percent", ">=", 80.4, "%"),
    accuracy("redkitchen", "held-out views, missing", "held_out_miss_percent", "<=", 1.1, "%"),
    accuracy("redkitchen", "the same, median, less the best of Open3D TSDF's", "held_out_median_mm_over_tsdf", "<=", 0, "mm",
             BESIDE),
    accuracy("redkitchen", "the same, within 2 cm, less the best of theirs", "held_out_within_percent_over_tsdf", ">=", 0,
             "%", BESIDE),
    accuracy("redkitchen", "the same, missing, less the best of theirs", "held_out_miss_percent_over_tsdf", "<=", 0, "%",
             BESIDE),
    accuracy("room_p100", "bias, median", "bias_absolute_mm", "<=", 0.12, "mm", "a tenth of the least sigma"),
    accuracy("room_p16", "bias, median", "bias_absolute_mm", "<=", 0.12, "mm", "a tenth of the least sigma"),
    accuracy("room_s4", "bias, median", "bias_absolute_mm", "<=", 0.2, "mm", "a tenth of sigma"),
    accuracy("pose errors", "double layer, worst of 0 to 5 mm, 0 to 0.2°", "pose_double_percent", "<=", 0.5, "%",
             "--pose-sweep; the bar of real drift"),
    accuracy("pose errors", "accuracy, median, at 5 mm and 0.2°", "pose_accuracy_mm", "<=", None, "mm", "--pose-sweep"),
    # ---- speed and memory
    speed("room_p100", "wall time, of Open3D TSDF 20 mm's", "wall_over_tsdf20", "<=", 0.8, "×", BESIDE),
    speed("room_p100", "wall time, of Open3D TSDF 10 mm's", "wall_over_tsdf10", "<=", 0.25, "×", BESIDE),
    speed("room_p100", "wall time", "wall_s", "<=", None, "s"),
    speed("room_p100", "peak memory", "peak_rss_mb", "<=", 400, "MB"),
    speed("room_p100", "peak memory with --memory 180M", "budget_peak_mb", "<=", 180, "MB"),
    speed("room_p100", "triangles", "triangles", "<=", 500_000),
    speed("room_s4", "wall time, of Open3D TSDF 10 mm's", "wall_over_tsdf10", "<=", 0.5, "×", BESIDE + ", cube faces"),
    speed("room_s4", "wall time", "wall_s", "<=", None, "s"),
    speed("room_s4", "peak memory", "peak_rss_mb", "<=", 175, "MB"),
    speed("room_walk", "time, 100 to 200 views", "growth_wall", "<=", 2.1, "×"),
    speed("room_walk", "processor time, 100 to 200 views", "growth_cpu", "<=", None, "×"),
    speed("room_walk", "peak memory, 100 to 200 views", "growth_peak", "<=", 1.15, "×"),
    speed("room_p100", "1 thread over 2 threads, wall time", "threads_wall", ">=", 1.8, "×"),
    speed("laser_100", "peak memory with --memory 2G", "budget_peak_mb", "<=", 2000, "MB"),
    speed("laser_100", "wall time with --memory 2G", "budget_wall_s", "<=", None, "s"),
    speed("laser_100", "speed with --memory 2G", "budget_mpixel_per_s", ">=", None, "Mpixel/s"),
    speed("redkitchen", "wall time, of Open3D TSDF 20 mm's", "wall_over_tsdf20", "<=", 1, "×", BESIDE),
    speed("redkitchen", "peak memory, of Open3D TSDF 20 mm's", "peak_over_tsdf20", "<=", 1, "×", BESIDE),
    # ---- texture
    texture("room_p100", "held-out images, PSNR, mean", "psnr_db", ">=", 32.5, "dB"),
    texture("room_p100", "the same, without levelling", "psnr_plain_db", ">=", None, "dB"),
    texture("room_p100", "the same, over Open3D's vertex colours", "psnr_over_fused_db", ">=", 2, "dB", "--peers-color"),
    texture("room_p100", "colour step across patch borders, median", "step_median", "<=", 1, "levels"),
    texture("room_p100", "colour step across patch borders, 95 %", "step_p95", "<=", 4, "levels"),
    texture("room_p100", "the same, all borders between images, median", "step_all_median", "<=", 1, "levels", UNCODED),
    texture("room_p100", "the same, all borders between images, 95 %", "step_all_p95", "<=", 4, "levels", UNCODED),
    texture("redkitchen", "colour step, median, without levelling over with", "step_median_plain_over", ">=", 4, "×"),
    texture("redkitchen", "colour step, 95 %, without levelling over with", "step_p95_plain_over", ">=", 4, "×"),
    texture("redkitchen", "the same, all borders between images, median", "step_all_over", ">=", 4, "×",
            "before and after levelling"),
    texture("redkitchen", "the same, all borders between images, 95 %", "step_all_p95_over", ">=", 4, "×",
            "before and after levelling"),
    texture("panoramas", "scale of the images in the texture", "texture_scale", ">=", 1, "", "4000 × 2000, four stations"),
    texture("panoramas", "peak memory", "texture_peak_mb", "<=", None, "MB"),
    texture("room_p100", "texture stage, of integration's time", "texture_over_integration", "<=", 1, "×"),
    texture("room_p100", "peak memory with texture and --memory 400M", "texture_budget_peak_mb", "<=", 400, "MB"),
    texture("room_p100", "atlas fill", "atlas_fill_percent", ">=", 70, "%"),
    texture("checkerboard room", "tests that fail for foreign colours at chart borders", "bleeding_failures", "<=", 0),
]
