#!/usr/bin/env python3
"""The benchmarks' own arithmetic, and each script once on a tiny scene; standard library only.

bench_test.py --list prints the tests, bench_test.py Class.test runs one (LAPSEAM_BUILD names the folder of the programs)."""

import argparse
import importlib.util
import json
import os
import pathlib
import subprocess
import sys
import tempfile
import unittest
from importlib.machinery import SourceFileLoader

ROOT = pathlib.Path(__file__).resolve().parent.parent.parent
BENCH = ROOT / "bench"
BUILD = pathlib.Path(os.environ.get("LAPSEAM_BUILD", ROOT / "build/release"))
SYSTEM_PYTHON = "/usr/bin/python3"
sys.path.insert(0, str(BENCH))
sys.dont_write_bytecode = True

import figures  # noqa: E402
import harness  # noqa: E402
import scenes  # noqa: E402
import scorecard_bars  # noqa: E402


def script(name):
    """A script without an ending, as a module."""
    loader = SourceFileLoader(name, str(BENCH / name))
    module = importlib.util.module_from_spec(importlib.util.spec_from_loader(name, loader))
    loader.exec_module(module)
    return module


def has_module(name):
    return pathlib.Path(SYSTEM_PYTHON).exists() and \
        subprocess.run([SYSTEM_PYTHON, "-c", f"import {name}"], stderr=subprocess.DEVNULL).returncode == 0


def call(name, *arguments, python=sys.executable):
    return subprocess.run([python, "-B", str(BENCH / name), *map(str, arguments)], capture_output=True, text=True, timeout=240)


class Scorecard(unittest.TestCase):
    def setUp(self):
        self.scorecard = script("scorecard")
        self.at_most = scorecard_bars.Bar("i", ("s",), "what", "figure", "<=", 2)
        self.at_least = scorecard_bars.Bar("i", ("s",), "what", "figure", ">=", 2)

    def test_a_figure_at_its_bar_passes_and_one_beyond_misses(self):
        verdicts = [self.scorecard.verdict(bar, figure) for bar in (self.at_most, self.at_least) for figure in (1, 2, 3)]
        self.assertEqual(verdicts, ["pass", "pass", "miss", "miss", "pass", "pass"])

    def test_what_was_not_measured_never_passes(self):
        self.assertEqual(self.scorecard.verdict(self.at_most, None), "not measured")
        self.assertTrue(all(row["result"] == "not measured" for row in self.scorecard.rows_of({})))

    def test_a_figure_without_bar_is_reported(self):
        bar = scorecard_bars.Bar("i", ("s",), "what", "figure", "<=", None)
        self.assertEqual(self.scorecard.verdict(bar, 5), "reported")

    def test_no_bar_is_there_twice_and_each_has_a_figure(self):
        keys = [(bar.issue, scene, bar.what) for bar in scorecard_bars.BARS for scene in bar.scenes]
        self.assertEqual(len(keys), len(set(keys)))
        self.assertTrue(all(bar.figure for bar in scorecard_bars.BARS))

    def test_every_step_of_the_plan_exists_and_every_scene_is_known(self):
        for name, steps in scorecard_bars.PLAN.items():
            self.assertIn(name, scenes.SCENES)
            for step in steps:
                self.assertTrue(callable(getattr(self.scorecard.Bench, step)), step)

    def test_an_unknown_scene_is_a_wrong_use(self):
        with tempfile.TemporaryDirectory() as folder:
            self.assertEqual(call("scorecard", "--work", folder, "--only", "nowhere").returncode, 2)


