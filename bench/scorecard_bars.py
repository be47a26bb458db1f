"""The bars of bench/scorecard: what lapseam sets out to reach."""
import dataclasses

from figures import DISTANCES_MM

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
    seams(ALL, "components that hold 99 % of the area", "components_99", "<=", 1, "",
          "the truth may have more connected seen surfaces"),
    seams(ALL, "smallest component, triangles", "smallest_component", ">=", 20),
    seams(("bunny",), "distance to bun_zipper, median", "reference_median_mm", "<=", 0.55, "mm", "the scans' own"),
    seams(("dragon",), "distance to dragon_vrip, median", "reference_median_mm", "<=", 0.26, "mm", "the scans' own"),
    seams(ALL, "seam triangles' smallest angle, 5 %", "seam_angle_p5", ">=", 10, "°"),
    seams(("three cuts of the dragon",), "sew: components, cracks, non-manifold", None, "<=", None),
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
    accuracy("pose errors", "accuracy and double layer, 0 to 5 mm, 0 to 0.2°", None, "<=", None),
    # ---- speed and memory
    speed("room_p100", "wall time", "wall_s", "<=", 0.8 * 8.3, "s", "0.8 × Open3D TSDF 20 mm as stated"),
    speed("room_p100", "wall time", "wall_s", "<=", 0.25 * 28, "s", "0.25 × Open3D TSDF 10 mm as stated"),
    speed("room_p100", "peak memory", "peak_rss_mb", "<=", 400, "MB"),
    speed("room_p100", "peak memory with --memory 180M", None, "<=", 180, "MB"),
    speed("room_p100", "triangles", "triangles", "<=", 500_000),
    speed("room_s4", "wall time", "wall_s", "<=", 0.5 * 15.8, "s", "0.5 × Open3D TSDF 10 mm as stated"),
    speed("room_s4", "peak memory", "peak_rss_mb", "<=", 175, "MB"),
    speed("200 views of room_p100's room", "time, 100 to 200 views", None, "<=", 2.1, "×"),
    speed("200 views of room_p100's room", "peak memory, 100 to 200 views", None, "<=", 1.15, "×"),
    speed("room_p100", "1 thread over 2 threads, wall time", None, ">=", 1.8, "×"),
    speed("100 laser stations", "peak memory with --memory 2G", None, "<=", 2000, "MB"),
    speed("redkitchen", "wall time, of Open3D TSDF's", None, "<=", 1, "×"),
    speed("redkitchen", "peak memory, of Open3D TSDF's", None, "<=", 1, "×"),
    # ---- texture
    texture("room_p100", "held-out images, PSNR, mean", None, ">=", 32.5, "dB"),
    texture("room_p100", "the same, over Open3D's vertex colours", None, ">=", 2, "dB"),
    texture("room_p100", "colour step across patch borders, median", None, "<=", 1, "levels"),
    texture("room_p100", "colour step across patch borders, 95 %", None, "<=", 4, "levels"),
    texture("redkitchen", "colour step, without levelling over with", None, ">=", 4, "×"),
    texture("room_p100", "texture stage, of integration's time", None, "<=", 1, "×"),
    texture("room_p100", "atlas fill", None, ">=", 70, "%"),
    texture("checker room", "wrong-coloured pixels at chart borders", None, "<=", 0),
]
