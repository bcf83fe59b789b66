# SPDX-License-Identifier: GPL-3.0-or-later
"""The benchmark of sleep: what it measures is right on heaps and numbers that are known, and a small run of it tells all."""
import json
import math
import os
import shutil
import subprocess
import sys

import h5py
import numpy as np

from talus_tools import BIN, DONE, HELENS, ROOT, USAGE, Result, ToolTest, main, words, write_model

sys.path.insert(0, str(ROOT / "pipelines" / "bench"))
sys.dont_write_bytecode = True
import sleep_crater  # noqa: E402
import sleep_heap  # noqa: E402
import sleep_report  # noqa: E402
import sleep_repose  # noqa: E402
import sleep_slide  # noqa: E402


class Measures(ToolTest):
    def heap(self, degrees, height=0.3):
        """Grains on a lattice below a roof of that slope, periodic in y."""
        step, half = sleep_heap.DIAMETER, height / math.tan(math.radians(degrees))
        x, y, z = np.meshgrid(np.arange(-half, half, step / 3), np.arange(step / 2, sleep_heap.DEPTH, step),
                              np.arange(0, height, step / 3), indexing="ij")
        position = np.stack([x.ravel(), y.ravel(), z.ravel()], axis=1)
        inside = position[:, 2] + sleep_heap.RADIUS < height - np.abs(position[:, 0]) * math.tan(math.radians(degrees))
        return position[inside]

    def test_angle_of_a_known_heap(self):
        for degrees in (15, 22, 35):
            position = self.heap(degrees)
            got = sleep_heap.measure(position, np.full(len(position), sleep_heap.RADIUS), 1.0)
            self.assertAlmostEqual(got["angle"], degrees, delta=0.6)
            self.assertAlmostEqual(got["runout"] * sleep_heap.DIAMETER,
                                   np.quantile(np.abs(position[:, 0]), 0.99), delta=1e-9)
            self.assertEqual(got["left_in_funnel"], 0)
        high = position + [0, 0, 2]  # still in the funnel: not part of the heap
        both = np.concatenate([position, high[:7]])
        again = sleep_heap.measure(both, np.full(len(both), sleep_heap.RADIUS), 1.0)
        self.assertEqual((again["angle"], again["left_in_funnel"]), (got["angle"], 7))

    def test_angle_and_rest_of_a_known_crater(self):
        crater = sleep_crater.Crater(4000)
        step = sleep_crater.DIAMETER
        x, y, z = np.meshgrid(np.arange(step / 2, crater.length, step / 3), np.arange(step / 2, sleep_crater.DEPTH, step),
                              np.arange(0, crater.height, step / 3), indexing="ij")
        position = np.stack([x.ravel(), y.ravel(), z.ravel()], axis=1)
        stays = position[:, 2] + sleep_crater.RADIUS < (position[:, 0] - sleep_crater.SLOT) * math.tan(math.radians(28))
        position[~stays, 2] -= sleep_crater.DROP  # in the pit
        got = crater.measure(position, np.full(len(position), sleep_crater.RADIUS))
        self.assertAlmostEqual(got["angle"], 28, delta=0.8)
        self.assertAlmostEqual(got["left"], 100 * stays.mean(), places=9)

    def test_only_the_gate_opens(self):
        crater = sleep_crater.Crater(1000)
        fixed, gate = sleep_crater.fixed_grains(1000)
        self.assertTrue(np.all((fixed[gate, 0] > 0) & (fixed[gate, 0] < sleep_crater.SLOT)))
        self.assertEqual(gate.sum(), round(sleep_crater.SLOT * sleep_crater.DEPTH / sleep_crater.DIAMETER**2))
        base = np.abs(fixed[:, 2] + sleep_crater.RADIUS) < 0.4 * sleep_crater.RADIUS
        self.assertAlmostEqual(fixed[base & ~gate, 0].max(), crater.length, delta=1.1 * sleep_crater.DIAMETER)

    def test_poured_grains_start_apart_and_above_the_base(self):
        model = sleep_heap.pour(600, 1)
        free = model.species == 0
        self.assertEqual(free.sum(), 600)
        gaps = np.linalg.norm(model.position[free][:, None] - model.position[None], axis=2) - \
            model.radius[free][:, None] - model.radius[None]
        gaps[np.flatnonzero(free), np.flatnonzero(free)] = 1
        self.assertGreater(gaps.min(), 0)
        self.assertGreater(model.position[free, 2].min(), sleep_heap.outlet_of(600))
        other = sleep_heap.pour(600, 2)
        self.assertFalse(np.array_equal(model.radius, other.radius))
        np.testing.assert_array_equal(model.position[~free], other.position[other.species == 1])

    def test_differences_in_standard_errors(self):
        def rows(*angles):
            return [{"tolerance": t, "audit": None, "runs": [
                {"seed": k, "angle": a, "runout": 30 + k, "wall_time": 4 / (1 + t), "processor_time": 4, "asleep_fraction": t,
                 "sleep_error": t} for k, a in enumerate(values)]} for t, values in zip((0, 1), angles)]

        quantities = {"angle": "degrees", "runout": "d"}
        got = sleep_repose.summary(rows((20, 21, 22), (21, 22, 23)), quantities)
        self.assertAlmostEqual(got[1]["angle"]["difference"], 1)
        self.assertAlmostEqual(got[1]["angle"]["standard_error"], math.sqrt(2 / 3))
        self.assertAlmostEqual(got[1]["angle"]["in_standard_errors"], 1 / math.sqrt(2 / 3))
        self.assertEqual((got[0]["angle"]["difference"], got[1]["runout"]["difference"]), (0, 0))
        self.assertAlmostEqual(got[1]["speed_up_wall_time"], 2)
        self.assertIn("tolerance 1.", sleep_report.verdict_of_repose({"rows": got, "quantities": quantities}))
        biased = sleep_repose.summary(rows((20, 21, 22), (24, 25, 26)), quantities)
        self.assertIn("tolerance none.", sleep_report.verdict_of_repose({"rows": biased, "quantities": quantities}))

    def test_perturbation(self):
        position = np.random.default_rng(1).uniform(1, 500, (50, 3))
        write_model(self.folder / "a.h5", position, np.ones(50))
        sleep_slide.perturbed(self.folder / "a.h5", self.folder / "b.h5", 1)
        with h5py.File(self.folder / "b.h5", "r") as file:
            off = np.abs(file["particles/all/position"][:] / position - 1)
        self.assertGreater(off.min(), 0)
        self.assertLess(off.max(), 1.01 * sleep_slide.PERTURBATION)

    def test_spread_and_what_lies_outside(self):
        def run(moved, travel, **more):
            return {**dict.fromkeys(sleep_slide.MEASURES, 5.0), "moved_volume": moved, "travel": travel, "wall_time": 2,
                    "processor_time": 2, **more}

        awake = [run(10, [0.5, 0.5]), run(12, [0.4, 0.6])]
        slept = [run(12.5, [0.5, 0.5], tolerance=0.1), run(15, [0.1, 0.5, 0.4], tolerance=0.2)]
        got = sleep_slide.judged(awake, slept)
        self.assertEqual(got["spread"]["moved_volume"], 2)
        self.assertAlmostEqual(got["spread"]["travel"], 0.1)
        self.assertAlmostEqual(slept[0]["differences"]["moved_volume"], 1.5)
        self.assertAlmostEqual(slept[0]["differences"]["travel"], 0.05)
        self.assertTrue(all(slept[0]["within_spread"].values()))
        self.assertEqual([name for name, inside in slept[1]["within_spread"].items() if not inside],
                         ["moved_volume", "travel"])
        # |x - mean of two| > their distance: two normals of variances 3/2 and 2
        self.assertAlmostEqual(got["outside_by_chance"], 2 / math.pi * math.atan(math.sqrt(0.75)), delta=0.005)


