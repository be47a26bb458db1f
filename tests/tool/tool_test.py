#!/usr/bin/env python3
"""Command-line tests on the built binary; standard library only.

tool_test.py --list prints the tests, tool_test.py Class.test runs one (LAPSEAM_TOOL names the binary)."""

import json
import math
import os
import re
import signal
import struct
import subprocess
import sys
import tempfile
import time
import unittest
import zlib
from pathlib import Path

TOOL = os.environ.get("LAPSEAM_TOOL", "build/release/lapseam")
COMMANDS = ["simulate", "manifest", "info", "register", "integrate", "sew", "reduce", "render", "evaluate",
            "compare-poses"]


def run(*arguments, environment=None, **options):
    return subprocess.run([TOOL, *map(str, arguments)], capture_output=True, text=True, timeout=240,
                          env={**os.environ, **(environment or {})}, **options)


# ---- inputs made by hand, so that readers are not tested against writers of the same project


def png_bytes(width, height, rows, bits, channels):
    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    header = struct.pack(">IIBBBBB", width, height, bits, {1: 0, 3: 2}[channels], 0, 0, 0)
    raw = b"".join(b"\0" + row for row in rows)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(raw)) + chunk(b"IEND", b"")


def write_depth(path, width, height, depth_mm):
    rows = [struct.pack(f">{width}H", *(depth_mm(u, v) for u in range(width))) for v in range(height)]
    path.write_bytes(png_bytes(width, height, rows, 16, 1))


