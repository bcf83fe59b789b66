# SPDX-License-Identifier: GPL-3.0-or-later
"""dem-run: shaking, strength that goes down, masses released one after the other; output of what moved only,
surface labels, travel distances added up in the run."""
import json
import signal
import subprocess
import time

import h5py
import numpy as np

from rank_runs import RankRuns, mpirun
from scenes import Scenes
from talus_tools import BIN, CONFIGURATION, INPUT, STOPPED, main, write_model

RADIUS, DENSITY, GRAVITY = 0.01, 1000.0, 9.81
MASS = 4 / 3 * np.pi * RADIUS**3 * DENSITY


class Triggers(Scenes):
    tool = "dem-run"

    def test_free_grain_stays_behind_and_the_result_names_the_frame(self):
        write_model(self.folder / "one.h5", [[0, 0, 0]], [RADIUS])
        self.write("quake.csv", "# a record\ntime [ms],ay,ax (g),note\n0,0,0,a\n10,0,0.1,b\n20,0,0.1,c\n")
        scene = {"gravity": [0, 0, 0], "shaking": {"file": "quake.csv", "stage": "quake", "start": "10ms", "scale": 2},
                 "output": {"float64": True, "series_interval": "1ms"}, "time": {"step": "10us"},
                 "stages": [{"name": "before", "end": "20ms"}, {"name": "quake", "end": "50ms"}]}
        self.write("scene.json", scene)
        result = self.ok("dem-run", "one.h5", "-c", "scene.json", "-o", "run.h5", "--format", "json", "-q").json
        shaking = result["shaking"]
        self.assertEqual(shaking["frame_of_reference"], "ground")
        a = 0.2 * 9.80665
        speed, way = a * 0.015, a * (0.01**2 / 6 + 0.005 * 0.01 + 0.01**2 / 2)
        self.assertAlmostEqual(shaking["peak_acceleration"], a, 12)
        np.testing.assert_allclose(shaking["residual_velocity"], [speed, 0, 0], 1e-12)
        np.testing.assert_allclose(shaking["residual_displacement"], [way, 0, 0], 1e-12)
        with h5py.File(self.folder / "run.h5", "r") as file:
            end = file["particles/all/position/value"][-1, 0]
            ground = file["granular/series/ground/displacement_x"][-1]
            supplied = file["granular/series/supplied_energy"][-1]
        np.testing.assert_allclose(end, [-way - speed * 0.02, 0, 0], rtol=1e-3, atol=1e-12)
        self.assertAlmostEqual(end[0], -ground, 6)  # the record ends with a jump
        self.assertAlmostEqual(supplied / (0.5 * MASS * speed**2), 1, 2)
        self.assertLess(result["energy_error"], 1e-3)

    def test_bad_records_and_keys_are_named(self):
        write_model(self.folder / "one.h5", [[0, 0, 0]], [RADIUS])
        base = {"time": {"end": "1ms"}, "shaking": {"file": "quake.csv"}}
        self.write("scene.json", base)
        run = ("dem-run", "one.h5", "-c", "scene.json", "-o", "run.h5", "-q")
        for text, name in (("time,ax\n0,1\n0,2\n", "must rise"), ("time,ax\n0,1\n", "samples"),
                           ("time,a\n0,1\n1,1\n", 'no column "ax"'), ("time,ax [ft/s2]\n0,1\n1,1\n", "ft/s2"),
                           ("time,ax\n0,1\n1,nan\n", "expected a number")):
            self.write("quake.csv", text)
            self.fails(INPUT, *run, names=("quake.csv", name))
        for change, name in (({"shaking": {}}, "/shaking"), ({"shaking": {"file": "a", "stage": "x"}}, "stage"),
                             ({"strength_reduction": [{"times": [0, 1], "factors": [1]}]}, "times"),
                             ({"strength_reduction": [{"times": [1, 0], "factors": [1, 1]}]}, "times"),
                             ({"strength_reduction": [{"times": [0], "factors": [1.5]}]}, "factors"),
                             ({"strength_reduction": [{"times": [0], "factors": [1], "of": ["glue"]}]}, "glue"),
                             ({"output": {"change_tolerance": 1}}, "change_tolerance")):
            self.write("bad.json", {**base, **change})
            got = self.run_tool("dem-run", "one.h5", "-c", "bad.json", "-o", "run.h5", "-q")
            self.assertEqual(got.code, CONFIGURATION, str(got))
            self.assertIn(name, got.err)
            self.assertIn("expected", got.err)
        self.assertNotIn("run.h5", self.files())

    def hanging(self, pairs):
        """Grains that hang on fixed ones by bonds, side by side."""
        x = [[0.1 * k, 0, -2 * RADIUS * n] for k in range(pairs) for n in (0, 1)]
        write_model(self.folder / "hang.h5", x, [RADIUS] * len(x), species=np.array([1, 0] * pairs, "u1"))
        return {"bond": {"bond_pressure": 4 * MASS * GRAVITY / (np.pi * RADIUS**2), "bond_friction": 10},
                "stress_free_start": True, "damping": {"viscous": 200}}

    def test_strength_goes_down_within_a_region_only(self):
        scene = self.hanging(3)
        self.write("region.json", json.dumps({"type": "Polygon", "crs": {
            "type": "name", "properties": {"name": "urn:ogc:def:crs:EPSG::32610"}}, "coordinates": [
            [[-0.05, -1], [0.05, -1], [0.05, 1], [-0.05, 1], [-0.05, -1]]]}))
        scene |= {"time": {"end": "0.3s"}, "strength_reduction": [
            {"times": ["50ms", "250ms"], "factors": [1, 0.1], "of": ["bond"], "region": {"outline": "region.json"}},
            {"times": [0, "250ms"], "factors": [1, 0.1], "of": ["bond"], "region": {"lower": [0.15, -1, -1]}}]}
        self.write("scene.json", scene)
        result = self.ok("dem-run", "hang.h5", "-c", "scene.json", "-o", "run.h5", "--format", "json", "-q").json
        self.assertEqual(result["bonds"], 1)
        with h5py.File(self.folder / "run.h5", "r") as file:
            pair, when = file["granular/bond_breakages/pair"][:], file["granular/bond_breakages/time"][:]
            self.assertNotIn("material", file["particles/all"])  # the model's has none
        self.assertEqual(pair.tolist(), [[4, 5], [0, 1]])
        np.testing.assert_allclose(when, [0.25 * 0.75 / 0.9, 0.05 + 0.2 * 0.75 / 0.9], atol=3e-3)

    def test_two_source_areas_at_different_times(self):
        x = [[2 * RADIUS * k, 0, 0] for k in range(7)]
        for release, expected in ((None, None), (np.array([0, 1, 1, 0, 1, 1, 0], "u1"), None)):
            columns = {} if release is None else {"release": release}
            write_model(self.folder / "row.h5", x, [RADIUS] * 7, species=np.array([1, 0, 0, 1, 0, 0, 1], "u1"), **columns)
            scene = {"gravity": [0, 0, 0], "bond": {"bond_pressure": "1kPa"}, "stress_free_start": True, "stages": [
                {"name": "first", "end": "1ms", "release": True, "release_area": {"upper": [0.05, 1, 1]}},
                {"name": "second", "end": "1ms", "release": True,
                 "release_area": {"lower": [0.05, -1, -1], "upper": [1, 1, 1]}}]}
            self.write("scene.json", scene)
            result = self.ok("dem-run", "row.h5", "-c", "scene.json", "-o", "run.h5", "--overwrite", "--format", "json",
                             "-q").json
            self.assertEqual(result["bonds_released"], 4)
            with h5py.File(self.folder / "run.h5", "r") as file:
                pair, step = file["granular/bond_breakages/pair"][:], file["granular/bond_breakages/step"][:]
                self.assertEqual(file["particles/all/release"][:].tolist(), [0, 1, 1, 0, 1, 1, 0])
                second = file["granular/stages/0001"].attrs["step"]
            self.assertEqual(pair.tolist(), [[0, 1], [2, 3], [3, 4], [5, 6]])
            self.assertEqual(step.tolist(), [0, 0, second, second])


