# SPDX-License-Identifier: GPL-3.0-or-later
"""dem-run: what is in a trajectory, the same bytes at any thread count, stages, materials, and bad input."""
import h5py
import numpy as np

from common_behaviour import ReadsInput
from scenes import RADIUS, Scenes
from talus_tools import (CONFIGURATION, FAILED, INPUT, USAGE, check_xdmf, copy_with, datasets, flip_byte, is_fletcher32,
                         main, write_model)


class Trajectories(Scenes):
    def setUp(self):
        super().setUp()
        self.ok("pgbox-gen", "--radius", 0.09, "--radius-min-ratio", 0.8, "-o", "box.h5")

    def model(self, *arguments, name="model.h5"):
        self.ok("tile-trim", "box.h5", *(arguments or ["--cuboid", "1.5,1.5,1.5"]), "-o", name)
        return name

    SCENE = {"material": {"friction": 0.4, "density": 2400},
             "walls": [{"name": "floor", "plane": {"point": [0, 0, -0.02], "normal": [0, 0, 1]}}],
             "output": {"frame_interval": "20ms", "series_interval": "5ms", "fields": ["position", "velocity"]}}

    def scene_file(self, **more):
        return self.write("scene.json", {**self.SCENE, **more})

    def test_same_bytes_with_one_and_two_threads(self):
        self.scene_file(bond={"bond_pressure": "1kPa", "bond_friction": 2}, stress_free_start=True)
        model = self.model("--cuboid", "2,2,2")
        for threads in (1, 2):
            self.ok("dem-run", model, "-c", "scene.json", "--time.end", "0.2s", "-j", threads, "--no-provenance", "-o",
                    f"{threads}.h5")
        self.assertEqual((self.folder / "1.h5").read_bytes(), (self.folder / "2.h5").read_bytes())
        self.assertGreater(datasets(self.folder / "1.h5")["granular/series/contact_count"][-1], 100)

    def test_tiled_and_explicit_models_run_alike(self):
        self.scene_file()
        self.model("--cylinder", "2,2", name="tiled.h5")
        self.model("--cylinder", "2,2", "--explicit", name="explicit.h5")
        for name in ("tiled", "explicit"):
            self.ok("dem-run", f"{name}.h5", "-c", "scene.json", "--time.end", "0.1s", "-o", f"{name}.traj.h5")
        self.assertSamePhysics("tiled.traj.h5", "explicit.traj.h5")

    def test_reference_kernel_agrees(self):
        """The slow yardstick and the specialised pair loop, over a short time."""
        self.scene_file(bond={"bond_pressure": "1kPa", "bond_friction": 2}, stress_free_start=True)
        model, found = self.model(), {}
        for kernel in ("specialised", "reference"):
            result, value, _ = self.scene(model, "-c", "scene.json", "--time.end", "20ms", "--kernel", kernel)
            found[kernel] = value["position"][-1]
        self.assertIn("reference", result["kernel"])
        np.testing.assert_allclose(found["specialised"], found["reference"], atol=1e-11)

    def test_layout(self):
        """H5MD: steps and times shared by hard links, units, checksums, chunks of a frame, what was asked for only."""
        self.scene_file()
        self.ok("dem-run", self.model(), "-c", "scene.json", "--time.end", "50ms", "-o", "run.h5")
        with h5py.File(self.folder / "run.h5", "r") as file:
            self.assertEqual(list(file["h5md"].attrs["version"]), [1, 1])
            self.assertIn("units", file["h5md/modules"])
            self.assertEqual(file["granular"].attrs["kind"], b"trajectory")
            self.assertEqual(file["granular"].attrs["complete"], 1)
            group = file["particles/all"]
            self.assertNotIn("force", group)
            self.assertEqual(group["position/value"].attrs["unit"], b"m")
            self.assertEqual(group["velocity/value"].attrs["unit"], b"m s-1")
            self.assertEqual(group["position/value"].dtype, np.float32)
            self.assertEqual(group["position/value"].chunks[0], 1)
            self.assertEqual(group["position/step"], group["velocity/step"], "one dataset under two names")
            frames = len(group["position/step"])
            self.assertEqual(group["position/value"].shape, (frames, len(group["radius"]), 3))
            self.assertEqual(len(file["granular/series/time"]), len(file["granular/series/total_energy"]))
            self.assertGreater(len(file["granular/series/time"]), frames)
            self.assertNotIn("observables", file)
            programs = [file[f"granular/provenance/{k:04}"].attrs["program"] for k in range(3)]
            self.assertEqual(programs, [b"pgbox-gen", b"tile-trim", b"dem-run"])
        for name in ("position/value", "velocity/value", "radius"):
            self.assertTrue(is_fletcher32(self.folder / "run.h5", f"particles/all/{name}"), name)
        _, times = check_xdmf(self, self.folder / "run.xdmf")
        np.testing.assert_allclose(times, datasets(self.folder / "run.h5")["particles/all/position/time"], rtol=1e-6)

    def test_output_settings(self):
        model = self.model()
        fields = ["angular_velocity", "force", "position"]
        self.ok("dem-run", model, "--time.end", "20ms", "--output.fields", ",".join(fields), "--output.float64", "-o",
                "run.h5")
        with h5py.File(self.folder / "run.h5", "r") as file:
            self.assertEqual(sorted(name for name in ("angular_velocity", "force", "position", "velocity")
                                    if name in file["particles/all"]), fields)
            for name in fields:
                self.assertEqual(file[f"particles/all/{name}/value"].dtype, np.float64)
            self.assertEqual(len(file["particles/all/position/step"]), 2, "first and last")
        self.fails(USAGE, "dem-run", model, "--time.end", "1ms", "--output.fields", "position,speed", "-o", "x.h5",
                   names=["speed", "angular_velocity"])

    def test_stages(self):
        """Settles to rest, then goes on; a stage's own damping; marks in the file."""
        self.scene_file(box={"lower": [0, 0, 0], "upper": [1, 1, 9], "periodic": [True, True, False]},
                        stages=[{"name": "settle", "until": "rest", "limit": "10s", "damping": {"viscous": "20Hz"}},
                                {"name": "go", "end": "50ms", "release": True}])
        model = self.model("--cuboid", "1,1,1.5")
        result = self.ok("dem-run", model, "-c", "scene.json", "-o", "run.h5", "--format", "json").json
        with h5py.File(self.folder / "run.h5", "r") as file:
            marks = [file["granular/stages"][name] for name in sorted(file["granular/stages"])]
            self.assertEqual([mark.attrs["name"] for mark in marks], [b"settle", b"go"])
            self.assertEqual(marks[0].attrs["step"], 0)
            rested = marks[1].attrs["step"]
            self.assertIn(rested, file["particles/all/position/step"][:])
            self.assertAlmostEqual((result["steps"] - rested) * result["time_step"], 0.05, delta=result["time_step"])
            step, time_ = file["granular/series/step"][:], file["granular/series/time"][:]
            at = int(np.flatnonzero(step == rested)[0])
            self.assertLess(time_[at], 10, "came to rest before its limit")
            self.assertLessEqual(file["granular/series/unbalanced_force"][at], 0.01)
            speed = file["granular/series/max_speed"][:at + 1]
            self.assertLess(speed[-1], 0.1 * speed.max())
            times = file["particles/all/position/time"][:].tolist()
        self.assertEqual(times.count(time_[at]), 2, "the frame that ends a stage, and the one that begins the next")
        self.assertEqual(check_xdmf(self, self.folder / "run.xdmf")[1], sorted(set(times)), "ParaView shows neither of two")

    def test_release_breaks_bonds(self):
        """Grains labelled as released lose their bonds with the rest, and only those."""
        write_model(self.folder / "row.h5", [[0, 0, 0.02 * k] for k in range(4)], [RADIUS] * 4,
                    species=[1, 0, 0, 0], release=np.array([0, 0, 1, 1], dtype="u1"))
        self.write("hang.json", {"gravity": [0, 0, 9.81], "bond": {"bond_pressure": "10kPa", "bond_friction": 10},
                                 "stress_free_start": True,
                                 "stages": [{"name": "hang", "end": "20ms"},
                                            {"name": "go", "end": "100ms", "release": True}]})
        result, value, t = self.scene("row.h5", "-c", "hang.json", "--output.frame-interval", "10ms")
        self.assertEqual(result["bonds_released"], 1)
        self.assertEqual(result["bonds"], 2)
        record = datasets(self.folder / "run.h5")
        self.assertEqual(record["granular/bond_breakages/pair"].tolist(), [[1, 2]])
        self.assertEqual(record["granular/bond_breakages/mode"].tolist(), [2])
        self.assertAlmostEqual(record["granular/bond_breakages/time"][0], 0.02, delta=1e-3)
        z = value["position"][-1, :, 2]
        self.assertLess(z[1] - z[0], 0.0201)
        self.assertAlmostEqual(z[2] - 0.04, 9.81 / 2 * 0.1**2, delta=3e-3)
        self.assertAlmostEqual(z[3] - z[2], 0.02, delta=1e-4)

    def test_time_step(self):
        write_model(self.folder / "one.h5", [[0, 0, 0]], [RADIUS])
        got = self.ok("dem-run", "one.h5", "--time.end", "1ms", "--time.step", "7us", "-o", "a.h5", "--format", "json")
        self.assertEqual(got.json["time_step"], 7e-6)
        got = self.fails(CONFIGURATION, "dem-run", "one.h5", "--time.end", "1s", "--time.step", "1ms", "-o", "b.h5",
                         names=["time", "step", "allow_unstable"])
        self.ok("dem-run", "one.h5", "--time.end", "10ms", "--time.step", "1ms", "--time.allow-unstable", "-o", "c.h5")
        self.assertNotIn("b.h5", self.files())


