# SPDX-License-Identifier: GPL-3.0-or-later
"""The slope of the paper's size and what is made of it: its surfaces, cut and run at a coarse size, the settling's report, the
table of sizes, the job script, and pictures of models and trajectories that are known pixel by pixel."""
import csv
import importlib.machinery
import importlib.util
import json
import math
import os
import pathlib
import shutil
import signal
import subprocess
import sys
import tempfile
import time

import h5py
import numpy as np

from rasters import read_raster
from talus_tools import BIN, DONE, EXISTS, INPUT, ROOT, STOPPED, USAGE, Result, ToolTest, main, words, write_model

PIPELINES = ROOT / "pipelines"


def script(name):
    """A pipeline as a module."""
    loader = importlib.machinery.SourceFileLoader(name.replace("-", "_"), str(PIPELINES / name))
    module = importlib.util.module_from_spec(importlib.util.spec_from_loader(loader.name, loader))
    sys.dont_write_bytecode = True
    loader.exec_module(module)
    return module


class ScriptTest(ToolTest):
    script = None

    def pipeline(self, *args, code=DONE, name=None, **options):
        command = [sys.executable, str(PIPELINES / (name or self.script)), *words(*args)]
        got = Result(subprocess.run(command, cwd=self.folder, capture_output=True, text=True, timeout=120, **options))
        self.assertEqual(got.code, code, str(got))
        if code != DONE:
            self.assertEqual(len(got.err.splitlines()), 1, str(got))
            self.assertTrue(got.err.startswith(f"{name or self.script}: error: "), str(got))
        return got

    def says_what_it_does(self):
        got = self.pipeline("--help")
        self.assertIn("usage:", got.out)
        self.assertIn("-o", got.out)


class PaperSlope(ScriptTest):
    script = "paper-slope"

    def made(self, *args):
        self.pipeline("-o", "slope", *args)
        pre, corner, cell = read_raster(self.folder / "slope" / "pre.asc")
        post, *grid = read_raster(self.folder / "slope" / "post.asc")
        self.assertEqual((list(corner), cell), (list(grid[0]), grid[1]))
        return np.array(pre), np.array(post), corner, cell

    def test_help(self):
        self.says_what_it_does()

    def test_published_dimensions(self):
        pre, post, corner, cell = self.made()
        rows, columns = pre.shape
        self.assertEqual((columns * cell, rows * cell), (800 + 2 * cell, 500 + 2 * cell))
        depth = pre - post
        self.assertAlmostEqual(depth.sum() * cell * cell / 2e6, 1, delta=0.003)
        across, along = np.flatnonzero(depth.max(axis=1) > 0), np.flatnonzero(depth.max(axis=0) > 0)
        self.assertAlmostEqual((along[-1] - along[0] + 1) * cell, 705, delta=2 * cell)
        self.assertAlmostEqual((across[-1] - across[0] + 1) * cell, 195, delta=2 * cell)
        self.assertGreaterEqual(depth.min(), 0)
        # From the crest to the foot, half a cell outside of the domain at both ends.
        self.assertAlmostEqual((pre[0, 0] + pre[0, 1]) / 2 - (pre[0, -1] + pre[0, -2]) / 2, 600, delta=0.1)
        slope = -np.diff(pre[0]) / cell
        self.assertTrue(np.all(np.diff(slope) < 1e-3), "flatter and flatter towards the foot")
        figures = json.loads((self.folder / "slope" / "slope.json").read_text())
        self.assertAlmostEqual(math.degrees(math.atan(slope[0])), figures["steepest_degrees"], delta=0.3)
        self.assertAlmostEqual(depth.max(), figures["source_depth_max"], delta=0.01)

    def test_source_and_systems(self):
        self.made("--easting", 1000, "--northing", 5000, "--source-top", 40)
        source = json.loads((self.folder / "slope" / "source_area.geojson").read_text())
        ring = np.array(source["features"][0]["geometry"]["coordinates"][0])
        x, y = ring.T
        area = 0.5 * abs(np.dot(x[:-1], y[1:]) - np.dot(y[:-1], x[1:]))
        self.assertAlmostEqual(area / (math.pi / 4 * 705 * 195), 1, delta=1e-4)
        self.assertAlmostEqual(x.min(), 1040, delta=0.2)
        self.assertAlmostEqual((y.min() + y.max()) / 2, 5250, delta=1e-3)
        self.assertIn("32654", source["crs"]["properties"]["name"])
        for name in ("pre.prj", "post.prj"):
            self.assertIn("UTM_Zone_54N", (self.folder / "slope" / name).read_text())

    def test_same_bytes_and_no_overwriting(self):
        self.pipeline("-o", "a")
        self.pipeline("-o", "b")
        names = self.files(self.folder / "a")
        self.assertEqual(len(names), 7)
        for name in names:
            self.assertEqual((self.folder / "a" / name).read_bytes(), (self.folder / "b" / name).read_bytes(), name)
        self.assertIn("--overwrite", self.pipeline("-o", "a", code=EXISTS).err)
        self.pipeline("-o", "a", "--overwrite", "--concavity", 0)
        self.assertNotEqual((self.folder / "a" / "pre.asc").read_bytes(), (self.folder / "b" / "pre.asc").read_bytes())

    def test_no_slope(self):
        for option, value in (("--volume", 0), ("--length", "nan"), ("--cell", -1), ("--source-length", 900),
                              ("--source-width", 501), ("--concavity", 1.5), ("--exponent", 0), ("--cell", 0.001)):
            with self.subTest(option, value=value):
                self.assertIn(option.replace("width", "").replace("length", ""), self.pipeline("-o", "x", option, value, code=USAGE).err)
        self.assertNotIn("x", self.files())