class Figures(unittest.TestCase):
    def test_what_was_not_measured_has_no_figure(self):
        self.assertEqual(figures.figures_of({}), {})

    def test_share_of_self_intersections_and_steps_own_figures(self):
        measured = {"run": {"wall_s": 3, "peak_rss_bytes": 5e6}, "figures": {"threads_wall": 1.5},
                    "evaluation": {"mesh": {"self_intersecting_triangles": 1, "triangles": 200},
                                   "accuracy": {"bias_median_mm": -0.25},
                                   "distances": [{"at_mm": 5, "f_score_percent": 90, "completeness_percent": 80}]}}
        found = figures.figures_of(measured)
        self.assertEqual(found["self_intersecting_percent"], 0.5)
        self.assertEqual(found["f_score_5"], 90)
        self.assertEqual(found["bias_absolute_mm"], 0.25)
        self.assertEqual((found["peak_rss_mb"], found["wall_s"], found["threads_wall"]), (5, 3, 1.5))

    def test_components_are_held_against_the_pieces_that_views_saw(self):
        for components, pieces, more in ((2, 3, 0), (3, 1, 2)):
            measured = {"evaluation": {"mesh": {"self_intersecting_triangles": None, "triangles": 1,
                                                "components_99_percent_area": components},
                                       "completeness": {"seen_pieces": pieces}}}
            self.assertEqual(figures.figures_of(measured)["components_99_more_than_seen"], more)

    def test_beside_peers_the_best_of_them_counts_and_failed_ones_do_not(self):
        def result(wall_s, off, within):
            return {"median": {"wall_s": wall_s, "peak_rss_bytes": 100},
                    "figures": {"held_out_median_mm": off, "held_out_within_percent": within}}
        ours = result(4, 9, 70)
        found = figures.figures_beside_peers({"lapseam": ours, "tsdf20": result(8, 8, 75), "tsdf10": result(16, 7, 80)})
        self.assertEqual((found["wall_over_tsdf20"], found["wall_over_tsdf10"]), (0.5, 0.25))
        self.assertEqual((found["held_out_median_mm_over_tsdf"], found["held_out_within_percent_over_tsdf"]), (2, -10))
        self.assertEqual(figures.figures_beside_peers({"lapseam": ours, "tsdf20": {"failed": True}}), {})


class Harness(unittest.TestCase):
    def test_stages_of_a_name_add_up_and_their_peak_is_of_their_own_time(self):
        lines = [(1.0, '{"event":"begin","stage":"a","seconds":0}'), (2.0, '{"event":"end","stage":"a","seconds":1}'),
                 (3.0, '{"event":"end","stage":"b","seconds":1}'), (4.0, '{"event":"end","stage":"a","seconds":1}'),
                 (4.1, "talk")]
        samples = [(1.5, 10, 1), (2.5, 99, 1), (3.5, 20, 1)]
        stages = {s["name"]: s for s in harness.stages_of(lines, samples)}
        self.assertEqual((stages["a"]["seconds"], stages["a"]["peak_rss_bytes"]), (2, 20))
        self.assertEqual((stages["b"]["seconds"], stages["b"]["peak_rss_bytes"]), (1, 99))

    def test_cases_run_in_turn_and_one_that_fails_does_not_stop_the_others(self):
        order = []

        def measure(case):
            order.append(case)
            if case == "bad":
                raise harness.Failed("it")
            return len(order)
        results = harness.interleaved(["a", "bad", "b"], 2, measure)
        self.assertEqual(order, ["a", "bad", "b", "a", "b"])
        self.assertEqual(results, {"a": [1, 4], "bad": [], "b": [3, 5]})

    def test_a_run_that_was_broken_off_goes_on_where_it_was(self):
        with tempfile.TemporaryDirectory() as folder:
            journal = pathlib.Path(folder) / "runs"
            harness.add_to_journal(journal, ("room", 2), 10)
            harness.add_to_journal(journal, ("room", 1), None)  # failed
            made = []

            def measure(case):
                made.append(case)
                return len(made)
            results = harness.interleaved([("room", 1), ("room", 2)], 2, measure, journal)
            self.assertEqual(results, {("room", 1): [], ("room", 2): [10, 1]})
            self.assertEqual(harness.interleaved([("room", 1), ("room", 2)], 2, measure, journal), results)
            self.assertEqual(made, [("room", 2)])

    def test_cost_of_a_process_is_its_own(self):
        cost = harness.run(sys.executable, "-c", "x = bytearray(200_000_000)")
        self.assertGreater(cost["peak_rss_bytes"], 190e6)
        self.assertLess(harness.run("true")["peak_rss_bytes"], 100e6)

    def test_failure_and_timeout_are_told(self):
        with self.assertRaisesRegex(harness.Failed, "exit code 3"):
            harness.run(sys.executable, "-c", "import sys; sys.exit(3)")
        with self.assertRaisesRegex(harness.Failed, "took over"):
            harness.run("sleep", 20, timeout_s=0.2)