class Output(RankRuns):
    tool = "dem-run"
    more = ["--output.changed_only", "--output.change_tolerance", "5mm", "--output.surface_labels",
            "--output.travel_interval", "25ms", "--output.travel_interval_fine", "5ms", "--output.travel_from", "slide"]

    def prepare(self):
        self.ok("pgbox-gen", "--radius", 0.09, "-o", "box.h5")
        self.ok("tile-trim", "box.h5", "--cuboid", "1.3,1.3,1.3", "--explicit", "-o", "model.h5")
        self.write("quake.csv", "time,ax,az\n0,0,0\n0.05,4,1\n0.1,-4,0\n0.15,3,-1\n0.2,0,0\n")
        scene = {
            "material": {"friction": 0.4}, "bond": {"bond_pressure": "500Pa", "bond_friction": 1},
            "stress_free_start": True, "time": {"step": "20us"},
            "walls": [{"name": "floor", "plane": {"point": [0, 0, -0.02], "normal": [0, 0, 1]}}],
            "shaking": {"file": "quake.csv", "start": "30ms"},
            "strength_reduction": [{"times": [0, "200ms"], "factors": [1, 0.2], "stage": "slide",
                                    "region": {"lower": [0.3, 0, 0]}}],
            "output": {"frame_interval": "25ms", "series_interval": "10ms"},
            "stages": [{"name": "fall", "end": 0.1}, {"name": "slide", "end": 0.3}]}
        self.write("scene.json", scene)

    def run_scene(self, output, *more, **options):
        return self.ok("dem-run", "model.h5", "-c", "scene.json", "-q", "-o", output, *more, **options)

    def frames(self, path):
        """Step, time and position of all frames, put together as a reader has to."""
        with h5py.File(self.folder / path, "r") as file:
            group = file["particles/all/position"]
            frames = [(int(s), float(t), 1, x) for s, t, x in zip(group["step"], group["time"], group["value"])]
            for name, change in file.get("granular/changes", {}).items():
                rows = (change["particle"][:], change["position"][:]) if change.attrs["count"] else None
                frames.append((int(change.attrs["step"]), float(change.attrs["time"]), 0, rows))
        frames.sort(key=lambda f: f[:3])
        full, now = [], None
        for step, when, whole, data in frames:
            if whole:
                now = data.copy()
            elif data is not None:
                now = now.copy()
                now[data[0]] = data[1]
            full.append((step, when, now))
        return full

    def test_changed_only_is_within_its_tolerance_and_smaller(self):
        self.run_scene("whole.h5")
        self.run_scene("part.h5", *self.more)
        whole, part = self.frames("whole.h5"), self.frames("part.h5")
        self.assertEqual([f[:2] for f in whole], [f[:2] for f in part])
        for (_, _, a), (_, _, b) in zip(whole, part):
            self.assertLess(np.linalg.norm(a - b, axis=1).max(), 5e-3 + 1e-6)
        self.assertEqual(whole[-1][2].tobytes(), part[-1][2].tobytes())
        with h5py.File(self.folder / "part.h5", "r") as file:
            self.assertEqual(len(file["particles/all/position/step"]), 3)  # starts of the stages, and the end
            counts = [c.attrs["count"] for c in file["granular/changes"].values()]
            n = len(file["particles/all/radius"])
        self.assertLess(min(counts), n)
        self.assertGreater(max(counts), 0)
        # The tool's own reader, and its copy with full frames.
        self.ok("runout-analyse", "part.h5", "--full-frames", "full.h5", "--from", "start", "-q")
        full = self.frames("full.h5")
        for (_, _, a), (_, _, b) in zip(full, part):
            self.assertEqual(a.tobytes(), b.tobytes())
        with h5py.File(self.folder / "full.h5", "r") as file, h5py.File(self.folder / "part.h5", "r") as old:
            self.assertNotIn("granular/changes", file)
            for name in ("initial_depth", "surface", "travel_distance", "radius"):
                self.assertEqual(file["particles/all"][name][:].tobytes(), old["particles/all"][name][:].tobytes())
            self.assertEqual(file["granular/series/time"][:].tobytes(), old["granular/series/time"][:].tobytes())

    def test_travel_distance_is_that_of_the_frames(self):
        self.run_scene("run.h5", *self.more[3:], "--output.float64")
        with h5py.File(self.folder / "run.h5", "r") as file:
            group = file["particles/all"]
            start = file["granular/stages/0001"].attrs["step"]
            x = group["position/value"][:][group["position/step"][:] >= start]
            travel, fine = group["travel_distance"][:], group["travel_distance_fine"][:]
            self.assertEqual(group["travel_distance"].attrs["from_step"][0], start)
            self.assertEqual(group["travel_distance_fine"].attrs["interval"][0], 0.005)
        ways = np.linalg.norm(np.diff(x, axis=0), axis=2).sum(axis=0)
        np.testing.assert_allclose(travel, ways, rtol=1e-9, atol=1e-12)
        self.assertTrue((fine >= travel - 1e-12).all())
        self.assertGreater(fine.max(), travel.max())
        # Without frames runout-analyse takes it from there.
        self.run_scene("bare.h5", *self.more[3:], "--output.frame_interval", 0, "--output.float64")
        with_frames = self.ok("runout-analyse", "run.h5", "--format", "json", "-q").json
        without = self.ok("runout-analyse", "bare.h5", "--format", "json", "-q").json
        self.assertAlmostEqual(without["max_travel_distance"][-1], with_frames["max_travel_distance"][-1], 9)
        self.assertEqual(without["travel_source"], "the run, every 0.025 s")

    def test_surface_labels(self):
        self.run_scene("run.h5", "--output.surface_labels", "--output.frame_interval", 0)
        with h5py.File(self.folder / "run.h5", "r") as file:
            group = file["particles/all"]
            x, r = group["position/value"][0], group["radius"][:]
            inner = (np.abs(x[:, :2] - x[:, :2].mean(axis=0)) < 0.45).all(axis=1)  # no holes at the border
            z, r = x[inner, 2], r[inner]
            depth, surface = group["initial_depth"][inner], group["surface"][inner]
        top = (z + r).max()
        self.assertTrue((depth >= 0).all())
        deep = z < top - 6 * r
        self.assertFalse(surface[deep].any())
        np.testing.assert_allclose(depth[deep], top - z[deep] - r[deep], atol=3 * r[0])
        self.assertGreater(surface.sum(), 0.5 * 0.9**2 / (2 * r[0])**2)

    def test_stopped_anywhere_it_goes_on_as_if_nothing_had_been(self):
        self.run_scene("whole.h5", *self.more, "-j", 1)
        for part in (0.2, 0.55, 0.8):
            steps = int(part * 0.4 / 20e-6)
            process = subprocess.Popen([str(w) for w in (BIN / "dem-run", "model.h5", "-c", "scene.json", "-q", "-j", 1,
                                                         "-o", "run.h5", "--progress", "none", *self.more)],
                                       cwd=self.folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
            last = -1
            for _ in range(4000):
                if process.poll() is not None:
                    break
                try:
                    with h5py.File(self.folder / "run.h5.part", "r") as file:
                        last = max([c.attrs["step"] for c in file["granular/changes"].values()])
                except (OSError, KeyError, RuntimeError, ValueError, AttributeError):  # being written
                    pass
                if last >= 0.8 * steps:
                    break
                time.sleep(0.005)
            process.send_signal(signal.SIGTERM)
            process.communicate()
            self.assertEqual(process.returncode, STOPPED, "ended before it could be stopped")
            self.run_scene("run.h5", *self.more, "--resume", "auto", "-j", 2)
            self.assertSamePhysics("run.h5", "whole.h5")
            (self.folder / "run.h5").unlink()

    def test_ranks_give_the_same_file(self):
        self.run_scene("one.h5", *self.more)
        self.run_scene("two.h5", *self.more, "-j", 1, wrapper=mpirun(2))
        self.assertSamePhysics("one.h5", "two.h5")


if __name__ == "__main__":
    main()
