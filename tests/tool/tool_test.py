#!/usr/bin/env python3
"""Command-line tests on the built binary; standard library only.

tool_test.py --list prints the tests, tool_test.py Class.test runs one (LAPSEAM_TOOL names the binary)."""

import json
import math
import os
import random
import re
import signal
import struct
import subprocess
import sys
import tempfile
import time
import unittest
import xml.etree.ElementTree
import zlib
from pathlib import Path

TOOL = os.environ.get("LAPSEAM_TOOL", "build/release/lapseam")
COMMANDS = ["simulate", "manifest", "convert", "info", "smooth", "register", "integrate", "texture", "sew", "reduce", "tiles",
            "render", "evaluate", "compare-poses"]


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

    def test_a_quality_of_a_format_that_has_none_is_refused_before_any_work(self):
        scene = save(self.folder, write_wall_scene(self.folder))
        glb = self.folder / "b.glb"
        self.expect_usage_error("integrate", scene, "-o", glb, "--texture-quality", "90",
                                names=["--texture-quality", "png is lossless", "--texture-format jpeg"])
        result = run("integrate", scene, "-o", glb, "--texture-quality", "90", "--texture-format", "jpeg")
        self.assertEqual(result.returncode, 0, result.stderr)

    def test_unknown_ending_of_the_output_is_refused_before_any_work(self):
        scene = save(self.folder, write_wall_scene(self.folder))
        result = run("integrate", scene, "-o", self.folder / "b.3ds")
        self.assertIn(result.returncode, (1, 2))
        self.assertIn("b.3ds", result.stderr)
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
        self.assertNotIn(" unseen", header)
        self.expect_ok("integrate", scene, "-o", self.folder / "colored.ply")
        self.assertIn(b"property uchar unseen\n", (self.folder / "colored.ply").read_bytes())

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
        self.assertTrue((self.folder / "r-noise.svg").read_text().startswith("<svg"))
        for sensor in report["sensors"].values():
            self.assertTrue(sensor["noise_by_range"])
        for stage in report["stages"]:
            self.assertGreaterEqual(stage["seconds"], 0)

    def test_memory_is_bounded_without_a_trace_in_the_result(self):
        scene = save(self.folder, write_wall_scene(self.folder, views=4))
        scratch = self.folder / "scratch"
        scratch.mkdir()
        self.expect_ok("integrate", scene, "-o", self.folder / "all.ply", "--no-texture")
        self.expect_ok("integrate", scene, "-o", self.folder / "little.ply", "--no-texture", "--memory", "500M", "--tmp",
                       scratch, "--report", self.folder / "r.json")
        self.assertEqual((self.folder / "all.ply").read_bytes(), (self.folder / "little.ply").read_bytes())
        memory = json.loads((self.folder / "r.json").read_text())["memory"]
        self.assertEqual(memory["budget_bytes"], 500_000_000)
        self.assertGreater(memory["largest_stored_bytes"], 10_000)
        self.assertEqual(list(scratch.iterdir()), [])
        self.expect_ok("integrate", scene, "-o", self.folder / "free.ply", "--no-texture", "--memory", "0", "--report",
                       self.folder / "r.json")
        self.assertNotIn("memory", json.loads((self.folder / "r.json").read_text()))
        self.expect_failure(1, "integrate", scene, "-o", self.folder / "none.ply", "--memory", "1M",
                          names=["memory", "1 MB will not do", "would"])
        self.assertFalse((self.folder / "none.ply").exists())

    def test_large_scenes_have_a_memory_budget_if_there_is_a_place_for_their_images(self):
        manifest = write_wall_scene(self.folder, views=1)
        manifest["sensors"]["camera"].update(width=640, height=480)
        image = self.folder / "depth0.png"
        write_depth(image, 640, 480, lambda u, v: 2000)
        image.write_bytes(image.read_bytes()[:-200])  # an error, but only when it is decoded
        manifest["views"] *= 150
        manifest["views"] = [{**view, "name": f"v{i}"} for i, view in enumerate(manifest["views"])]
        for view in manifest["views"]:
            del view["color"]
        scene = save(self.folder, manifest)
        for folder, expected in ((str(self.folder), "at least; kept under "), ("/no/such/folder", "all images stay in memory")):
            result = run("integrate", scene, "-o", self.folder / "m.ply", "--no-texture", "--progress", "plain",
                         environment={"TMPDIR": folder})
            self.assertEqual(result.returncode, 1, result.stderr)
            self.assertIn(expected, result.stderr)
            self.assertIn("v0", result.stderr.splitlines()[-1])

    def test_hold_out_leaves_views_out(self):
        scene = save(self.folder, write_wall_scene(self.folder, views=4))
        triangles = []
        for option in [[], ["--hold-out", "2"]]:
            self.expect_ok("integrate", scene, "-o", self.folder / "out.ply", *option)
            header = (self.folder / "out.ply").read_bytes().split(b"end_header")[0].decode()
            triangles.append(int(re.search(r"element face (\d+)", header)[1]))
        self.assertLess(triangles[1], triangles[0])
        self.assertGreater(triangles[1], 100)

    def test_texture_colours_a_mesh_and_novel_views_measure_it(self):
        room, f = self.folder / "room", self.folder
        scene = room / "scene.json"
        self.expect_ok("simulate", "room", "-o", room, "--views", "8", "--size", "80x60")
        self.expect_ok("integrate", scene, "-o", f / "bare.ply", "--hold-out", "4", "--no-texture")
        self.expect_ok("integrate", scene, "-o", f / "whole.glb", "--hold-out", "4")
        self.expect_ok("texture", f / "bare.ply", scene, "-o", f / "room.glb", "--hold-out", "4", "--report", f / "t.json")
        self.assertEqual((f / "room.glb").read_bytes(), (f / "whole.glb").read_bytes())
        report = json.loads((f / "t.json").read_text())["texture"]
        self.assertGreater(report["used_pixels"], 1000)
        self.assertGreaterEqual(report["page_pixels"], report["chart_pixels"])
        self.expect_ok("evaluate", f / "room.glb", "--novel", scene, "--only-every", "4", "--json", f / "e.json")
        novel = json.loads((f / "e.json").read_text())
        self.assertEqual([view["view"] for view in novel["views"]],
                         [json.loads(scene.read_text())["views"][i]["name"] for i in (0, 4)])
        self.assertGreater(novel["mean_psnr_db"], 10)
        self.assertGreater(novel["steps"]["samples"], 0)
        size = {}
        for limit in (["--texel", "200"], ["--texture-memory", "0.05"], ["--no-level", "--no-equalize"]):
            self.expect_ok("texture", f / "bare.ply", scene, "-o", f / "small.glb", "--hold-out", "4", "--report",
                           f / "t.json", *limit)
            size[limit[0]] = json.loads((f / "t.json").read_text())["texture"]["page_pixels"]
        self.assertLess(size["--texel"], report["page_pixels"] / 2)
        self.assertLessEqual(3 * size["--texture-memory"], 50000)
        self.expect_usage_error("evaluate", f / "room.glb", f / "bare.ply", "--novel", scene, names=["--novel"])
        # A mesh of more views than the scene has belongs to another one.
        save(self.folder / "other", write_wall_scene(self.folder / "other", views=2))
        self.expect_failure(1, "texture", f / "bare.ply", self.folder / "other", "-o", f / "x.glb", names=["view"])

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


