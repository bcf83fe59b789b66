# SPDX-License-Identifier: GPL-3.0-or-later
"""dem-run: triaxial tests of a small specimen, from the box to cohesion and friction angle."""
import json

import h5py
import numpy as np

from rank_runs import RankRuns, mpirun
from talus_tools import CONFIGURATION, DONE, INPUT, QUALITY, STOPPED, check_xdmf, copy_with, main, write_model

DIAMETER, HEIGHT = 1.2, 1.6  # m, of a specimen of some 380 grains with a radius of 9 cm
UNITS = {"axial_strain": b"", "volumetric_strain": b"", "axial_stress": b"Pa", "axial_stress_top": b"Pa",
         "axial_stress_bottom": b"Pa", "confining_stress": b"Pa", "confining_stress_target": b"Pa",
         "deviatoric_stress": b"Pa", "height": b"m", "area": b"m2"}


class TriaxialTests(RankRuns):
    def prepare(self):
        self.ok("pgbox-gen", "--radius", 0.09, "-j", 1, "-o", "box.h5")
        made = self.ok("tile-trim", "box.h5", "--cylinder", f"{DIAMETER},{HEIGHT}", "--surface-rule", "centre", "-o",
                       "model.h5", "--format", "json").json
        self.write("grains", str(made["particle_count"]))
        self.write("scene.json", {
            "material": {"friction": 0.4},
            "bond": {"bond_pressure": "13kPa", "bond_friction": 10, "bond_initiation_factor": 1.05},
            "stress_free_start": True, "output": {"frame_interval": "0.1s", "series_interval": "5ms"},
            "triaxial": {"confining_stress": "50kPa", "platen_velocity": "0.1m/s", "axial_strain": 0.02}})

    def arguments(self, output="run.h5", model="model.h5"):
        return [model, "-c", "scene.json", "-j", 1, "-q", "-o", output]

    def grains(self):
        return int((self.folder / "grains").read_text())

    def refuses(self, code, *more, names=(), model="model.h5", wrapper=()):
        """Exit code, words on standard error, no output."""
        got = self.run_tool("dem-run", *self.arguments("bad.h5", model), *more, wrapper=wrapper)
        self.assertEqual(got.code, code, str(got))
        for name in [names] if isinstance(names, str) else names:
            self.assertIn(name, got.err, str(got))
        self.assertNotIn("bad.h5", self.files())
        return got

    def test_curve(self):
        result = self.ok("dem-run", *self.arguments(), "--format", "json").json
        grains = self.grains()
        self.assertIn("bonds", result["kernel"])
        self.assertIn("materials", result["kernel"])  # the membrane's friction is its own
        self.assertLess(result["energy_error"], 0.01)
        self.assertGreater(result["particle_count"], grains + 200)
        check_xdmf(self, self.folder / "run.xdmf")
        with h5py.File(self.folder / "run.h5", "r") as file:
            series = file["granular/series"]
            self.assertEqual(sorted(series["triaxial"]), sorted(UNITS))
            for name, unit in UNITS.items():
                self.assertEqual(series["triaxial"][name].attrs.get("unit", b""), unit, name)
            self.assertEqual(series["unbalanced_force"].attrs.get("unit", b""), b"")
            curve = {name: series["triaxial"][name][:] for name in UNITS}
            stage, time = series["stage"][:], series["time"][:]
            bonds = series["bond_count"][:]
            breaks = {name: file["granular/bond_breakages"][name][:] for name in ("step", "time", "pair", "position")}
            species = file["particles/all/species"][:]
            frames = file["particles/all/position/value"][:]
            radius = file["particles/all/radius"][:]
            platens = [series[f"walls/platen_{name}/force_z"][:] for name in ("top", "bottom")]
        # Two stages, the stress brought up smoothly and then held.
        self.assertEqual(sorted(set(stage)), [0, 1])
        shear = stage == 1
        self.assertEqual(curve["confining_stress_target"][0], 0)
        self.assertTrue(np.all(np.diff(curve["confining_stress_target"][~shear]) >= 0))
        np.testing.assert_array_equal(curve["confining_stress_target"][shear], 5e4)
        self.assertLess(np.abs(curve["confining_stress"][shear] / 5e4 - 1).max(), 0.02)
        self.assertLess(abs(curve["axial_stress"][shear][0] / 5e4 - 1), 0.02)
        # What the columns say agrees.
        np.testing.assert_allclose(curve["axial_stress"],
                                   (curve["axial_stress_top"] + curve["axial_stress_bottom"]) / 2, atol=1e-6)
        np.testing.assert_allclose(curve["deviatoric_stress"], curve["axial_stress"] - curve["confining_stress"],
                                   atol=1e-6)
        height, area = curve["height"][shear], curve["area"][shear]
        np.testing.assert_allclose(curve["axial_strain"][shear], 1 - height / height[0], atol=1e-12)
        np.testing.assert_allclose(curve["volumetric_strain"][shear], 1 - height * area / (height[0] * area[0]),
                                   atol=1e-12)
        self.assertTrue(np.all(curve["axial_strain"][~shear] == 0))
        self.assertAlmostEqual(area[0], np.pi / 4 * DIAMETER**2, delta=0.1 * area[0])
        self.assertGreater(curve["axial_strain"][-1], 0.0195)  # the last row is within an interval of the end
        self.assertGreater(curve["deviatoric_stress"][shear].max(), 3e4)
        # Walls of the series: both platens are pushed outwards.
        self.assertGreater(platens[0][shear].min(), 0)
        self.assertLess(platens[1][shear].max(), 0)
        np.testing.assert_allclose(platens[0][shear], (curve["axial_stress_top"] * curve["area"])[shear], rtol=0.05)
        # The steady speed of the platen.
        late = shear & (curve["axial_strain"] > 0.01)
        speed = -np.polyfit(time[late], curve["height"][late], 1)[0]
        self.assertAlmostEqual(speed, 0.1, delta=1e-6)
        # The membrane stands behind the grains, at the outside and never among them.
        self.assertEqual(np.count_nonzero(species == 0), grains)
        np.testing.assert_array_equal(species[grains:], 2)
        self.assertEqual(len(species), result["particle_count"])
        outwards = np.hypot(*frames[0, :, :2].T)
        self.assertGreater(outwards[grains:].min(), outwards[:grains].max() - radius[0])
        # Bonds: none re-formed, each break once, between grains, at its place and time.
        self.assertEqual(len(breaks["step"]), bonds[0] - result["bonds"])
        self.assertEqual(len(breaks["step"]), result["bonds_broken"])
        self.assertGreater(len(breaks["step"]), 10)
        self.assertEqual(len(np.unique(breaks["pair"], axis=0)), len(breaks["pair"]))
        self.assertLess(breaks["pair"].max(), grains)
        self.assertTrue(np.all(np.diff(breaks["step"]) >= 0))
        np.testing.assert_allclose(breaks["time"], breaks["step"] * result["time_step"], rtol=1e-12)
        self.assertLess(np.hypot(*breaks["position"][:, :2].T).max(), DIAMETER)

    def test_same_bytes_with_two_threads(self):
        short = ["--triaxial.axial_strain", 0.003]
        self.ok("dem-run", *self.arguments("one.h5"), *short)
        two = [2 if word == 1 else word for word in self.arguments("two.h5")]
        self.ok("dem-run", *two, *short)
        self.assertSamePhysics("one.h5", "two.h5")

    def test_stopped_again_and_again(self):
        small = ["--time.step_fraction", 0.03, "--triaxial.axial_strain", 0.004]
        self.ok("dem-run", *self.arguments("whole.h5"), *small)
        codes = []
        for _ in range(60):
            got = self.run_tool("dem-run", *self.arguments(), *small, "--max-wall", "0.6s", "--resume", "auto")
            codes.append(got.code)
            if got.code != STOPPED:
                break
        self.assertEqual(codes[-1], DONE, str(got))
        self.assertIn(STOPPED, codes)
        self.assertSamePhysics("run.h5", "whole.h5")

    def test_stop_file_and_checkpoint_as_input(self):
        """A step after the start and a restart; and from the checkpoint alone."""
        small = ["--time.step_fraction", 0.1, "--triaxial.axial_strain", 0.003]
        self.ok("dem-run", *self.arguments("whole.h5"), *small)
        self.write("STOP", "")
        got = self.run_tool("dem-run", *self.arguments(), *small, "--checkpoint", "saved.h5")
        self.assertEqual(got.code, STOPPED, str(got))
        (self.folder / "STOP").unlink()
        self.ok("dem-run", *self.arguments("rest.h5", "saved.h5"), *small)
        self.ok("dem-run", *self.arguments(), *small, "--checkpoint", "saved.h5", "--resume", "auto")
        self.assertSamePhysics("run.h5", "whole.h5")
        with h5py.File(self.folder / "whole.h5", "r") as whole, h5py.File(self.folder / "rest.h5", "r") as rest:
            np.testing.assert_array_equal(whole["particles/all/position/value"][-1],
                                          rest["particles/all/position/value"][-1])
            for name in UNITS:
                self.assertEqual(whole[f"granular/series/triaxial/{name}"][-1],
                                 rest[f"granular/series/triaxial/{name}"][-1], name)

    def test_wrong_scenes(self):
        """Each in the scene's file, named with its place."""
        good = json.loads((self.folder / "scene.json").read_text())
        plane = {"point": [0, 0, 0], "normal": [0, 0, 1]}
        for changes, words in (
                ({"walls": [{"plane": plane}]}, ["/walls: ", "triaxial"]),
                ({"stages": [{"end": 1}]}, ["/stages: ", "triaxial"]),
                ({"time": {"end": 1}}, ["/time/end: ", "triaxial"]),
                ({"gravity": [0, 0, -1.62]}, ["/gravity: ", "triaxial"]),
                ({"box": {"lower": [0, 0, 0], "upper": [3, 3, 3]}}, ["/box", "triaxial"]),
                ({"contact": {"law": "linear", "normal_stiffness": 1e6, "tangential_stiffness": 1e6}}, ["linear"])):
            with self.subTest(list(changes)[0]):
                self.write("scene.json", good | changes)
                self.refuses(CONFIGURATION, names=words)
        for changes, words in (
                ({"confining_pressure": 1}, ["/triaxial/confining_pressure: ", '"confining_stress"']),
                ({"confining_stress": -1}, ["/triaxial/confining_stress: found -1"]),
                ({"platen_velocity": 0}, ["/triaxial/platen_velocity: found 0"]),
                ({"axial_strain": 2}, ["/triaxial/axial_strain: found 2"]),
                ({"membrane_radius": "2s"}, ["/triaxial/membrane_radius: ", "a time"]),
                ({"membrane_youngs_modulus": "100GPa"}, ["triaxial.membrane_youngs_modulus: 1e+11 Pa", "time.step"])):
            with self.subTest(list(changes)[0]):
                self.write("scene.json", good | {"triaxial": good["triaxial"] | changes})
                self.refuses(CONFIGURATION, names=words)
        self.write("scene.json", good | {"gravity": [0, 0, 0]})  # says nothing else
        self.ok("dem-run", *self.arguments("bad.h5"), "-n")

    def test_several_ranks(self):
        self.refuses(CONFIGURATION, names="MPI ranks", wrapper=mpirun(2))

    def test_wrong_models(self):
        self.ok("tile-trim", "box.h5", "--cylinder", f"{DIAMETER},{HEIGHT}", "--surface-rule", "centre", "--explicit",
                "-o", "model.h5", "--overwrite")

        def fix(file):
            species = np.zeros(len(file["particles/all/radius"]), "u1")
            species[7] = 1
            if "species" in file["particles/all"]:
                del file["particles/all/species"]
            file["particles/all/species"] = species

        copy_with(self.folder / "model.h5", self.folder / "fixed.h5", fix)
        self.refuses(INPUT, model="fixed.h5", names=("fixed.h5", "fixed grains"))
        write_model(self.folder / "two.h5", [[0, 0, 0], [0, 0, 0.18]], [0.09, 0.09])
        self.refuses(INPUT, model="two.h5", names=("two.h5", "too small", "membrane_radius"))
        write_model(self.folder / "sheet.h5", [[0, 0, 0], [0, 0, 0.18]], [0.09, 0.09], species=np.array([0, 2], "u1"))
        self.refuses(INPUT, model="sheet.h5", names=("sheet.h5", "membrane"))
        self.refuses(INPUT, "--set", "triaxial=null", "--time.end", "1s", model="sheet.h5", names="triaxial")

    def test_dry_run_predicts(self):
        told = self.ok("dem-run", *self.arguments(), "-n", "--format", "json").json
        self.assertNotIn("run.h5", self.files())
        got = self.ok("dem-run", *self.arguments(), "--format", "json").json
        for key in ("particle_count", "mobile_count", "time_step", "kernel"):
            self.assertEqual(told[key], got[key], key)
        self.assertLess(told["mobile_count"], told["particle_count"])  # the rings at the platens do not count
        self.assertLess(abs(np.log(told["steps"] / got["steps"])), np.log(3))
        self.assertGreater(told["expected_memory"], 100 * told["particle_count"])
        self.assertGreater(told["expected_run_time"], 0)

    def test_pushed_through_the_membrane(self):
        # Grains fit between three of the membrane's particles, whatever these are held by.
        got = self.run_tool("dem-run", *self.arguments(), "--triaxial.confining_stress", "500kPa",
                            "--triaxial.membrane_youngs_modulus", "1kPa", "--triaxial.membrane_radius", "16cm", "--set",
                            "bond=null", "--format", "json")
        self.assertEqual(got.code, QUALITY, str(got))
        self.assertEqual(len(got.err.splitlines()), 1, str(got))
        for words in ("outside the membrane", "triaxial.membrane_radius", "run.h5"):
            self.assertIn(words, got.err)
        self.assertIn(got.json["failure"], got.err)
        grain = int(got.err.split("particle ")[1].split(":")[0])
        self.assertLess(grain, self.grains())
        # Nothing is lost: the file is whole, its series goes up to there, and there is nothing to go on from.
        with h5py.File(self.folder / "run.h5", "r") as file:
            self.assertAlmostEqual(file["granular/series/time"][-1], got.json["time"], delta=1e-12)
        self.assertFalse([name for name in self.files() if name.endswith((".part", ".ckpt.h5"))])

    def test_cohesion_and_friction_angle(self):
        """Three confining stresses, 0 among them, and the fit through them."""
        names = []
        for stress in (0, 50, 100):
            names.append(f"s{stress}.h5")
            self.ok("dem-run", *self.arguments(names[-1]), "--triaxial.confining_stress", f"{stress}kPa",
                    "--triaxial.axial_strain", 0.03)
        self.ok("triax-fit", *names, "-o", "fit.json", "--format", "json", "--plot", "fit.svg")
        got = json.loads((self.folder / "fit.json").read_text())
        self.assertIn("fit.svg", self.files())
        asked = [test["confining_stress_asked"] for test in got["tests"]]
        np.testing.assert_allclose(asked, [0, 5e4, 1e5], atol=1e-9)
        peaks = [test["peak_deviatoric_stress"] for test in got["tests"]]
        self.assertTrue(peaks[0] < peaks[1] < peaks[2], peaks)
        self.assertGreater(got["internal_friction_angle"], 5)
        self.assertLess(got["internal_friction_angle"], 60)
        self.assertGreater(got["cohesion"], 0)
        self.assertLess(got["cohesion"], 5e4)


if __name__ == "__main__":
    main()