class Materials(Scenes):
    """Pairs far apart, each meeting head-on at 1 m/s, of like and of different materials."""

    PAIRS = ((0, 0), (1, 1), (0, 1), (1, 2))
    FIRST = {"density": 1000, "youngs_modulus": 1e8, "poissons_ratio": 0.2, "restitution": 0.9, "friction": 0.5}
    MORE = ({"density": 2500, "youngs_modulus": 4e8, "poissons_ratio": 0.3, "restitution": 0.4,
             "friction": 0.2},
            {"density": 4000, "friction": 0.3})

    def setUp(self):
        super().setUp()
        kinds = np.array(self.PAIRS).ravel()
        side = np.tile([-1.0, 1.0], len(self.PAIRS))
        position = np.zeros((len(kinds), 3))
        position[:, 0] = side * (RADIUS + 5e-6)
        position[:, 2] = 0.1 * np.repeat(np.arange(len(self.PAIRS)), 2)
        velocity = np.zeros_like(position)
        velocity[:, 0] = -0.5 * side
        self.model = {"position": position, "radius": [RADIUS] * len(kinds), "velocity": velocity}
        self.materials = [{**self.FIRST, **more} for more in ({}, *self.MORE)]
        write_model(self.folder / "pairs.h5", **self.model, material=kinds.astype("u1"))
        self.scene_file()

    def scene_file(self, **changes):
        return self.write("scene.json", {"gravity": [0, 0, 0], "material": self.FIRST, "materials": list(self.MORE),
                                         "contact": {"damping": "exact"}, "time": {"step": "0.5us", "end": "0.8ms"},
                                         **changes})

    def mass(self, kind):
        return 4 / 3 * np.pi * RADIUS**3 * self.materials[kind]["density"]

    def test_restitution(self):
        """That of two materials is the geometric mean; without `materials` all would be the first's."""
        result, value, _ = self.scene("pairs.h5", "-c", "scene.json")
        self.assertIn("materials", result["kernel"])
        speed = value["velocity"][-1, :, 0]
        for k, (a, b) in enumerate(self.PAIRS):
            nominal = np.sqrt(self.materials[a]["restitution"] * self.materials[b]["restitution"])
            with self.subTest(a=a, b=b):
                self.assertAlmostEqual(speed[2 * k + 1] - speed[2 * k], nominal, delta=3e-3)
                centre = (self.mass(b) - self.mass(a)) / (self.mass(b) + self.mass(a)) * -0.5
                moved = (self.mass(a) * speed[2 * k] + self.mass(b) * speed[2 * k + 1]) / (self.mass(a) + self.mass(b))
                self.assertAlmostEqual(moved, centre, delta=1e-9)
        with h5py.File(self.folder / "run.h5", "r") as file:
            self.assertEqual(file["particles/all/material"][:].tolist(), [k for pair in self.PAIRS for k in pair])
        self.assertIn("/particles/all/material", check_xdmf(self, self.folder / "run.xdmf")[0])

    def test_duration_and_friction(self):
        """Undamped: contact time 2.9432752 delta/v and greatest overlap after Hertz; spinning fast enough to slide
        throughout: the impulse along the surface is mu times that across, mu the smaller one."""
        for more in self.materials:
            more["restitution"] = 1
        write_model(self.folder / "spin.h5", **self.model, material=np.array(self.PAIRS).ravel(),
                    angular_velocity=np.tile([0.0, 0.0, 400.0], (2 * len(self.PAIRS), 1)))
        self.scene_file(material=self.materials[0], materials=[{**more, "restitution": 1} for more in self.MORE])
        for kernel in ("specialised", "reference"):
            _, value, t = self.scene("spin.h5", "-c", "scene.json", "--kernel", kernel,
                                     "--output.frame-interval", "0.5us")
            for k, (a, b) in enumerate(self.PAIRS):
                first, second = self.materials[a], self.materials[b]
                compliance = sum((1 - m["poissons_ratio"]**2) / m["youngs_modulus"] for m in (first, second))
                stiffness = 4 / 3 / compliance * np.sqrt(RADIUS / 2)
                mass = self.mass(a) * self.mass(b) / (self.mass(a) + self.mass(b))
                greatest = (5 * mass / (4 * stiffness))**0.4
                branch = value["position"][:, 2 * k + 1] - value["position"][:, 2 * k]
                overlap = 2 * RADIUS - np.linalg.norm(branch, axis=1)
                touching = t[overlap > 0]
                change = value["velocity"][-1, 2 * k] - value["velocity"][0, 2 * k]
                with self.subTest(kernel=kernel, a=a, b=b):
                    self.assertAlmostEqual(overlap.max() / greatest, 1, delta=5e-3)
                    self.assertAlmostEqual((touching[-1] - touching[0]) / (2.9432752 * greatest), 1, delta=1e-2)
                    self.assertAlmostEqual(abs(change[1] / change[0]), min(first["friction"], second["friction"]),
                                           delta=1e-2)

    def test_left_out_is_the_first_one(self):
        """A list that changes nothing is the run without it; units, and what --print-config shows."""
        write_model(self.folder / "plain.h5", **self.model)
        more = [{"density": "1g/cm3", "youngs_modulus": "100MPa"}, {"friction": "auto"}]
        self.scene_file(materials=more)
        _, same, _ = self.scene("pairs.h5", "-c", "scene.json")
        shown = self.ok("dem-run", "pairs.h5", "-c", "scene.json", "--print-config").json["materials"]
        self.assertEqual([list(one) for one in shown], [list(one) for one in more], "what was given")
        self.scene_file(materials=shown)
        _, again, _ = self.scene("pairs.h5", "-c", "scene.json")
        self.write("one.json", {"gravity": [0, 0, 0], "material": self.FIRST, "contact": {"damping": "exact"},
                                "time": {"step": "0.5us", "end": "0.8ms"}})
        _, plain, _ = self.scene("plain.h5", "-c", "one.json")
        with h5py.File(self.folder / "run.h5", "r") as file:
            self.assertNotIn("material", file["particles/all"])
        for name in plain:
            np.testing.assert_array_equal(same[name], again[name])
            np.testing.assert_allclose(same[name], plain[name], rtol=1e-9, atol=1e-9)

    def test_refusals(self):
        self.scene_file(materials=[self.MORE[0]])
        self.fails(INPUT, "dem-run", "pairs.h5", "-c", "scene.json", "-o", "x.h5",
                   names=["pairs.h5", "particle 7", "material", "number 2", "`materials`"])
        for number in (-1, 256):
            write_model(self.folder / "wrong.h5", **self.model, material=[0] * 7 + [number])
            self.fails(INPUT, "dem-run", "wrong.h5", "-c", "scene.json", "-o", "x.h5",
                       names=["wrong.h5", "/particles/all/material", "row 7", number, "0 to 255"])
        write_model(self.folder / "wrong.h5", **self.model, material=[0] * 7)
        self.fails(INPUT, "dem-run", "wrong.h5", "-c", "scene.json", "-o", "x.h5",
                   names=["wrong.h5", "/particles/all/material", "7 rows"])
        self.scene_file(materials=[{}] * 256)
        linear = {"law": "linear", "normal_stiffness": 1e4, "tangential_stiffness": 1e4}
        for changes, patterns in (
                ({"materials": [{}] * 256}, ["/materials: found 256 materials, expected at most 255"]),
                ({"contact": linear}, ['/materials: found .*"linear", expected .*"hertz-mindlin"']),
                ({"materials": [{"densty": 1}, {"youngs_modulus": 0}]},
                 ['/materials/0/densty: .*"density"', "/materials/1/youngs_modulus: found 0, expected "])):
            self.scene_file(**changes)
            got = self.run_tool("dem-run", "pairs.h5", "-c", "scene.json", "-o", "x.h5")
            self.assertEqual(got.code, CONFIGURATION, str(got))
            self.assertEqual(len(got.err.splitlines()), len(patterns), str(got))
            for pattern in patterns:
                self.assertRegex(got.err, r"scene\.json:\d+:\d+: error: " + pattern)
        self.assertNotIn("x.h5", self.files())