class Chain(ScriptTest):
    """Box, slope, run and analysis at R = 8 m, through slide.mk: made once for all tests of this class."""

    R = 8

    @classmethod
    def setUpClass(cls):
        cls.home = pathlib.Path(tempfile.mkdtemp(prefix="talus-test-"))
        cls.addClassCleanup(shutil.rmtree, cls.home, ignore_errors=True)
        (cls.home / "pipelines").mkdir()
        for path in PIPELINES.iterdir():
            if path.name != "scenes":
                (cls.home / "pipelines" / path.name).symlink_to(path)
        (cls.home / "pipelines" / "scenes").mkdir()
        scene = (PIPELINES / "scenes" / "paper-slide.json").read_text()
        assert '"50s"' in scene and '"4s"' in scene
        (cls.home / "pipelines" / "scenes" / "paper-slide.json").write_text(scene.replace('"50s"', '"20s"'))
        (cls.home / "Makefile.workflow").write_text(
            f".DELETE_ON_ERROR:\n.SUFFIXES:\nMAKEFLAGS += --no-builtin-rules\nbin := {BIN}\n.PHONY: build-tools\nbuild-tools:\n"
            f"include {PIPELINES}/slide.mk\n")
        cls.environment = {name: value for name, value in os.environ.items()
                           if not name.startswith(("MAKE", "SLURM"))} | {"TALUS_CACHE": str(cls.home / "cache")}
        cls.sweep = subprocess.run(["make", "-f", "Makefile.workflow", "slide-sweep", "TERRAIN=paper", f"R={cls.R}", "JOBS=1"],
                                   cwd=cls.home, env=cls.environment, capture_output=True, text=True, timeout=300)
        assert cls.sweep.returncode == 0, cls.sweep.stdout[-2000:] + cls.sweep.stderr[-2000:]
        cls.out = cls.home / "results" / "paper"
        cls.slide = cls.out / f"slide_R{cls.R}_seed1"
        cls.result = json.loads(cls.slide.with_name(cls.slide.name + ".json").read_text())

    def setUp(self):
        self.folder = self.home

    def test_the_source_slides(self):
        run = json.loads(self.slide.with_name(self.slide.name + ".run.json").read_text())
        self.assertGreater(self.result["released_count"], 500)
        self.assertGreater(run["bonds_released"], 100)
        self.assertGreater(self.result["center_of_mass_travel"], 3)
        self.assertGreater(self.result["center_of_mass_drop"], 1)
        self.assertGreater(self.result["max_travel_distance"][-1], 30)
        self.assertAlmostEqual(run["time"], 24, delta=0.2)

    def test_settling_against_the_trajectory(self):
        """The report's numbers, found anew from the file."""
        settling = self.result["settling"]
        (stage,) = settling["stages"]
        with h5py.File(str(self.slide) + ".traj.h5", "r") as file:
            group = file["particles/all"]
            mark = [int(m.attrs["step"]) for m in file["granular/stages"].values()]
            step = group["position/step"][:]
            last = int(np.flatnonzero(step == max(mark))[0])
            move = group["position/value"][last].astype(float) - group["position/value"][0]
            x = group["position/value"][0].astype(float)
            place = x + group["position"].attrs["origin"]
            mobile, radius = group["species"][:] == 0, group["radius"][:]
            broken = file["granular/bond_breakages"]
            count = int(np.sum((broken["mode"][:] != 2) & (broken["step"][:] <= max(mark))))
            bonds = file["granular/series/bond_count"][0]
        distance, mean = np.linalg.norm(move, axis=1), radius[mobile].mean()
        self.assertEqual(stage["name"], "settle")
        self.assertAlmostEqual(stage["mean_radius"], mean, delta=1e-9)
        self.assertAlmostEqual(stage["mean_displacement"], distance[mobile].mean() / mean, delta=1e-5)
        self.assertAlmostEqual(stage["max_displacement"], distance[mobile].max() / mean, delta=1e-5)
        far = np.flatnonzero(mobile)[np.argmax(distance[mobile])]
        np.testing.assert_allclose(stage["max_displacement_at"], place[far], atol=0.1)
        self.assertEqual((stage["bonds"], stage["bonds_broken"]), (bonds, count))
        # The uppermost grain of each column, by a plain loop.
        edge, tops = 2 * mean, {}
        for i in range(len(x)):
            key = (math.floor(x[i, 0] / edge), math.floor(x[i, 1] / edge))
            if key not in tops or x[i, 2] + radius[i] > x[tops[key], 2] + radius[tops[key]]:
                tops[key] = i
        surface = [i for i in tops.values() if mobile[i]]
        self.assertEqual(stage["surface_grains"], len(surface))
        self.assertAlmostEqual(stage["surface_movement_mean"], distance[surface].mean() / mean, delta=1e-5)
        self.assertAlmostEqual(stage["surface_movement_max"], distance[surface].max() / mean, delta=1e-5)
        self.assertAlmostEqual(stage["surface_sinking_mean"], -move[surface, 2].mean() / mean, delta=1e-5)
        self.assertEqual(settling["slope_holds"], stage["slope_holds"])

    def test_limits_decide(self):
        for broken, holds in ((0.99, True), (1e-9, False)):
            got = self.run_tool("runout-analyse", str(self.slide) + ".traj.h5", "--format", "json", "--settling.broken-bonds",
                                broken, "--settling.cell-movement", 100, "--settling.drift", 100)
            self.assertEqual(got.code, DONE, str(got))
            settling = got.json["settling"]
            self.assertEqual(settling["slope_holds"], holds)
            self.assertEqual("does not hold" in got.err, not holds, str(got))
            if not holds:
                x, y, _ = settling["stages"][0]["moves_most"]["place"]
                self.assertIn(f"x {x:.0f}, y {y:.0f}", got.err)

    def test_results_are_shown(self):
        got = subprocess.run([str(PIPELINES / "show-results"), str(self.slide), str(self.home / "results/boxes" / self.box())],
                             capture_output=True, text=True)
        self.assertEqual(got.returncode, 0, got.stderr)
        self.assertIn(f"the slope {self.result['settling']['stages'][0]['verdict']}", got.stdout)
        self.assertNotIn("intersection", got.stdout, "nothing was observed here")

    def box(self):
        return next(path.name.removesuffix(".pgbox.h5") for path in (self.home / "results/boxes").glob("*.pgbox.h5"))

    def test_table_of_sizes(self):
        with open(self.out / "sweep.csv", newline="") as file:
            (row,) = csv.DictReader(file)
        self.assertEqual(float(row["radius_max"]), self.R)
        self.assertEqual(int(row["particle_count"]), self.result["particle_count"])
        self.assertAlmostEqual(float(row["runout_length"]), self.result["runout_length"])
        self.assertEqual(row["resumed"], "False")
        self.assertIn(f"{self.result['particle_count']:,}", self.sweep.stdout)
        self.assertIn("wall time", self.sweep.stdout)

    def test_a_second_time_nothing_is_done(self):
        got = subprocess.run(["make", "-q", "-f", "Makefile.workflow", "slide", "TERRAIN=paper", f"R={self.R}", "JOBS=1"],
                             cwd=self.home, env=self.environment, capture_output=True, text=True)
        self.assertEqual(got.returncode, 0, got.stdout + got.stderr)
        got = subprocess.run(["make", "-n", "-f", "Makefile.workflow", "slide", "TERRAIN=moon"], cwd=self.home,
                             env=self.environment, capture_output=True, text=True)
        self.assertIn("expected st-helens or paper", got.stderr)

    def test_job_script_stops_and_goes_on(self):
        """USR1 to the batch shell, as Slurm sends it: a checkpoint, 75 and a place in the queue; then the same trajectory."""
        home = pathlib.Path(tempfile.mkdtemp(prefix="talus-test-"))
        self.addCleanup(shutil.rmtree, home, ignore_errors=True)
        shutil.copytree(self.home / "pipelines", home / "pipelines", symlinks=True)
        shutil.copytree(self.home / "results" / "boxes", home / "results" / "boxes")
        shutil.copytree(self.out / "terrain", home / "results" / "paper" / "terrain")
        model = f"slope_R{self.R}_seed1.model.h5"
        shutil.copy2(self.out / model, home / "results" / "paper" / model)
        shutil.copy(self.home / "Makefile.workflow", home)
        (home / "path").mkdir()
        queue = home / "path" / "scontrol"
        queue.write_text(f"#!/bin/sh\necho \"$@\" >> {home}/queue\n")
        queue.chmod(0o755)
        environment = self.environment | {"SLURM_JOB_ID": "17", "SLURM_CPUS_PER_TASK": "1",
                                          "PATH": f"{home / 'path'}:{os.environ['PATH']}"}
        command = ["bash", str(PIPELINES / "slide.slurm"), "TERRAIN=paper", f"R={self.R}"]
        part = home / "results" / "paper" / f"slide_R{self.R}_seed1.run.json.part"
        job = subprocess.Popen(command, cwd=home, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        for _ in range(600):
            if part.exists() or job.poll() is not None:
                break
            time.sleep(0.05)
        time.sleep(0.3)
        job.send_signal(signal.SIGUSR1)
        out, err = job.communicate(timeout=120)
        if job.returncode == 0:
            self.skipTest("the run ended before it could be stopped")
        self.assertEqual(job.returncode, STOPPED, out + err)
        self.assertEqual((home / "queue").read_text(), "requeue 17\n")
        self.assertFalse((home / "results/paper" / f"slide_R{self.R}_seed1.traj.h5").exists())
        got = subprocess.run(command, cwd=home, env=environment, capture_output=True, text=True, timeout=120)
        self.assertEqual(got.returncode, 0, got.stdout + got.stderr)
        with h5py.File(home / "results/paper" / f"slide_R{self.R}_seed1.traj.h5", "r") as again, \
                h5py.File(str(self.slide) + ".traj.h5", "r") as whole:
            np.testing.assert_array_equal(again["particles/all/position/value"][-1], whole["particles/all/position/value"][-1])

    def test_job_script_does_not_try_again_what_fails(self):
        got = subprocess.run(["bash", str(PIPELINES / "slide.slurm"), "TERRAIN=moon"], cwd=self.home, env=self.environment,
                             capture_output=True, text=True, timeout=60)
        self.assertNotIn(got.returncode, (0, STOPPED), got.stderr)

    def test_pictures(self):
        for name, arguments in (("view.png", []), ("first.png", ["--frame", 0, "--colour", "release"]),
                                ("depth.png", ["--colour", "depth"]),
                                ("cut.png", ["--section", "500000,3900250,500800,3900250"])):
            got = self.pipeline(str(self.slide) + ".traj.h5", "-o", name, "--overwrite", "--width", 300, *arguments,
                                name="slope-picture")
            self.assertIn("drawn by grains", got.out)
            self.assertTrue((self.home / name).read_bytes().startswith(b"\x89PNG"), name)
        self.assertNotEqual((self.home / "view.png").read_bytes(), (self.home / "first.png").read_bytes())


class Sweep(ScriptTest):
    script = "slide-sweep"

    def test_help(self):
        self.says_what_it_does()

    def result(self, name, **more):
        self.write(name, {"schema": "runout-analyse", "max_travel_distance": [0, 12.5], "runout_length": 100, **more})

    def test_table(self):
        self.result("slide_R2_seed1.json", particle_count=10)
        self.result("slide_R4_seed1.json", particle_count=5, settling={"slope_holds": False, "stages": [
            {"surface_movement_mean": 1.5, "bonds_broken_fraction": 0.25}]})
        self.write("slide_R2_seed1.run.json", {"schema": "dem-run", "particle_count": 10, "steps": 100, "wall_time": 2.0,
                                               "particle_steps_per_second": 250.0})
        got = self.pipeline("slide_R2_seed1", "slide_R4_seed1", "-o", "s.csv")
        lines = got.out.splitlines()
        self.assertEqual(len(lines), 3)
        self.assertIn("does not hold", lines[1], "coarse sizes first")
        self.assertIn("2.0+", lines[2], "half of the run's steps were done by an earlier part")
        with open(self.folder / "s.csv", newline="") as file:
            rows = list(csv.DictReader(file))
        self.assertEqual([row["radius_max"] for row in rows], ["4.0", "2.0"])
        self.assertEqual(rows[0]["max_travel"], "12.5")

    def test_errors(self):
        self.assertIn("a.json", self.pipeline("a", code=INPUT).err)
        self.write("b.json", "{")
        self.pipeline("b", code=INPUT)
        self.write("c.json", {"schema": "triax-fit"})
        self.pipeline("c", code=INPUT)
        self.result("slide_R1.json")
        self.write("s.csv", "mine")
        self.pipeline("slide_R1", "-o", "s.csv", code=EXISTS)
        self.assertEqual((self.folder / "s.csv").read_text(), "mine")


class Pictures(ScriptTest):
    script = "slope-picture"

    def test_help(self):
        self.says_what_it_does()

    def test_errors(self):
        write_model(self.folder / "m.h5", [[0, 0, 0], [1, 0, 0]], [0.5, 0.5])
        self.write("text.h5", "no HDF5")
        with h5py.File(self.folder / "box.h5", "w") as file:
            file.create_group("granular").attrs["kind"] = "pgbox"
        for code, arguments in ((USAGE, ["m.h5", "-o", "x.jpg"]), (USAGE, ["m.h5", "-o", "x.png", "--section", "1,1,1,1"]),
                                (USAGE, ["m.h5", "-o", "x.png", "--section", "1,1,2"]),
                                (USAGE, ["m.h5", "-o", "x.png", "--colour", "travel"]),
                                (USAGE, ["m.h5", "-o", "x.png", "--width", 10]),
                                (USAGE, ["m.h5", "-o", "x.png", "--section", "50,50,60,60", "--colour", "depth"]),
                                (INPUT, ["m.h5", "-o", "x.png", "--colour", "material"]),
                                (INPUT, ["none.h5", "-o", "x.png"]), (INPUT, ["text.h5", "-o", "x.png"]),
                                (INPUT, ["box.h5", "-o", "x.png"])):
            with self.subTest(arguments=arguments):
                self.pipeline(*arguments, code=code)
        self.write("x.png", "mine")
        self.pipeline("m.h5", "-o", "x.png", "--colour", "depth", code=EXISTS)
        self.assertEqual(self.files(), ["box.h5", "m.h5", "text.h5", "x.png"])

    def options(self, **more):
        class Options:
            section, thickness, azimuth, elevation, width, colour, colour_max, frame = None, None, 0.0, 45.0, 400, "depth", None, -1
        for name, value in more.items():
            setattr(Options, name, value)
        return Options

    def source(self, path, colour="depth", frame=-1):
        module = script("slope-picture")
        file = h5py.File(self.folder / path, "r")
        self.addCleanup(file.close)
        tiled = "granular/tiling" in file
        return module, (module.Tiled(file, path, colour) if tiled else module.Explicit(file, path, frame, colour))

    def test_disc_of_a_section(self):
        """One sphere of 1 m in the plane, one beside it: the disc has the sphere's area and the neighbour is left out."""
        write_model(self.folder / "m.h5", [[5, 5, 3], [8, 7.5, 3]], [1, 1])
        module, source = self.source("m.h5")
        picture, _, _, _, ranges = module.section(source, self.options(section=[0, 5, 10, 5], thickness=1.0),
                                                  module.depth_of(source))
        inked = np.any(picture < 255, axis=2)
        pixel = 10 / 400
        self.assertAlmostEqual(inked.sum() * pixel**2 / math.pi, 1, delta=0.02)
        columns = np.flatnonzero(inked.any(axis=0))
        self.assertAlmostEqual((columns[0] + columns[-1] + 1) / 2 * pixel, 5, delta=2 * pixel)
        rows = np.flatnonzero(inked.any(axis=1))
        middle = ranges[3] - (rows[0] + rows[-1] + 1) / 2 * pixel
        self.assertAlmostEqual(middle, 3, delta=2 * pixel)

    def test_heights_are_the_uppermost_spheres(self):
        rng = np.random.default_rng(3)
        place, radius = rng.uniform(0, 10, (300, 3)), rng.uniform(0.3, 0.6, 300)
        module = script("slope-picture")
        heights = module.Heights([-1, -1], [11, 11], 0.2)
        for part in (slice(0, 100), slice(100, 300)):
            heights.add(place[part, 0], place[part, 1], place[part, 2], radius[part], np.arange(300.0)[part])
        rows, columns = heights.shape
        x, y = np.meshgrid(-1 + 0.2 * (np.arange(columns) + 0.5), -1 + 0.2 * (np.arange(rows) + 0.5))
        square = radius**2 - (x[..., None] - place[:, 0])**2 - (y[..., None] - place[:, 1])**2
        top = np.where(square >= 0, place[:, 2] + np.sqrt(np.maximum(square, 0)), -np.inf)
        there = top.max(axis=-1) > -np.inf
        np.testing.assert_allclose(heights.top[there], top.max(axis=-1)[there], atol=1e-12)
        np.testing.assert_array_equal(heights.value[there], top.argmax(axis=-1)[there])

    def test_near_hides_far(self):
        """Two plates of grains, the far one 30 m lower: from 56 degrees above the horizon the near one hides it, from 10
        degrees nothing, from 80 degrees a quarter."""
        side = np.arange(0, 20, 1.0)
        plate = np.array([(x, y) for x in side for y in side])
        near = np.column_stack([plate, np.full(len(plate), 30.0)])
        far = np.column_stack([plate[:, 0], plate[:, 1] + 20, np.zeros(len(plate))])
        write_model(self.folder / "m.h5", np.vstack([near, far]), np.full(2 * len(plate), 0.72),
                    release=np.r_[np.zeros(len(plate)), np.ones(len(plate))].astype(np.uint8))
        for elevation, share in ((10.0, 0.5), (56.3, 0.0), (80.0, 14.5 / 34.2)):
            module, source = self.source("m.h5", "release")
            picture, *_ = module.view(source, self.options(colour="release", elevation=elevation), None)
            red = picture[..., 0] > 1.8 * picture[..., 1]  # of released grains; the ground's is 1.1
            self.assertAlmostEqual(red.sum() / np.any(picture < 255, axis=2).sum(), share, delta=0.06)

    def test_travel_is_the_sum_of_ways_since_the_last_stage(self):
        write_model(self.folder / "t.h5", [[0, 0, 0]], [1])
        with h5py.File(self.folder / "t.h5", "r+") as file:
            file["granular"].attrs["kind"] = "trajectory"
            del file["particles/all/position"]
            ways = np.array([[0, 0, 0], [9, 0, 0], [9, 0, 0], [9, 3, 0], [9, 0, 0]], float)
            file["particles/all/position/value"] = np.repeat(ways[:, None], 2, axis=1)
            file["particles/all/position/value"][:, 1] = 0
            file["particles/all/position/step"] = [0, 10, 10, 20, 30]
            file["particles/all/position/time"] = [0.0, 1, 1, 2, 3]
            del file["particles/all/radius"]
            file["particles/all/radius"] = [1.0, 1.0]
            for name, step in (("0", 0), ("1", 10)):
                file.create_group(f"granular/stages/{name}").attrs["step"] = step
        for frame, way in ((4, 6), (3, 3), (2, 0), (1, 9)):
            _, source = self.source("t.h5", "travel", frame)
            ((_, _, travel),) = source.batches("travel")
            np.testing.assert_allclose(travel, [way, 0])
        self.pipeline("t.h5", "-o", "x.png", "--frame", 5, code=USAGE)

    def tiled(self):
        self.ok("pgbox-gen", "--radius", 0.12, "--seed", 1, "-o", "box.pgbox.h5")
        self.pipeline("-o", "slope", "--length", 40, "--width", 30, "--relief", 20, "--source-length", 30, "--source-width", 16,
                      "--source-top", 4, "--volume", 600, "--cell", 1, name="paper-slope")
        trim = ["--pre", "slope/pre.asc", "--post", "slope/post.asc", "--shift", 3, "--source-area", "slope/source_area.geojson",
                "--domain", "slope/domain.geojson", "--radius-max", 0.25]
        self.ok("tile-trim", "box.pgbox.h5", *trim, "-o", "tiled.model.h5")
        self.ok("tile-trim", "box.pgbox.h5", *trim, "--explicit", "-o", "explicit.model.h5")

    def test_levels_of_detail(self):
        """Tiled and explicit forms give the same picture by grains; coarser levels give the same surface to within their size."""
        self.tiled()
        for section in (None, [500002, 3900015, 500038, 3900015]):
            pictures = []
            for name in ("tiled.model.h5", "explicit.model.h5"):
                module, source = self.source(name, "release")
                options = self.options(colour="release", section=section, width=300)
                pictures.append((module.section if section else module.view)(source, options, None)[0])
            if section:
                np.testing.assert_array_equal(*pictures)
        _, tiled = self.source("tiled.model.h5", "release")
        self.assertLess(len(tiled.exposed), len(tiled.kept) + 1)
        tops = {}
        for level, parts in (("grains", tiled.grains(tiled.exposed)), ("columns", tiled.columns(tiled.exposed, 0.25)),
                             ("tiles", tiled.wholes(tiled.exposed))):
            heights = module.Heights([0, 0], [40, 30], 1.0)
            for place, radius, value in parts:
                heights.add(place[:, 0], place[:, 1], place[:, 2] + radius, np.zeros(len(place)), value)
            tops[level] = heights.top[2:28, 2:38]
            self.assertTrue(np.all(np.isfinite(tops[level])), level)
        x = np.arange(2, 38) + 0.5
        ground = tiled.origin[2] + tops["grains"]
        pre = 100 + 20 * (1 - 1.25 * x / 40 + 0.25 * (x / 40)**2)
        self.assertLess(np.abs(ground - pre).max(), 0.8, "the uppermost grains lie at the ground's surface")
        columns_off = np.abs(tops["columns"] - tops["grains"])
        self.assertLess(np.quantile(columns_off, 0.99), 0.5, "a diameter; which grain a column shows is up to the box")
        self.assertLess(columns_off.max(), 0.75)
        self.assertLess(np.abs(tops["tiles"] - tops["grains"]).mean(), 0.6)
        for pixel, level in ((0.1, "grains"), (0.4, "columns"), (5, "tiles")):
            self.assertEqual(tiled.surface(pixel)[0], level)

    def test_kinds_of_tiled_grains(self):
        """Masks are read right: fixed and released grains are as many as tile-trim says."""
        self.tiled()
        _, tiled = self.source("tiled.model.h5", "release")
        kinds = np.concatenate([kind for _, _, kind in tiled.grains(np.arange(len(tiled.kept)))])
        with h5py.File(self.folder / "explicit.model.h5", "r") as file:
            species, release = (file[f"particles/all/{name}"][:] for name in ("species", "release"))
        self.assertEqual([int(np.sum(kinds == k)) for k in range(3)],
                         [int(np.sum(species == 1)), int(np.sum((species == 0) & (release == 0))), int(np.sum(release == 1))])
        got = self.pipeline("tiled.model.h5", "-o", "x.png", "--colour", "depth")
        self.assertIn(f"{len(kinds):,} grains", got.out)


if __name__ == "__main__":
    main()
