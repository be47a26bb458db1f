"""Range images of a lapseam manifest for Open3D: pinhole views in 16-bit PNG, z. Needs Debian's python3-open3d, hence the
system's own Python."""
import json
from pathlib import Path

import numpy as np
import open3d as o3d


def read_stored(folder, source):
    stored = np.asarray(o3d.io.read_image(str(folder / source["file"])))
    if stored.dtype != np.uint16:
        raise SystemExit(f"{source['file']}: not a 16-bit PNG")
    return stored


def read_range(folder, source):
    """Metres, 0 where there is no sample."""
    stored = read_stored(folder, source)
    ranges = stored.astype(np.float32) * source["scale_m"]
    for value in source.get("invalid", []):
        ranges[stored == value] = 0
    return np.ascontiguousarray(ranges)


def views_of(scene_file, hold_out=0):
    """(view, sensor) of each that is not held out."""
    manifest = json.loads(scene_file.read_text())
    for i, view in enumerate(manifest["views"]):
        if not hold_out or i % hold_out:
            yield view, manifest["sensors"][view["sensor"]]


def pinhole_parameters(sensor):
    if sensor["model"] != "pinhole":
        raise SystemExit(f"a {sensor['model']} sensor: cut it to cube faces first (bench/cube_faces)")
    return sensor["width"], sensor["height"], sensor["fx"], sensor["fy"], sensor["cx"], sensor["cy"]


def T_view_world(view):
    return np.linalg.inv(np.array(view["T_world_view"], float))


def add_arguments(parser):
    parser.add_argument("scene", type=Path)
    parser.add_argument("-o", "--output", required=True)
    parser.add_argument("--hold-out", type=int, default=0, help="leave out every Nth view, from the first")