class DemRun(ReadsInput, Scenes):
    arguments = ("--time.end", "2ms", "--gravity", "0,0,-9.81")
    wrong_kind = "pgbox"
    damaged = ("/particles/all/position", "/particles/all/radius", "/particles/all/velocity")
    keys = ("particle_count", "steps", "time", "time_step", "wall_time", "particle_steps_per_second",
            "pairs_per_particle", "contacts_per_particle", "list_rebuilds", "asleep_fraction", "kernel", "threads",
            "ranks", "energy_error", "sleep_error", "peak_memory")

    def input(self):
        path = self.folder / "in.h5"
        if not path.exists():
            grid = np.stack(np.meshgrid(*[np.arange(8)] * 3), -1).reshape(-1, 3) * 0.0201
            with h5py.File(path, "w", libver=("v108", "v110")) as file:
                file.create_group("granular").attrs["kind"] = "model"
                file["granular"].attrs["complete"] = 1
                for name, values in (("position", grid), ("radius", np.full(len(grid), RADIUS)),
                                     ("velocity", np.zeros_like(grid))):
                    file.create_dataset(f"particles/all/{name}", data=values, fletcher32=True, chunks=values.shape)
        return path.name

    def test_flipped_byte_in_tiles(self):
        self.ok("tile-trim", self.box(), "--cuboid", "2,2,2", "-o", "tiled.h5")
        for dataset in ("/granular/tiling/kept_mask", "/granular/boxes/0000/position", "/granular/tiling/index"):
            with self.subTest(dataset):
                flip_byte(self.folder / "tiled.h5", self.folder / "flipped.h5", dataset)
                self.fails(INPUT, "dem-run", "flipped.h5", "--time.end", "1ms", "-o", "x.h5",
                           names=["flipped.h5", dataset])

    def test_not_a_number(self):
        for dataset, place in (("position", (7, 0)), ("radius", 7), ("velocity", (7, 2))):
            for value in (np.nan, -np.inf):
                with self.subTest(dataset, value=value):
                    copy_with(self.folder / self.input(), self.folder / "nan.h5",
                              lambda file: file[f"particles/all/{dataset}"].__setitem__(place, value))
                    self.fails(INPUT, "dem-run", *self.command(source="nan.h5"),
                               names=["nan.h5", f"/particles/all/{dataset}", "row 7"])
        self.fails(USAGE, "dem-run", *self.command("--material.density", "nan"), names="nan")
        self.assertNotIn("out.h5", self.files())

    def test_models_that_are_wrong(self):
        def without(name):
            return lambda file: file.__delitem__(f"particles/all/{name}")
        cases = {"no radius": (without("radius"), "radius"), "no position": (without("position"), "position"),
                 "zero radius": (lambda file: file["particles/all/radius"].__setitem__(2, 0), "row 2"),
                 "two at one place": (lambda file: file["particles/all/position"].__setitem__(
                     1, file["particles/all/position"][0]), "position")}
        for what, (change, name) in cases.items():
            with self.subTest(what):
                copy_with(self.folder / self.input(), self.folder / "wrong.h5", change)
                self.fails(INPUT, "dem-run", *self.command("--overwrite", source="wrong.h5"), names=["wrong.h5", name])
        write_model(self.folder / "short.h5", [[0, 0, 0], [1, 0, 0]], [0.1])
        self.fails(INPUT, "dem-run", *self.command("--overwrite", source="short.h5"), names=["short.h5", "radius"])
        write_model(self.folder / "flat.h5", [[0, 0], [1, 0]], [0.1, 0.1])
        self.fails(INPUT, "dem-run", *self.command("--overwrite", source="flat.h5"), names=["flat.h5", "position"])
        write_model(self.folder / "none.h5", np.zeros((0, 3)), [])
        self.fails(INPUT, "dem-run", *self.command("--overwrite", source="none.h5"), names="none.h5")

    def test_radius_larger_than_the_box(self):
        got = self.run_tool("dem-run", *self.command("--box.lower", "0,0,0", "--box.upper", "0.01,0.01,0.01",
                                                     "--box.periodic", "true,true,true"))
        self.assertIn(got.code, (CONFIGURATION, INPUT), str(got))
        self.assertEqual(len(got.err.splitlines()), 1, str(got))
        self.assertIn("box", got.err)

    def test_all_errors_of_a_scene_at_once(self):
        self.write("scene.json", '{\n"gravety": [0, 0, 1],\n"material": {"density": "3kPa", "frictoin": 1},\n'
                                 '"time": {"end": -1},\n"stages": [{"nam": "a"}],\n'
                                 '"walls": [{"mesh": "pier.stl", "plane": {"normal": [0, 0, 1]}}]\n}\n')
        got = self.run_tool("dem-run", self.input(), "-c", "scene.json", "-o", "out.h5")
        self.assertEqual(got.code, CONFIGURATION, str(got))
        for start in (r'scene\.json:2:1: error: /gravety: .*"gravity"',
                      r'scene\.json:3:\d+: error: /material/density: found "3kPa" \(a pressure\), expected a density',
                      r'scene\.json:3:\d+: error: /material/frictoin: .*"friction"',
                      r'scene\.json:4:\d+: error: /time/end: found -1, expected ',
                      r'scene\.json:5:\d+: error: /stages/0/nam: .*"name"',
                      r'scene\.json:6:\d+: error: /walls/0/mesh: '):
            self.assertRegex(got.err, start)

    def test_nothing_to_do(self):
        self.fails(USAGE, "dem-run", self.input(), "-o", "out.h5", names="time")

    def test_full_disk_while_running(self):
        """The disk fills up after some frames: one line, exit 1, no trajectory."""
        self.ok("tile-trim", self.box(), "--cuboid", "2,2,2", "-o", "model.h5")
        got = self.fails(FAILED, "dem-run", "model.h5", "--time.end", "0.2s", "--output.frame-interval", "1ms", "-o",
                         "disk/run.traj.h5", wrapper=self.small_disk(256), names="disk/run")
        self.assertNotIn("run.traj.h5", self.left_on_disk())
        self.assertFalse([name for name in self.left_on_disk() if name.endswith((".part", ".xdmf"))], str(got))

    def test_dry_run_predicts(self):
        got = self.ok("dem-run", *self.command("-n", "--format", "json")).json
        for key in ("particle_count", "time_step", "steps", "expected_run_time", "expected_memory", "expected_disk"):
            self.assertGreater(got[key], 0, key)
        done = self.ok("dem-run", *self.command("--format", "json")).json
        self.assertAlmostEqual(got["steps"], done["steps"], delta=1)


if __name__ == "__main__":
    main()