def write_color(path, width, height):
    rows = [bytes(c for u in range(width) for c in (u * 5 % 256, v * 7 % 256, (u // 8 + v // 8) % 2 * 255))
            for v in range(height)]
    path.write_bytes(png_bytes(width, height, rows, 8, 3))


def pose(x=0.0):
    return [[1, 0, 0, x], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]


def write_wall_scene(folder, views=3, width=48, height=36):
    """Pinhole views, side by side, of a wall 2 m away with a box of 0.4 m before it. Returns the manifest's content."""
    folder.mkdir(parents=True, exist_ok=True)
    focal = 60.0
    listed = []
    for i in range(views):
        x0 = 0.15 * i
        # The box's front face is at 1.6 m, 0.3 m wide, in the middle of the first view.
        def depth(u, v, x0=x0):
            x, y = (u - (width - 1) / 2) / focal * 1.6 + x0, (v - (height - 1) / 2) / focal * 1.6
            near = abs(x) < 0.15 and abs(y) < 0.15
            return (1600 if near else 2000) + zlib.crc32(bytes([u, v, len(listed)])) % 3  # a little noise
        write_depth(folder / f"depth{i}.png", width, height, depth)
        write_color(folder / f"color{i}.png", width, height)
        listed.append({"name": f"v{i}", "sensor": "camera", "T_world_view": pose(x0),
                       "range": {"file": f"depth{i}.png", "quantity": "z", "scale_m": 0.001},
                       "color": {"file": f"color{i}.png", "camera": "same"}})
    return {"format": "lapseam-scene", "version": 1,
            "sensors": {"camera": {"model": "pinhole", "width": width, "height": height, "fx": focal, "fy": focal,
                                   "cx": (width - 1) / 2, "cy": (height - 1) / 2}},
            "views": listed}


def save(folder, manifest):
    path = folder / "scene.json"
    path.write_text(json.dumps(manifest))
    return path


def write_conf_scene(folder):
    """Two Stanford range grids of a hill of 1 cm, the second 2 cm to the right."""
    columns, rows, step = 60, 40, 0.001

    def height(x, y):
        return 0.01 * math.exp(-((x - 0.035) ** 2 + (y - 0.02) ** 2) / 0.0002)

    for i in range(2):
        points = [(c * step, r * step, height(c * step + 0.02 * i, r * step)) for r in range(rows) for c in range(columns)]
        lines = ["ply", "format ascii 1.0", f"obj_info num_cols {columns}", f"obj_info num_rows {rows}",
                 f"element vertex {len(points)}", "property float x", "property float y", "property float z",
                 f"element range_grid {len(points)}", "property list uchar int vertex_indices", "end_header"]
        lines += [f"{x:.6f} {y:.6f} {z:.6f}" for x, y, z in points] + [f"1 {k}" for k in range(len(points))]
        (folder / f"grid{i}.ply").write_text("\n".join(lines) + "\n")
    conf = folder / "scene.conf"
    conf.write_text("camera 0 0 0 0 0 0 1\nbmesh grid0.ply 0 0 0 0 0 0 1\nbmesh grid1.ply 0.02 0 0 0 0 0 1\n")
    return conf


def ply_counts(path):
    """Numbers of vertices and faces that the header declares."""
    header = path.read_bytes()[:2000].split(b"end_header")[0].decode()
    return [int(re.search(rf"element {kind} (\d+)", header)[1]) for kind in ("vertex", "face")]


class ToolTest(unittest.TestCase):
    def setUp(self):
        holder = tempfile.TemporaryDirectory(prefix="lapseam_test_")
        self.addCleanup(holder.cleanup)
        self.folder = Path(holder.name)

    def expect_ok(self, *arguments, **options):
        result = run(*arguments, **options)
        self.assertEqual(result.returncode, 0, f"{arguments}\n{result.stderr}")
        self.assertNotIn("error:", result.stderr)
        return result

    def expect_failure(self, code, *arguments, names=(), **options):
        """One line on stderr begins with 'lapseam: error:' (progress lines aside), and it holds every name."""
        result = run(*arguments, **options)
        self.assertEqual(result.returncode, code, f"{arguments}\n{result.stdout}\n{result.stderr}")
        lines = [line for line in result.stderr.splitlines() if line.startswith("lapseam: error: ")]
        self.assertEqual(len(lines), 1, result.stderr)
        self.assertEqual(result.stderr.splitlines()[-1], lines[0], result.stderr)
        for name in names:
            self.assertIn(name, lines[0])
        return lines[0]

    def expect_usage_error(self, *arguments, names=()):
        result = run(*arguments)
        self.assertEqual(result.stdout, "")
        self.assertEqual(len(result.stderr.splitlines()), 1, result.stderr)
        return self.expect_failure(2, *arguments, names=names)


class Usage(ToolTest):
    def test_no_command_is_a_usage_error_that_lists_the_commands(self):
        self.expect_usage_error(names=COMMANDS)

    def test_version(self):
        result = self.expect_ok("--version")
        self.assertRegex(result.stdout, r"^lapseam \d+\.\d+\.\d+\n$")
        self.assertEqual(result.stderr, "")

    def test_help_lists_the_commands_in_pipeline_order(self):
        text = self.expect_ok("--help").stdout
        places = [re.search(rf"^  {command} ", text, re.M) for command in COMMANDS]
        self.assertTrue(all(places), text)
        starts = [place.start() for place in places]
        self.assertEqual(starts, sorted(starts))

    def test_every_command_has_help_with_the_common_options(self):
        for command in COMMANDS:
            text = self.expect_ok(command, "--help").stdout
            self.assertIn(command, text)
            self.assertIn("--threads", text, command)
            self.assertIn("--progress", text, command)

    def test_help_has_no_line_wider_than_a_terminal_of_120_columns(self):
        for arguments in [["--help"], *([command, "--help"] for command in COMMANDS)]:
            for line in self.expect_ok(*arguments).stdout.splitlines():
                self.assertLessEqual(len(line), 120, f"{arguments}: {line}")

    def test_unknown_command_suggests_the_nearest(self):
        self.expect_usage_error("integrat", names=["unknown command 'integrat'", "did you mean integrate?"])
        self.expect_usage_error("evalaute", names=["did you mean evaluate?"])

    def test_unknown_command_far_from_all_suggests_nothing(self):
        self.assertNotIn("did you mean", self.expect_usage_error("frobnicate"))

    def test_unknown_option_suggests_the_nearest(self):
        self.expect_usage_error("--versoin", names=["did you mean --version?"])
        self.expect_usage_error("integrate", "a.json", "-o", "b.ply", "--reprot", "r.json",
                                names=["integrate:", "unknown option --reprot", "did you mean --report?"])
        self.expect_usage_error("integrate", "a.json", "-o", "b.ply", "--thread=2", names=["did you mean --threads?"])

    def test_unknown_option_is_told_before_what_is_missing(self):
        self.expect_usage_error("integrate", "a.json", "--no-textures", names=["did you mean --no-texture?"])

    def test_missing_value(self):
        self.expect_usage_error("integrate", "a.json", "-o", names=["integrate:"])
        self.expect_usage_error("integrate", "a.json", "-o", "b.ply", "--threads", names=["--threads"])

    def test_missing_arguments(self):
        self.expect_usage_error("integrate", names=["integrate:", "--help"])
        self.expect_usage_error("integrate", "a.json", names=["--output"])
        self.expect_usage_error("info")
        self.expect_usage_error("render")
        self.expect_usage_error("evaluate", "a.ply", names=["TRUTH", "--views"])
        self.expect_usage_error("evaluate", "a.ply", "b.ply", "--only-every", "10", names=["--only-every"])

    def test_values_out_of_range(self):
        scene = save(self.folder, write_wall_scene(self.folder))
        for option in [["--threads", "-1"], ["--threads", "two"], ["--threads", "1.5"], ["--progress", "loud"],
                       ["--hold-out", "-3"], ["--hold-out", "x"]]:
            self.expect_usage_error("integrate", scene, "-o", self.folder / "b.ply", *option, names=[option[0]])

    def test_unknown_ending_of_the_output_is_refused_before_any_work(self):
        scene = save(self.folder, write_wall_scene(self.folder))
        result = run("integrate", scene, "-o", self.folder / "b.stl")
        self.assertIn(result.returncode, (1, 2))
        self.assertIn("b.stl", result.stderr)
        self.assertNotIn("triangulate", result.stderr)

    def test_extra_argument(self):
        self.expect_usage_error("info", "a.json", "b.json", names=["b.json"])

    def test_full_standard_output_is_a_failure(self):
        if not os.path.exists("/dev/full"):
            self.skipTest("no /dev/full here")
        with open("/dev/full", "w") as full:
            result = subprocess.run([TOOL, "--help"], stdout=full, stderr=subprocess.PIPE, text=True)
        self.assertEqual(result.returncode, 1)
        self.assertIn("standard output", result.stderr)


class Integrate(ToolTest):
    def test_writes_every_format(self):
        scene = save(self.folder, write_wall_scene(self.folder))
        for ending, magic in [("ply", b"ply\n"), ("glb", b"glTF"), ("obj", b"")]:
            output = self.folder / f"out.{ending}"
            self.expect_ok("integrate", scene, "-o", output)
            data = output.read_bytes()
            self.assertTrue(data.startswith(magic))
            self.assertGreater(len(data), 1000)
        self.assertTrue((self.folder / "out.mtl").exists())

    def test_ply_declares_provenance_and_matches_its_size(self):
        scene = save(self.folder, write_wall_scene(self.folder))
        self.expect_ok("integrate", scene, "-o", self.folder / "out.ply", "--no-texture")
        data = (self.folder / "out.ply").read_bytes()
        header = data[:data.index(b"end_header\n")].decode()
        self.assertIn("format binary_little_endian 1.0", header)
        for name in ["view", "pixel", "tag"]:
            self.assertRegex(header, rf"property \w+ {name}\b")

    def test_glb_is_well_formed_and_textured(self):
        scene = save(self.folder, write_wall_scene(self.folder))
        self.expect_ok("integrate", scene, "-o", self.folder / "out.glb")
        data = (self.folder / "out.glb").read_bytes()
        magic, version, length = struct.unpack_from("<4sII", data)
        self.assertEqual((magic, version, length), (b"glTF", 2, len(data)))
        size, kind = struct.unpack_from("<I4s", data, 12)
        self.assertEqual(kind, b"JSON")
        document = json.loads(data[20:20 + size])
        self.assertGreaterEqual(len(document["images"]), 1)
        primitives = document["meshes"][0]["primitives"]
        self.assertTrue(any("TEXCOORD_0" in p["attributes"] for p in primitives))
        self.expect_ok("integrate", scene, "-o", self.folder / "bare.glb", "--no-texture")
        bare = (self.folder / "bare.glb").read_bytes()
        size, = struct.unpack_from("<I", bare, 12)
        self.assertNotIn("images", json.loads(bare[20:20 + size]))

    def test_same_bytes_for_any_number_of_threads(self):
        scene = save(self.folder, write_wall_scene(self.folder, views=4))
        for ending in ["ply", "glb"]:
            results = set()
            for threads in [1, 2, 3, 8]:
                output = self.folder / f"out{threads}.{ending}"
                self.expect_ok("integrate", scene, "-o", output, "--threads", threads)
                results.add(output.read_bytes())
            self.assertEqual(len(results), 1, ending)

    def test_report_is_json_with_stages_and_health(self):
        scene = save(self.folder, write_wall_scene(self.folder))
        self.expect_ok("integrate", scene, "-o", self.folder / "out.ply", "--report", self.folder / "r.json")
        report = json.loads((self.folder / "r.json").read_text())
        self.assertIn("stages", report)
        self.assertTrue(report["stages"])
        for stage in report["stages"]:
            self.assertGreaterEqual(stage["seconds"], 0)

    def test_hold_out_leaves_views_out(self):
        scene = save(self.folder, write_wall_scene(self.folder, views=4))
        triangles = []
        for option in [[], ["--hold-out", "2"]]:
            self.expect_ok("integrate", scene, "-o", self.folder / "out.ply", *option)
            header = (self.folder / "out.ply").read_bytes().split(b"end_header")[0].decode()
            triangles.append(int(re.search(r"element face (\d+)", header)[1]))
        self.assertLess(triangles[1], triangles[0])
        self.assertGreater(triangles[1], 100)

    def test_manifest_folder_and_conf_are_scenes(self):
        save(self.folder / "wall", write_wall_scene(self.folder / "wall"))
        self.expect_ok("integrate", self.folder / "wall", "-o", self.folder / "a.ply")
        self.expect_ok("integrate", write_conf_scene(self.folder), "-o", self.folder / "b.ply")
        self.assertGreater((self.folder / "b.ply").stat().st_size, 10000)

    def test_unwritable_output_names_the_path(self):
        scene = save(self.folder, write_wall_scene(self.folder))
        output = self.folder / "missing" / "out.ply"
        self.expect_failure(1, "integrate", scene, "-o", output, names=[str(output.parent)])

    def test_failure_leaves_no_file_behind(self):
        manifest = write_wall_scene(self.folder)
        scene = save(self.folder, manifest)
        (self.folder / "depth1.png").write_bytes((self.folder / "depth1.png").read_bytes()[:100])
        before = sorted(path.name for path in self.folder.iterdir())
        self.expect_failure(1, "integrate", scene, "-o", self.folder / "out.ply")
        self.assertEqual(sorted(path.name for path in self.folder.iterdir()), before)


class BadInput(ToolTest):
    """Exit code 1 and one line that names file, view and field; or a warning and exit code 0 with --skip-bad-views."""

    def break_and_check(self, change, names, skippable=True):
        manifest = write_wall_scene(self.folder)
        change(manifest)
        scene = save(self.folder, manifest)
        output = self.folder / "out.ply"
        self.expect_failure(1, "integrate", scene, "-o", output, names=names)
        self.assertFalse(output.exists())
        result = run("integrate", scene, "-o", output, "--skip-bad-views")
        if not skippable:
            self.assertEqual(result.returncode, 1)
            return
        self.assertEqual(result.returncode, 0, result.stderr)
        warnings = [line for line in result.stderr.splitlines() if line.startswith("lapseam: warning: ")]
        self.assertEqual(len([line for line in warnings if "v1" in line]), 1, result.stderr)
        self.assertTrue(output.exists())

    def test_missing_scene(self):
        missing = self.folder / "nothing.json"
        for command in [["integrate", missing, "-o", self.folder / "out.ply"], ["info", missing],
                        ["manifest", missing, "-o", self.folder / "m.json"]]:
            self.expect_failure(1, *command, names=[str(missing)])

    def test_folder_that_holds_no_scene(self):
        self.expect_failure(1, "integrate", self.folder, "-o", self.folder / "out.ply", names=[str(self.folder)])

    def test_manifest_that_is_not_json(self):
        scene = self.folder / "scene.json"
        scene.write_text('{"format": "lapseam-scene", "version": 1, "views": [')
        self.expect_failure(1, "integrate", scene, "-o", self.folder / "out.ply", names=[str(scene)])

    def test_missing_range_file(self):
        self.break_and_check(lambda m: (self.folder / "depth1.png").unlink(), ["depth1.png", "v1"])

    def test_truncated_png(self):
        path = self.folder / "depth1.png"
        self.break_and_check(lambda m: path.write_bytes(path.read_bytes()[:-60]), ["depth1.png", "v1"])

    def test_empty_png(self):
        self.break_and_check(lambda m: (self.folder / "depth1.png").write_bytes(b""), ["depth1.png", "v1"])

    def test_image_without_a_sample(self):
        self.break_and_check(lambda m: write_depth(self.folder / "depth1.png", 48, 36, lambda u, v: 0),
                             ["depth1.png", "v1"])

    def test_wrong_size(self):
        self.break_and_check(lambda m: write_depth(self.folder / "depth1.png", 40, 36, lambda u, v: 2000),
                             ["depth1.png", "v1", "40", "48"])

    def test_nan_pose(self):
        def change(manifest):
            manifest["views"][1]["T_world_view"][0][3] = None
        self.break_and_check(change, ["scene.json", "v1", "T_world_view"])

    def test_infinite_pose(self):
        manifest = write_wall_scene(self.folder)
        text = json.dumps(manifest).replace("0.15", "1e999", 1)
        scene = self.folder / "scene.json"
        scene.write_text(text)
        self.expect_failure(1, "integrate", scene, "-o", self.folder / "out.ply", names=["scene.json"])

    def test_scaled_pose(self):
        def change(manifest):
            manifest["views"][1]["T_world_view"][0][0] = 1.1
        self.break_and_check(change, ["scene.json", "v1", "T_world_view"])

    def test_mirrored_pose(self):
        def change(manifest):
            manifest["views"][1]["T_world_view"][0][0] = -1
        self.break_and_check(change, ["scene.json", "v1", "T_world_view"])

    def test_unknown_key_of_a_view(self):
        def change(manifest):
            manifest["views"][1]["T_world_veiw"] = manifest["views"][1].pop("T_world_view")
        self.break_and_check(change, ["scene.json", "v1", "T_world_veiw", "T_world_view"])

    def test_unknown_key_of_the_scene(self):
        self.break_and_check(lambda m: m.update(veiws=[]), ["scene.json", "veiws"], skippable=False)

    def test_version_from_the_future(self):
        self.break_and_check(lambda m: m.update(version=1000), ["scene.json", "version"], skippable=False)

    def test_unknown_sensor(self):
        self.break_and_check(lambda m: m["views"][1].update(sensor="camrea"), ["scene.json", "v1", "camrea"])

    def test_all_views_bad(self):
        manifest = write_wall_scene(self.folder)
        for i in range(3):
            (self.folder / f"depth{i}.png").write_bytes(b"not an image")
        scene = save(self.folder, manifest)
        self.expect_failure(1, "integrate", scene, "-o", self.folder / "out.ply", "--skip-bad-views")

    def test_truncated_range_grid(self):
        conf = write_conf_scene(self.folder)
        path = self.folder / "grid1.ply"
        path.write_bytes(path.read_bytes()[:-3000])
        self.expect_failure(1, "integrate", conf, "-o", self.folder / "out.ply", names=["grid1.ply"])
        result = self.expect_ok("integrate", conf, "-o", self.folder / "out.ply", "--skip-bad-views")
        self.assertIn("lapseam: warning: ", result.stderr)

    def test_truncated_exr(self):
        scene = self.folder / "box"
        self.expect_ok("simulate", "box", "-o", scene, "--views", "3", "--size", "48x36", "--format", "exr")
        victims = sorted(path for path in scene.rglob("*.exr") if "truth" not in path.parts)
        self.assertEqual(len(victims), 3)
        victims[1].write_bytes(victims[1].read_bytes()[:-200])
        self.expect_failure(1, "integrate", scene / "scene.json", "-o", self.folder / "out.ply",
                            names=[victims[1].name])
        result = self.expect_ok("integrate", scene / "scene.json", "-o", self.folder / "out.ply", "--skip-bad-views")
        self.assertIn(victims[1].name, result.stderr)

    def test_truncated_mesh(self):
        scene = save(self.folder, write_wall_scene(self.folder))
        self.expect_ok("integrate", scene, "-o", self.folder / "out.ply")
        self.expect_ok("integrate", scene, "-o", self.folder / "out.glb")
        for name in ["out.ply", "out.glb"]:
            broken = self.folder / f"broken_{name}"
            broken.write_bytes((self.folder / name).read_bytes()[:-500])
            self.expect_failure(1, "render", broken, "-o", self.folder / "x.png", names=[broken.name])
            self.expect_failure(1, "evaluate", broken, self.folder / "out.ply", names=[broken.name])
            self.assertFalse((self.folder / "x.png").exists())

    def test_info_says_why_a_view_is_unusable(self):
        scene = save(self.folder, write_wall_scene(self.folder))
        write_depth(self.folder / "depth1.png", 48, 36, lambda u, v: 0)
        result = self.expect_ok("info", scene)
        line = next((l for l in result.stdout.splitlines() if "v1" in l), "")
        self.assertIn("no valid", result.stdout.lower() + result.stderr.lower(), line)


def write_bowl(path, begin, end, hole=False, height=0.0):
    """A shallow bowl over [begin, end] x [0, 1], squares of 0.05; a hole of four squares in the middle if asked."""
    columns, rows = round((end - begin) / 0.05), 20
    points = [(begin + 0.05 * i, 0.05 * j) for j in range(rows + 1) for i in range(columns + 1)]
    faces = []
    for j in range(rows):
        for i in range(columns):
            if hole and abs(i - columns // 2 + 0.5) < 1 and abs(j - rows // 2 + 0.5) < 1:
                continue
            a, b = j * (columns + 1) + i, (j + 1) * (columns + 1) + i
            faces += [(a, a + 1, b + 1), (a, b + 1, b)]
    lines = ["ply", "format ascii 1.0", f"element vertex {len(points)}", "property float x", "property float y",
             "property float z", f"element face {len(faces)}", "property list uchar int vertex_indices", "end_header"]
    lines += [f"{x:.6f} {y:.6f} {0.1 * (x * x + y * y) + height:.6f}" for x, y in points]
    lines += [f"3 {a} {b} {c}" for a, b, c in faces]
    path.write_text("\n".join(lines) + "\n")


class Sew(ToolTest):
    def test_joins_and_reports(self):
        for i, (begin, end) in enumerate([(0, 1), (0.82, 1.82), (1.63, 2.63)]):
            write_bowl(self.folder / f"{i}.ply", begin, end, hole=i == 0, height=0.002 * i)
        inputs = [self.folder / f"{i}.ply" for i in range(3)]
        out, report = self.folder / "out.ply", self.folder / "report.json"
        result = run("sew", *inputs, "-o", out, "--report", report)
        self.assertEqual(result.returncode, 0, result.stderr)
        figures = json.loads(report.read_text())
        self.assertEqual(len(figures["sew"]["meshes"]), 3)
        self.assertGreater(figures["sew"]["seam_triangles"], 20)
        self.assertEqual(figures["sew"]["open_edges"], 0)
        self.assertEqual(figures["health"]["components"], 1)
        self.assertEqual(figures["health"]["boundary_loops"], 2)
        self.assertEqual(figures["health"]["self_intersecting_triangles"], 0)
        filled = run("sew", *inputs, "-o", out, "--report", report, "--fill-holes", 0.2)
        self.assertEqual(filled.returncode, 0, filled.stderr)
        figures = json.loads(report.read_text())
        self.assertEqual(figures["fill_holes"]["holes_filled"], 1)
        self.assertEqual(figures["health"]["boundary_loops"], 1)

    def test_bad_inputs_are_named(self):
        write_bowl(self.folder / "good.ply", 0, 1)
        empty = self.folder / "empty.ply"
        empty.write_text("ply\nformat ascii 1.0\nelement vertex 0\nproperty float x\nproperty float y\n"
                         "property float z\nelement face 0\nproperty list uchar int vertex_indices\nend_header\n")
        for bad in [empty, self.folder / "missing.ply"]:
            result = run("sew", self.folder / "good.ply", bad, "-o", self.folder / "out.ply")
            self.assertEqual(result.returncode, 1)
            self.assertIn(bad.name, result.stderr)
            self.assertFalse((self.folder / "out.ply").exists())


class Register(ToolTest):
    def test_heals_a_perturbed_room(self):
        room = self.folder / "room"
        self.expect_ok("simulate", "room", "-o", room, "--views", 3, "--size", "400x200", "--sensor", "laser", "--no-color")
        scene, rough = room / "scene.json", self.folder / "rough.json"
        self.expect_ok("manifest", scene, "-o", rough, "--perturb", "20,1", "--seed", 2)
        placed = self.folder / "placed"
        result = self.expect_ok("register", rough, "-o", placed, "--truth", scene)
        before, after = (float(re.search(f"pose error {when}: median ([0-9.]+) mm", result.stdout).group(1))
                         for when in ("before", "after"))
        self.assertAlmostEqual(before, 20, delta=12)
        self.assertLess(after, before / 2)
        report = json.loads((placed / "registration.json").read_text())
        self.assertEqual(len(report["views"]), 3)
        self.assertTrue(report["pairs"])
        self.assertTrue(report["disagreement_before"]["pairs"])
        self.assertIn("</svg>", (placed / "registration.svg").read_text())
        covariance = json.loads((placed / "scene.json").read_text())["views"][1]["pose_covariance"]
        self.assertEqual([len(row) for row in covariance], [6] * 6)
        # What was written opens again, and says how far it is from the truth.
        compared = json.loads(run("compare-poses", placed / "scene.json", scene, "--json").stdout)
        self.assertAlmostEqual(1000 * compared["median_translation_m"], after, delta=0.001)

    def test_same_bytes_for_any_number_of_threads(self):
        scene = save(self.folder, write_wall_scene(self.folder))
        written = []
        for threads in (1, 2, 3, 8):
            out = self.folder / f"out{threads}.json"
            self.expect_ok("register", scene, "-o", out, "--threads", threads)
            written.append(out.read_bytes())
        self.assertEqual(len(set(written)), 1)

    def test_integrate_registers_on_the_way(self):
        room = self.folder / "room"
        self.expect_ok("simulate", "room", "-o", room, "--views", 3, "--size", "400x200", "--sensor", "laser", "--no-color")
        rough, report = self.folder / "rough.json", self.folder / "report.json"
        self.expect_ok("manifest", room / "scene.json", "-o", rough, "--perturb", "20,1")
        errors = []
        for options in ([], ["--register"]):
            self.expect_ok("integrate", rough, "-o", self.folder / "room.ply", "--report", report, *options)
            found = json.loads(report.read_text())
            self.assertEqual("registration" in found, bool(options))
            self.assertTrue(found["disagreement"]["pairs"])
            errors.append(found["registration_error_m"])
        self.assertLess(errors[1], errors[0] / 3)

    def test_unknown_fixed_view_is_a_usage_error(self):
        scene = save(self.folder, write_wall_scene(self.folder))
        self.expect_usage_error("register", scene, "-o", self.folder / "out.json", "--fixed", "nobody", names=["nobody"])


class Instruments(ToolTest):
    def test_simulate_is_reproducible_and_seeded(self):
        def contents(folder):
            return {p.relative_to(folder): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}
        base = ["simulate", "box", "--views", "3", "--size", "40x30"]
        for name, options in [("a", ["--threads", "1"]), ("b", ["--threads", "3"]), ("c", ["--seed", "7"])]:
            self.expect_ok(*base, "-o", self.folder / name, *options)
        first = contents(self.folder / "a")
        self.assertIn(Path("scene.json"), first)
        self.assertIn(Path("truth/mesh.ply"), first)
        self.assertIn(Path("truth/scene.json"), first)
        self.assertEqual(first, contents(self.folder / "b"))
        self.assertNotEqual(first, contents(self.folder / "c"))

    def test_whole_chain_on_a_small_room(self):
        room, f = self.folder / "room", self.folder
        self.expect_ok("simulate", "room", "-o", room, "--views", "8", "--size", "80x60")
        info = json.loads(self.expect_ok("info", room / "scene.json", "--json").stdout)
        self.assertTrue(info)
        self.expect_ok("integrate", room / "scene.json", "-o", f / "room.ply", "--no-texture")
        result = self.expect_ok("evaluate", f / "room.ply", room / "truth" / "mesh.ply",
                                "--views", room / "truth" / "scene.json", "--json", f / "e.json")
        self.assertGreater(len(result.stdout.splitlines()), 5)
        self.assertTrue(json.loads((f / "e.json").read_text()))
        for mode in ["shaded", "provenance"]:
            self.expect_ok("render", f / "room.ply", "-o", f / f"{mode}.png", "--mode", mode, "--orbit", "30,40",
                           "--cull", "--size", "160x120")
            picture = (f / f"{mode}.png").read_bytes()
            self.assertEqual(struct.unpack(">II", picture[16:24]), (160, 120))
            self.assertGreater(len(picture), 2000)  # an empty picture packs to a few hundred bytes

    def test_evaluate_without_truth_measures_against_the_views(self):
        room, f = self.folder / "room", self.folder
        self.expect_ok("simulate", "room", "-o", room, "--views", "6", "--size", "80x60", "--no-color")
        self.expect_ok("integrate", room / "scene.json", "-o", f / "room.ply", "--hold-out", "3")
        self.expect_ok("evaluate", f / "room.ply", "--views", room / "scene.json", "--only-every", "3", "--json",
                       f / "e.json")
        evaluation = json.loads((f / "e.json").read_text())
        self.assertIsNone(evaluation["accuracy"])
        self.assertEqual(len(evaluation["against_views"]["ranges_by_view"]), 2)
        self.assertGreater(evaluation["against_views"]["ranges"]["within_percent"], 10)
        self.assertGreater(evaluation["against_views"]["boundary"]["length_m"], 1)
        self.assertGreater(evaluation["mesh"]["seams"]["patches"], 1)
        # The truth beside the same views.
        self.expect_ok("evaluate", f / "room.ply", room / "truth" / "mesh.ply", "--views", room / "truth" / "scene.json",
                       "--measured", room / "scene.json", "--json", f / "both.json")
        both = json.loads((f / "both.json").read_text())
        self.assertEqual(len(both["against_views"]["ranges_by_view"]), 6)
        self.assertAlmostEqual(both["boundary"]["length_m"], both["against_views"]["boundary"]["length_m"], places=3)

    def test_reduce_by_count_ratio_and_error(self):
        f = self.folder
        self.expect_ok("integrate", save(f, write_wall_scene(f)), "-o", f / "wall.ply")
        given = ply_counts(f / "wall.ply")[1]
        self.assertGreater(given, 800)
        for name, option in {"count": ["--triangles", 300], "ratio": ["--ratio", 0.25], "error": ["--max-error", 5],
                             "noise": [], "samples": ["--triangles", 300, "--keep-vertices"]}.items():
            result = self.expect_ok("reduce", f / "wall.ply", "-o", f / f"{name}.ply", *option)
            self.assertIn(str(given), result.stdout)
        self.assertIn(ply_counts(f / "count.ply")[1], (299, 300))
        self.assertIn(ply_counts(f / "samples.ply")[1], (299, 300))
        self.assertIn(given // 4 - ply_counts(f / "ratio.ply")[1], (0, 1))
        # A wall and a box: planes within 5 mm, ragged only at the borders.
        self.assertLess(ply_counts(f / "error.ply")[1], given / 2)
        self.assertLess(ply_counts(f / "noise.ply")[1], given)
        self.assertIn(b"property uint pixel", (f / "count.ply").read_bytes()[:600])

    def test_reduce_refuses_what_it_cannot_do(self):
        f = self.folder
        self.expect_failure(1, "reduce", f / "none.ply", "-o", f / "out.ply", names=["none.ply"])
        self.expect_usage_error("reduce", f / "a.ply")
        self.expect_usage_error("reduce", f / "a.ply", "-o", f / "out.stl", names=["out.stl"])
        for option in [["--triangles", "0"], ["--ratio", "1.5"], ["--ratio", "nan"], ["--max-error", "-1"],
                       ["--max-error", "inf"]]:
            self.expect_usage_error("reduce", f / "a.ply", "-o", f / "out.ply", *option, names=[option[0]])
        self.expect_usage_error("reduce", f / "a.ply", "-o", f / "out.ply", "--ratio", "0.5", "--triangles", "5",
                                names=["--ratio"])
        self.assertFalse((f / "out.ply").exists())

    def test_evaluate_json_on_standard_output_is_only_json(self):
        scene = save(self.folder, write_wall_scene(self.folder))
        self.expect_ok("integrate", scene, "-o", self.folder / "out.ply")
        result = self.expect_ok("evaluate", self.folder / "out.ply", self.folder / "out.ply", "--json", "-")
        self.assertTrue(json.loads(result.stdout))

    def test_manifest_of_a_conf_is_a_scene_that_gives_the_same_mesh(self):
        conf = write_conf_scene(self.folder)
        self.expect_ok("manifest", conf, "-o", self.folder / "m.json")
        self.assertEqual(json.loads((self.folder / "m.json").read_text())["format"], "lapseam-scene")
        self.expect_ok("integrate", conf, "-o", self.folder / "a.ply")
        self.expect_ok("integrate", self.folder / "m.json", "-o", self.folder / "b.ply")
        self.assertEqual((self.folder / "a.ply").read_bytes(), (self.folder / "b.ply").read_bytes())

    def test_negative_angles_are_values_not_options(self):
        scene = save(self.folder, write_wall_scene(self.folder))
        self.expect_ok("integrate", scene, "-o", self.folder / "out.ply")
        self.expect_ok("render", self.folder / "out.ply", "-o", self.folder / "x.png", "--orbit", "-30,-20")


class Progress(ToolTest):
    def test_json_progress_is_json_lines_on_stderr(self):
        scene = save(self.folder, write_wall_scene(self.folder))
        result = self.expect_ok("integrate", scene, "-o", self.folder / "out.ply", "--progress", "json")
        events = [json.loads(line) for line in result.stderr.splitlines() if line.startswith("{")]
        self.assertTrue(any(e["event"] == "begin" for e in events))
        begun = [e["stage"] for e in events if e["event"] == "begin"]
        ended = [e["stage"] for e in events if e["event"] == "end"]
        self.assertEqual(sorted(begun), sorted(ended))

    def test_none_is_silent(self):
        scene = save(self.folder, write_wall_scene(self.folder))
        result = self.expect_ok("integrate", scene, "-o", self.folder / "out.ply", "--progress", "none")
        self.assertEqual(result.stderr, "")

    def test_no_escape_codes_off_a_terminal(self):
        scene = save(self.folder, write_wall_scene(self.folder))
        result = self.expect_ok("integrate", scene, "-o", self.folder / "out.ply")
        self.assertNotIn("\x1b", result.stdout + result.stderr)
        self.assertNotIn("\r", result.stderr)

    def on_terminal(self, arguments, environment):
        """Runs the tool with a terminal on stderr; gives what the terminal received."""
        import pty
        main, other = pty.openpty()
        process = subprocess.Popen([TOOL, *map(str, arguments)], stdout=subprocess.DEVNULL, stderr=other,
                                   env={**os.environ, "TERM": "xterm", **environment})
        os.close(other)
        received = b""
        while True:
            try:
                piece = os.read(main, 65536)
            except OSError:  # Linux: the other side is closed
                break
            if not piece:
                break
            received += piece
        os.close(main)
        self.assertEqual(process.wait(), 0, received)
        return received.decode()

    def test_terminal_gets_a_bar_and_is_left_tidy(self):
        scene = save(self.folder, write_wall_scene(self.folder))
        text = self.on_terminal(["integrate", scene, "-o", self.folder / "out.ply"], {"NO_COLOR": ""})
        self.assertIn("\r\x1b[K", text)
        self.assertRegex(text, r"(\n|\x1b\[K)$")

    def test_no_color_is_respected(self):
        scene = save(self.folder, write_wall_scene(self.folder))
        text = self.on_terminal(["integrate", scene, "-o", self.folder / "out.ply"], {"NO_COLOR": "1"})
        self.assertNotIn("\x1b[3", text)

    def test_interrupt_ends_with_130_and_without_a_result(self):
        output = self.folder / "room"
        for which in (signal.SIGINT, signal.SIGTERM):
            process = subprocess.Popen([TOOL, "simulate", "room", "-o", str(output), "--views", "400", "--size", "640x480",
                                        "--progress", "json"], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
            process.stderr.readline()  # it has begun
            time.sleep(0.1)
            process.send_signal(which)
            _, text = process.communicate(timeout=120)
            self.assertEqual(process.returncode, 130, text)
            self.assertIn("lapseam: error: interrupted", text)
            self.assertFalse((output / "scene.json").exists())


if __name__ == "__main__":
    if "--list" in sys.argv:
        for case in (Usage, Integrate, BadInput, Instruments, Progress):
            for test in unittest.defaultTestLoader.getTestCaseNames(case):
                print(f"{case.__name__}.{test}")
    else:
        unittest.main()