class Formats(ToolTest):
    """convert, tiles, STL, and what an interrupted or failed run leaves."""

    def test_every_format_converts_to_every_other_and_integrates_alike(self):
        scene = save(self.folder, write_wall_scene(self.folder))
        self.expect_ok("integrate", scene, "-o", self.folder / "own.ply")
        # The wall's depth is in millimetres, which all of these hold exactly.
        for name, options in [("room.e57", []), ("room.ptx", []), ("scene", []), ("tum", ["--format", "tum"]),
                              ("redwood", ["--format", "redwood"]), ("nerf", ["--format", "nerfstudio"]),
                              ("pcd", ["--format", "pcd"])]:
            out = self.folder / name
            text = self.expect_ok("convert", scene, "-o", out, *options).stdout
            self.assertIn("3 views, 3 with colour, 5184 samples", text)
            info = json.loads(self.expect_ok("info", out, "--json").stdout)
            self.assertEqual([view["samples"] for view in info["views"]], [1728] * 3, name)
            self.assertEqual({view["sensor"] for view in info["views"]}, {"pinhole"}, name)
            self.expect_ok("integrate", out, "-o", self.folder / f"{name}.ply")
            # Reduction within the noise may choose other triangles where samples differ by a micrometre.
            own, other = (ply_counts(self.folder / f)[1] for f in ("own.ply", f"{name}.ply"))
            self.assertLess(abs(own - other), 0.1 * own + 10, name)
            self.expect_ok("convert", out, "-o", self.folder / f"back_{name}")
            self.expect_ok("info", self.folder / f"back_{name}")

    def test_convert_refuses_what_a_format_cannot_say(self):
        scene = write_wall_scene(self.folder)
        scene["sensors"]["camera"]["distortion"] = {"k1": 0.01}
        path = save(self.folder, scene)
        self.expect_failure(1, "convert", path, "-o", self.folder / "tum", "--format", "tum",
                            names=["v0", "sensor.distortion", "TUM"])
        self.assertFalse((self.folder / "tum").exists())
        self.expect_usage_error("convert", path, "-o", self.folder / "x", "--format", "las", names=["--format"])

    def test_info_counts_what_stands_for_no_sample(self):
        rows = [struct.pack(">8H", 0, 0, 65535, 1500, 1500, 1501, 1502, 1500) for _ in range(8)]
        (self.folder / "d.png").write_bytes(png_bytes(8, 8, rows, 16, 1))
        scene = write_wall_scene(self.folder, views=1)
        scene["sensors"]["camera"].update(width=8, height=8)
        scene["views"][0]["range"].update(file="d.png", invalid=[65535])
        del scene["views"][0]["color"]
        text = self.expect_ok("info", save(self.folder, scene)).stdout
        self.assertIn("pixels without a sample: 16 zero, 8 named invalid", text)

    def test_tiles(self):
        scene = save(self.folder, write_wall_scene(self.folder, views=2, width=96, height=72))
        self.expect_ok("integrate", scene, "-o", self.folder / "a.ply", "--reduce-sigma", "0")
        triangles = ply_counts(self.folder / "a.ply")[1]
        self.expect_ok("tiles", self.folder / "a.ply", "-o", self.folder / "tiles", "--max-triangles", "1000")
        tileset = json.loads((self.folder / "tiles" / "tileset.json").read_text())
        self.assertEqual(tileset["asset"]["version"], "1.1")

        def triangles_of(tile):
            data = (self.folder / "tiles" / tile["content"]["uri"]).read_bytes()
            document = json.loads(data[20:20 + struct.unpack_from("<I", data, 12)[0]])
            primitives = [p for mesh in document["meshes"] for p in mesh["primitives"]]
            return sum(document["accessors"][p["indices"]]["count"] for p in primitives) // 3

        def leaves(tile):
            self.assertLessEqual(triangles_of(tile), 1000)
            children = tile.get("children", [])
            for child in children:
                self.assertLessEqual(child["geometricError"], tile["geometricError"])
            if not children:
                self.assertEqual(tile["geometricError"], 0)
                return triangles_of(tile)
            return sum(leaves(child) for child in children)

        self.assertGreater(triangles, 1500)  # so that there is something to split
        self.assertEqual(leaves(tileset["root"]), triangles)

    def test_tiles_of_a_textured_mesh_have_its_colors(self):
        scene = save(self.folder, write_wall_scene(self.folder, views=2, width=96, height=72))
        self.expect_ok("integrate", scene, "-o", self.folder / "a.glb", "--reduce-sigma", "0")
        self.expect_ok("integrate", scene, "-o", self.folder / "a.ply", "--reduce-sigma", "0")
        for name in "a.glb", "a.ply":
            self.expect_ok("tiles", self.folder / name, "-o", self.folder / (name + ".tiles"), "--max-triangles", "1000")

        def colors_of(folder):
            out = []
            for file in sorted((folder / "tiles").glob("*.glb")):
                data = file.read_bytes()
                length = struct.unpack_from("<I", data, 12)[0]
                document, binary = json.loads(data[20:20 + length]), data[20 + length + 8:]
                for p in (p for mesh in document["meshes"] for p in mesh["primitives"]):
                    accessor = document["accessors"][p["attributes"]["COLOR_0"]]
                    view = document["bufferViews"][accessor["bufferView"]]
                    start = view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
                    out.append(struct.unpack_from(f"<{4 * accessor['count']}H", binary, start))
            return out

        textured, colored = colors_of(self.folder / "a.glb.tiles"), colors_of(self.folder / "a.ply.tiles")
        self.assertGreater(len(textured), 2)
        means = [[sum(sum(c[k::4]) for c in colors) / sum(len(c) // 4 for c in colors) for k in range(3)]
                 for colors in (textured, colored)]
        for a, b in zip(*means):  # JPEG takes a level or two of 255
            self.assertLess(abs(a - b), 2 * 65535 / 255)
        self.assertGreater(len({c for colors in textured for c in colors}), 20)

    def test_stl_holds_every_triangle(self):
        scene = save(self.folder, write_wall_scene(self.folder))
        self.expect_ok("integrate", scene, "-o", self.folder / "a.stl")
        self.expect_ok("integrate", scene, "-o", self.folder / "a.ply")
        data = (self.folder / "a.stl").read_bytes()
        count = struct.unpack_from("<I", data, 80)[0]
        self.assertEqual(len(data), 84 + 50 * count)
        self.assertEqual(count, ply_counts(self.folder / "a.ply")[1])

    def kill_at_random(self, arguments, output, is_whole, times=20):
        """Kills the command at random moments of its run; its output must be the old one or the new one, whole."""
        begin = time.monotonic()
        self.expect_ok(*arguments)
        duration = time.monotonic() - begin
        self.assertTrue(is_whole(output))
        random.seed(8)
        killed = 0
        for i in range(times):
            process = subprocess.Popen([TOOL, *map(str, arguments)], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
            time.sleep(random.random() * duration)
            process.kill()
            killed += process.wait() == -signal.SIGKILL
            self.assertTrue(is_whole(output), f"killed for the {i + 1}. time")
        self.assertGreater(killed, times // 2)
        self.expect_ok(*arguments)
        self.assertTrue(is_whole(output))
        left = [path.name for path in output.parent.iterdir() if path.name.startswith(f".{output.name}")]
        self.assertEqual(left, [], "what killed runs left behind")

    def test_kill_9_of_integrate_leaves_a_whole_result(self):
        scene = save(self.folder, write_wall_scene(self.folder, views=4, width=96, height=72))
        output = self.folder / "out.ply"
        whole = []

        def is_whole(path):
            whole.append(path.read_bytes())
            return whole[-1] == whole[0]

        self.kill_at_random(["integrate", scene, "-o", output], output, is_whole)

    def test_kill_9_of_convert_leaves_a_whole_result(self):
        scene = save(self.folder, write_wall_scene(self.folder, views=4, width=96, height=72))
        folder, file = self.folder / "out", self.folder / "out.e57"

        def content(path):
            files = sorted(p for p in path.rglob("*") if p.is_file()) if path.is_dir() else [path]
            return [(str(p.relative_to(path)), p.read_bytes()) for p in files]

        for output in (folder, file):
            whole = []

            def is_whole(path, whole=whole):
                whole.append(content(path))
                return whole[-1] == whole[0]

            self.kill_at_random(["convert", scene, "-o", output], output, is_whole)

    def test_full_disk_leaves_the_old_file(self):
        scene = save(self.folder, write_wall_scene(self.folder, views=4, width=96, height=72))
        output = self.folder / "out.e57"
        self.expect_ok("convert", scene, "-o", output)
        before = output.read_bytes()
        limit = ["bash", "-c", 'ulimit -f 8; trap "" XFSZ; exec "$@"', "limited", TOOL]
        result = subprocess.run([*limit, "convert", str(scene), "-o", str(output)], capture_output=True, text=True)
        self.assertEqual(result.returncode, 1, result.stderr)
        self.assertIn("out.e57", result.stderr)
        self.assertEqual(output.read_bytes(), before)
        self.assertEqual(list(self.folder.glob(".out.e57*")), [])


def read_exr_plane(path):
    """Width, height, and the float samples of a single-channel, ZIP-compressed scan-line EXR; no more than our tests
    need, and not by our own reader."""
    data = path.read_bytes()
    at, attributes = 8, {}
    while data[at]:
        end = data.index(b"\0", at)
        name, kind_end = data[at:end].decode(), data.index(b"\0", end + 1)
        size, = struct.unpack_from("<i", data, kind_end + 1)
        attributes[name] = data[kind_end + 5:kind_end + 5 + size]
        at = kind_end + 5 + size
    x0, y0, x1, y1 = struct.unpack("<4i", attributes["dataWindow"])
    width, height = x1 - x0 + 1, y1 - y0 + 1
    samples = []
    for block, in struct.iter_unpack("<Q", data[at + 1:at + 1 + 8 * -(-height // 16)]):
        y, size = struct.unpack_from("<2i", data, block)
        full = 4 * width * min(16, height - y + y0)
        packed = data[block + 8:block + 8 + size]
        if size < full:
            deltas = bytearray(zlib.decompress(packed))
            for i in range(1, len(deltas)):
                deltas[i] = (deltas[i - 1] + deltas[i] - 128) % 256
            half = (len(deltas) + 1) // 2
            packed = bytearray(len(deltas))
            packed[0::2], packed[1::2] = deltas[:half], deltas[half:]
        samples += struct.unpack(f"<{full // 4}f", packed)
    return width, height, samples


class NoisePlot(ToolTest):
    def test_shows_each_sensor_with_points_and_curve(self):
        f = self.folder
        self.expect_ok("simulate", "room", "-o", f / "room", "--views", "4", "--size", "120x90", "--no-color")
        info = self.expect_ok("info", f / "room" / "scene.json", "--plot", f / "noise.svg", "--json")
        root = xml.etree.ElementTree.parse(f / "noise.svg").getroot()
        space = {"svg": "http://www.w3.org/2000/svg"}
        bins = json.loads(info.stdout)["sensors"][0]["noise_by_range"]
        self.assertGreater(len(bins), 5)
        circles = root.findall("svg:circle", space)
        self.assertEqual(len(circles), len(bins))
        # Farther is rougher: to the right and up.
        self.assertLess(float(circles[0].get("cx")), float(circles[-1].get("cx")))
        self.assertGreater(float(circles[0].get("cy")), float(circles[-1].get("cy")))
        self.assertEqual(len(root.findall("svg:polyline", space)), 1)

    def test_unwritable_plot_names_the_path(self):
        scene = save(self.folder, write_wall_scene(self.folder))
        self.expect_failure(1, "info", scene, "--plot", self.folder / "none" / "noise.svg", names=["noise.svg"])


class Smooth(ToolTest):
    def test_writes_a_scene_of_the_same_views(self):
        f = self.folder
        manifest = write_wall_scene(f / "in")
        scene = save(f / "in", manifest)
        result = self.expect_ok("smooth", scene, "-o", f / "out")
        self.assertIn("3 views", result.stdout)
        written = json.loads((f / "out" / "scene.json").read_text())
        self.assertEqual([v["name"] for v in written["views"]], [v["name"] for v in manifest["views"]])
        self.assertEqual([v["T_world_view"] for v in written["views"]], [v["T_world_view"] for v in manifest["views"]])
        self.assertEqual(sorted(p.name for p in (f / "out" / "range").iterdir()), ["v0.exr", "v1.exr", "v2.exr"])
        for view, given in zip(written["views"], manifest["views"]):
            self.assertEqual(Path(view["color"]["file"]).resolve(), (f / "in" / given["color"]["file"]).resolve())
            self.assertGreater(view["noise"]["floor_m"], 0)
        self.expect_ok("integrate", f / "out", "-o", f / "out.ply")

    def test_keeps_steps_and_pixels_without_a_sample(self):
        f = self.folder
        manifest = write_wall_scene(f, views=1)

        def depth(u, v):  # a wall with a step of 0.3 m and a hole
            if 10 <= u < 15 and 10 <= v < 14:
                return 0
            return (2000 if u < 30 else 2300) + zlib.crc32(bytes([u, v])) % 9 - 4
        write_depth(f / "depth0.png", 48, 36, depth)
        self.expect_ok("smooth", save(f, manifest), "-o", f / "out")
        width, height, samples = read_exr_plane(f / "out" / "range" / "v0.exr")
        self.assertEqual((width, height), (48, 36))
        before = after = 0
        for i, z in enumerate(samples):
            u, v = i % width, i // width
            self.assertEqual(z > 0, depth(u, v) > 0, (u, v))
            if z > 0:
                truth = 2.0 if u < 30 else 2.3
                before, after = before + abs(depth(u, v) / 1000 - truth), after + abs(z - truth)
                self.assertLess(abs(z - truth), 0.005)  # no more than the worst of the noise
        self.assertLess(after, 0.5 * before)

    def test_conf_keeps_its_measured_grids(self):
        f = self.folder
        self.expect_ok("smooth", write_conf_scene(f), "-o", f / "out")
        self.assertIn("measured_grid", self.expect_ok("info", f / "out").stdout)

    def test_same_bytes_for_any_number_of_threads(self):
        scene = save(self.folder, write_wall_scene(self.folder))
        for threads in [1, 3]:
            self.expect_ok("smooth", scene, "-o", self.folder / f"out{threads}", "--threads", threads)
        for name in ["scene.json", "range/v0.exr", "range/v2.exr"]:
            one, three = ((self.folder / f"out{threads}" / name).read_bytes() for threads in [1, 3])
            self.assertEqual(one, three, name)

    def test_its_own_input_is_never_overwritten(self):
        f = self.folder
        scene = save(f, write_wall_scene(f))
        before = scene.read_bytes()
        self.expect_failure(1, "smooth", scene, "-o", f, names=["scene.json", "overwrite"])
        self.assertEqual(scene.read_bytes(), before)
        self.expect_ok("smooth", scene, "-o", f / "once")
        (f / "once" / "scene.json").rename(f / "once" / "other.json")
        self.expect_failure(1, "smooth", f / "once" / "other.json", "-o", f / "once", names=["v0.exr", "overwrite"])

    def test_bad_views(self):
        f = self.folder
        manifest = write_wall_scene(f)
        manifest["views"][0]["name"] = "../odd name"
        manifest["views"][1]["name"] = "black"
        write_depth(f / "depth1.png", 48, 36, lambda u, v: 0)
        scene = save(f, manifest)
        self.expect_failure(1, "smooth", scene, "-o", f / "out", names=["black", "no valid sample"])
        self.assertFalse((f / "out" / "scene.json").exists())
        result = run("smooth", scene, "-o", f / "out", "--skip-bad-views")
        self.assertEqual(result.returncode, 0, result.stderr)
        self.assertIn("black", result.stderr)
        written = json.loads((f / "out" / "scene.json").read_text())
        self.assertEqual([v["name"] for v in written["views"]], ["../odd name", "v2"])
        self.assertEqual(len(list((f / "out" / "range").iterdir())), 2)

    def test_usage(self):
        self.expect_usage_error("smooth")
        self.expect_usage_error("smooth", "a.json", names=["--output"])
        self.expect_failure(1, "smooth", self.folder / "none.json", "-o", self.folder / "out", names=["none.json"])


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

    def test_calibration_leaves_a_camera_that_is_right(self):
        room = self.folder / "room"
        self.expect_ok("simulate", "room", "-o", room, "--views", 9, "--size", "160x120")
        placed = {}
        for name, options in (("plain", []), ("calibrated", ["--calibrate"])):
            self.expect_ok("register", room / "scene.json", "-o", self.folder / name, *options)
            views = json.loads((self.folder / name / "scene.json").read_text())["views"]
            placed[name] = [view["T_world_view"] for view in views]
        self.assertEqual(placed["plain"], placed["calibrated"])
        self.assertFalse((self.folder / "calibrated" / "range").exists())
        # Range images that are read are not written over.
        images = {file.parent for file in room.rglob("*") if file.suffix in (".exr", ".png")}
        self.assertIn(room / "range", images)
        self.expect_failure(1, "register", room / "scene.json", "-o", room / "again.json", "--calibrate",
                            names=["holds the range images"])

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
        self.expect_ok("integrate", save(f, write_wall_scene(f)), "-o", f / "wall.ply", "--reduce-sigma", 0)
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
        self.expect_usage_error("reduce", f / "a.ply", "-o", f / "out.3ds", names=["out.3ds"])
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
        for case in (Usage, Integrate, BadInput, Sew, Formats, NoisePlot, Smooth, Register, Instruments, Progress):
            for test in unittest.defaultTestLoader.getTestCaseNames(case):
                print(f"{case.__name__}.{test}")
    else:
        unittest.main()