class Scenes(unittest.TestCase):
    def test_views_are_spread_evenly_or_the_first(self):
        self.assertEqual(scenes.picked(10, 4, "even"), [0, 2, 5, 7])
        self.assertEqual(scenes.picked(10, 4, "first"), [0, 1, 2, 3])
        self.assertEqual(scenes.picked(10, 10, "even"), list(range(10)))

    def test_part_of_a_scene_finds_its_files(self):
        with tempfile.TemporaryDirectory() as name:
            folder = pathlib.Path(name).resolve()
            sensor = {"model": "pinhole", "width": 8, "height": 6}
            views = [{"name": str(i), "sensor": "s", "range": {"file": f"range/{i}.png"}} for i in range(4)]
            (folder / "scene.json").write_text(json.dumps({"sensors": {"s": sensor}, "views": views}))
            part = scenes.part(folder / "scene.json", 2, "even", folder / "parts")
            found = [view["range"]["file"] for view in json.loads(part.read_text())["views"]]
            self.assertEqual(found, [str(folder / "range/0.png"), str(folder / "range/2.png")])
            self.assertEqual(scenes.pixel_count(part), 96)
            self.assertEqual(scenes.part(folder / "scene.json", 4, "even", folder), folder / "scene.json")
            with self.assertRaises(harness.Failed):
                scenes.part(folder / "scene.json", 5, "even", folder)


class Compare(unittest.TestCase):
    def run_of(self, wall_s, sew_s):
        return {"wall_s": wall_s, "cpu_s": 1.0, "peak_rss_bytes": 10, "stages": [{"name": "sew", "seconds": sew_s}]}

    def test_ratio_is_the_median_over_rounds(self):
        compare = script("compare")
        base = [self.run_of(1, 1), self.run_of(2, 1), self.run_of(4, 1)]  # the machine became slower
        head = [self.run_of(1.1, 2), self.run_of(2.2, 2), self.run_of(40, 9)]  # and something disturbed the last
        found = compare.ratios(base, head)
        self.assertAlmostEqual(found["wall"], 1.1)
        self.assertEqual((found["cpu"], found["memory"]), (1, 1))
        self.assertEqual(compare.stage_ratios(base, head), {"sew": 2})
        self.assertEqual(compare.verdict({"room": {"ratio": found}}, "wall", 1.05), ["room"])
        self.assertEqual(compare.verdict({"room": {"ratio": found}}, "wall", 1.2), [])


