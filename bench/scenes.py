"""The scenes of the benchmarks, made when first asked for, and parts of them."""
import dataclasses
import json
import pathlib

from harness import BUILD, DATA, Failed, run, write_json


@dataclasses.dataclass(frozen=True)
class Scene:
    kind: str  # dataset (has truth, is imported), folder (read as it is), manifest (written first), simulate
    source: str  # below the data folder; of simulate, the scene's name
    options: tuple = ()
    reference: str = ""  # another program's mesh of the same scans
    hold_out: int = 0  # also integrate without every Nth view, and measure against those

    @property
    def has_truth(self):
        return self.kind in ("dataset", "simulate")


SCENES = {
    "room_p16": Scene("dataset", "room_p16"),
    "room_p100": Scene("dataset", "room_p100"),
    "room_s4": Scene("dataset", "room_s4"),
    "bunny": Scene("folder", "bunny/bun.conf", reference="bunny/bun_zipper.ply"),
    "dragon": Scene("folder", "dragon/dragonStandRight.conf", reference="dragon/dragon_vrip.ply"),
    "redkitchen": Scene("manifest", "redkitchen", ("--color-intrinsics", "525,525,320,240", "--color-offset", "0.025,0,0"),
                        hold_out=10),
    "partition": Scene("simulate", "partition", ("--sensor", "rgbd", "--views", "40", "--no-color")),
    # The same room, sensor and kind of walk as room_p100, twice as many views.
    "room_walk": Scene("simulate", "room", ("--views", "200", "--format", "png", "--no-color")),
    "laser_100": Scene("simulate", "room", ("--sensor", "laser", "--views", "100", "--format", "png", "--no-color")),
    "panoramas": Scene("simulate", "room", ("--sensor", "laser", "--views", "4", "--size", "4000x2000")),
    # For tests of the benchmarks themselves.
    "tiny": Scene("simulate", "sphere", ("--trajectory", "axes", "--views", "6", "--size", "64x48", "--fov", "40",
                                         "--format", "png", "--no-color")),
}


def prepare(name, data, work, build):
    """The scene file; made below `work` when it is not there. Throws Failed when its data are missing."""
    scene = SCENES[name]
    if scene.kind != "simulate" and not (data / scene.source).exists():
        raise Failed(f"no {data / scene.source}")
    if scene.kind == "folder":
        return data / scene.source
    made = work / name / "scene" / "scene.json"
    if made.exists():
        return made
    made.parent.mkdir(parents=True, exist_ok=True)
    if scene.kind == "dataset":
        run(build / "import_dataset", data / scene.source, made.parent)
    elif scene.kind == "manifest":
        run(build / "lapseam", "manifest", data / scene.source, "-o", made, *scene.options)
    else:
        run(build / "lapseam", "simulate", scene.source, "-o", made.parent, *scene.options)
    return made


def truth_of(scene_file):
    """Arguments of `lapseam evaluate` after the mesh."""
    truth = scene_file.parent / "truth"
    return truth / "mesh.ply", "--views", truth / "scene.json"


def view_count(scene_file):
    return len(json.loads(scene_file.read_text())["views"])


def pixel_count(scene_file, hold_out=0):
    manifest = json.loads(scene_file.read_text())
    sensors = (manifest["sensors"][view["sensor"]] for i, view in enumerate(manifest["views"])
               if not hold_out or i % hold_out)
    return sum(sensor["width"] * sensor["height"] for sensor in sensors)


def picked(total, count, how):
    """Indices of `count` views of `total`: spread evenly over all, or the first along the trajectory."""
    return list(range(count)) if how == "first" else [i * total // count for i in range(count)]


def write_part(scene_file, indices, out_file):
    """A manifest of some views of another; files are where they were."""
    manifest = json.loads(scene_file.read_text())
    manifest["views"] = [manifest["views"][i] for i in indices]
    for view in manifest["views"]:
        for image in ("range", "color"):
            if image in view and "file" in view[image]:
                view[image]["file"] = str((scene_file.parent / view[image]["file"]).resolve())
    write_json(out_file, manifest)


def part(scene_file, count, how, folder):
    """The scene with `count` of its views, its truth likewise; the scene itself when it has no more."""
    total = view_count(scene_file)
    if count == total:
        return scene_file
    if count > total:
        raise Failed(f"{scene_file} has {total} views, not {count}")
    made = folder / f"{how}_{count}" / "scene.json"
    indices = picked(total, count, how)
    write_part(scene_file, indices, made)
    truth = scene_file.parent / "truth"
    if truth.exists():
        write_part(truth / "scene.json", indices, made.parent / "truth/scene.json")
        link = made.parent / "truth/mesh.ply"
        link.unlink(missing_ok=True)
        link.symlink_to((truth / "mesh.ply").resolve())
    return made


def add_arguments(parser, default):
    """The options that name scenes, data and programs, alike in all benchmarks."""
    parser.add_argument("--scenes", default=default, help=f"names, with commas ({default}): " + ", ".join(SCENES))
    parser.add_argument("--data", default=DATA, type=pathlib.Path, help=f"the shared data sets ({DATA})")
    parser.add_argument("--work", required=True, type=pathlib.Path, help="folder for scenes and results; scenes are kept")
    parser.add_argument("--build", default=BUILD, type=pathlib.Path, help="folder of the built programs")


def add_resume(parser):
    parser.add_argument("--resume", action="store_true", help="go on with a run that was broken off: what it measured is "
                        "taken from JSON.runs, so the programs have to be the same")


def named_scenes(parser, text):
    names = [name for name in text.split(",") if name]
    for name in names:
        if name not in SCENES:
            parser.error(f"no scene {name}; there are " + ", ".join(SCENES))
    return names