class SmallRun(ToolTest):
    def bench(self, *args, code=DONE):
        command = [sys.executable, str(ROOT / "pipelines" / "bench" / "sleep"), "--bin", str(BIN), "--out", "out", *words(*args)]
        got = Result(subprocess.run(command, cwd=self.folder, capture_output=True, text=True, timeout=400,
                                    env={**os.environ, "TALUS_CACHE": str(self.folder / "cache")}))
        self.assertEqual(got.code, code, str(got))
        return got

    def test_bad_options(self):
        self.assertIn("references", self.bench("--references", 1, code=USAGE).err)

    def test_heap_and_slide(self):
        parts = ["heap", "crater"] + (["st-helens"] if HELENS.exists() else [])
        got = self.bench("--only", *parts, "--grains", 1200, "--seeds", 2, "--tolerances", 0.1, "--references", 2, "--radius", 3)
        results = json.loads((self.folder / "out" / "sleep.json").read_text())
        self.assertEqual(results["schema"], "bench-sleep")
        self.assertEqual([scene["name"] for scene in results["repose"]], ["heap", "crater"])
        for scene in results["repose"]:
            awake, slept = scene["rows"]
            self.assertEqual((awake["tolerance"], awake["asleep_fraction"], len(awake["runs"])), (0, 0, 2))
            self.assertGreater(slept["asleep_fraction_at_end"], 0.5)
            self.assertGreater(slept["sleep_error"], 0)
            self.assertIn("wrong_fraction", slept["audit"]["sleep_audit"])
            for row in (awake, slept):
                self.assertTrue(8 < row["angle"]["mean"] < 45, row["angle"])
                for run in row["runs"]:
                    self.assertLess(run.get("left_in_funnel", 0), 25)
                    self.assertTrue(20 < run.get("left", 50) < 80, run.get("left"))
                    self.assertLess(run["rms_speed"], 0.1)
            self.assertIn(f"## {scene['title']}", got.out)
        if "st-helens" in parts:
            slide = results["slides"][0]
            self.assertEqual([run["tolerance"] for run in slide["runs"]], [0.1])
            self.assertGreater(slide["runs"][0]["asleep_fraction"], 0)
            self.assertGreater(slide["spread"]["center_of_mass_travel"], 0)
            self.assertLess(slide["runs"][0]["differences"]["travel"], 1)
            self.assertAlmostEqual(sum(slide["references"][0]["travel"]), slide["mobile"] / slide["released"], places=6)
        files = set(self.files(self.folder / "out"))
        self.assertLessEqual({"sleep.json", "sleep.md"}, files)
        if shutil.which("gnuplot"):  # a difference of nothing has no place on a logarithmic axis
            self.assertIn("heap_estimates.svg", files)


if __name__ == "__main__":
    main()