class OnATinyScene(unittest.TestCase):
    def test_end_to_end_and_its_pictures(self):
        with tempfile.TemporaryDirectory() as name:
            folder = pathlib.Path(name)
            done = call("end_to_end", "--scenes", "tiny", "--work", folder, "--build", BUILD, "--views", "3,6,100", "--threads",
                        "1,2", "--repeat", 2, "--json", folder / "result.json")
            self.assertEqual(done.returncode, 0, done.stderr)
            result = json.loads((folder / "result.json").read_text())
            self.assertEqual([(r["views"], r["threads"]) for r in result["results"]], [(3, 1), (3, 2), (6, 1), (6, 2)])
            self.assertEqual(result["problems"], [])
            self.assertTrue(result["commit"] and result["machine"]["processors"] and result["date"])
            for r in result["results"]:
                self.assertEqual(r["pixels"], r["views"] * 64 * 48)
                self.assertEqual(r["runs"], 2)
                self.assertIn("sew", [stage["name"] for stage in r["stages"]])
                # The scene's noise is 1.9 mm where the sphere is, and its views hardly overlap.
                self.assertLess(r["figures"]["accuracy_median_mm"], 4)
            if not has_module("matplotlib"):
                self.skipTest("no matplotlib: pictures not drawn")
            drawn = call("plot_end_to_end", folder / "result.json", "-o", folder / "pictures", python=SYSTEM_PYTHON)
            self.assertEqual(drawn.returncode, 0, drawn.stderr)
            self.assertEqual({p.name for p in (folder / "pictures").iterdir()}, {"views.svg", "stages.svg", "threads.svg"})

    def test_memory_profile(self):
        with tempfile.TemporaryDirectory() as name:
            folder = pathlib.Path(name)
            picture = ["--picture", folder / "p.svg"] if has_module("matplotlib") else []
            done = call("memory_profile", "--scenes", "tiny", "--work", folder, "--build", BUILD, "--period", 0.002, "--json",
                        folder / "result.json", *picture)
            self.assertEqual(done.returncode, 0, done.stderr)
            profile = json.loads((folder / "result.json").read_text())["profiles"][0]
            times = [sample[0] for sample in profile["samples"]]
            self.assertGreater(len(times), 3)
            self.assertEqual(times, sorted(times))
            # The kernel's counters lag behind each other by some pages per thread.
            self.assertLessEqual(max(sample[1] for sample in profile["samples"]), profile["peak_rss_bytes"] + 4e6)
            if picture:
                self.assertIn("<svg", picture[1].read_text())

    def test_steps_of_the_scorecard(self):
        scorecard = script("scorecard")
        name = "tiny_in_color"
        scenes.SCENES[name] = scenes.Scene("simulate", "sphere", ("--trajectory", "axes", "--views", "6", "--size", "64x48",
                                                                  "--fov", "40"), hold_out=3)
        with tempfile.TemporaryDirectory() as folder:
            arguments = argparse.Namespace(build=BUILD, data=pathlib.Path("nowhere"), work=pathlib.Path(folder), reuse=False,
                                           repeat=1, no_texture=False)
            bench = scorecard.Bench(arguments)
            scorecard.PLAN[name] = ("mesh", "held_out", "threads", "growth", "texture", "texture_steps", "panoramas")
            try:
                found = figures.figures_of(bench.measure(name))
            finally:
                del scorecard.PLAN[name], scenes.SCENES[name]
        for figure in ("wall_s", "peak_rss_mb", "nonmanifold", "f_score_5", "bias_absolute_mm", "held_out_median_mm",
                       "held_out_nonmanifold", "threads_wall", "growth_wall", "growth_cpu", "growth_peak", "psnr_db",
                       "psnr_plain_db", "texture_over_integration", "atlas_fill_percent", "texture_scale", "texture_peak_mb"):
            self.assertIsInstance(found[figure], (int, float), figure)

    def test_peers_lapseam_alone(self):
        with tempfile.TemporaryDirectory() as name:
            folder = pathlib.Path(name)
            done = call("peers", "--scenes", "tiny", "--programs", "lapseam", "--repeat", 1, "--work", folder, "--build", BUILD,
                        "--json", folder / "result.json")
            self.assertEqual(done.returncode, 0, done.stderr)
            ours = json.loads((folder / "result.json").read_text())["scenes"]["tiny"]["lapseam"]
            self.assertGreater(ours["figures"]["triangles"], 1000)
            self.assertIn("| lapseam |", done.stdout)

    def test_cube_faces_show_the_same_room(self):
        if not has_module("open3d"):
            self.skipTest("no open3d")
        with tempfile.TemporaryDirectory() as name:
            folder = pathlib.Path(name)
            tool = BUILD / "lapseam"
            harness.run(tool, "simulate", "room", "-o", folder / "room", "--sensor", "laser", "--views", 1, "--size", "256x128",
                        "--format", "png", "--no-color", "--noise", 0)
            cut = call("cube_faces", folder / "room/scene.json", "-o", folder / "faces", python=SYSTEM_PYTHON)
            self.assertEqual(cut.returncode, 0, cut.stderr)
            harness.run(tool, "integrate", folder / "faces/scene.json", "-o", folder / "faces.ply", "--no-texture")
            harness.run(tool, "evaluate", folder / "faces.ply", folder / "room/truth/mesh.ply", "--json", folder / "f.json",
                        "--no-self-intersections")
            accuracy = json.loads((folder / "f.json").read_text())["accuracy"]
            # A sample every 1.4 degrees is 4 cm apart at 1.5 m: half of that aside, its range is off by that times the slope
            # of the surface, which is mostly below a half. A face turned or mirrored would be off by decimetres.
            self.assertLess(accuracy["median_mm"], 15)


if __name__ == "__main__":
    if sys.argv[1:] == ["--list"]:
        for case in unittest.defaultTestLoader.loadTestsFromModule(sys.modules[__name__]):
            for test in case:
                print(test.id().removeprefix("__main__."))
    else:
        unittest.main()
