# SPDX-License-Identifier: GPL-3.0-or-later
"""triax-fit: the published peaks give the published strength, curves made by hand give theirs back."""
import csv

import numpy as np

from common_behaviour import CommonBehaviour
from talus_tools import EXISTS, INPUT, QUALITY, USAGE, ToolTest, copy_with, flip_byte, main, write_model

# Peak deviatoric stresses (kPa) at confining stresses of 0, 100 and 200 kPa: Chen, Furuichi, Nishiura, Table 3;
# cohesion (kPa) and angle (deg) of the least-squares tangent (reference case e01).
SPECIMENS = {"SPL1": ([91.45, 335.48, 614.17], 22.47056, 34.52062),
             "SPL2": ([91.36, 332.19, 602.16], 22.89646, 34.12328),
             "SPL3": ([90.12, 340.44, 629.08], 21.7053, 35.04595)}


def peaks(values, confining=(0, 1e5, 2e5)):
    return "confining_stress,peak_deviatoric_stress\n" + "".join(f"{c:.17g},{q:.17g}\n"
                                                                  for c, q in zip(confining, values))


class TriaxFit(CommonBehaviour, ToolTest):
    tool = "triax-fit"
    needs_output = False
    keys = ("cohesion", "internal_friction_angle", "tests", "fit_rms")

    def input(self):
        return "unused"  # named in the help

    def command(self, *more, output=None, source=None):
        self.write("peaks.csv", peaks(1e3 * np.array(SPECIMENS["SPL1"][0])))
        return ["--peaks", "peaks.csv", *(["-o", output] if output else []), *more]

    def test_published_peaks(self):
        for name, (q, cohesion, angle) in SPECIMENS.items():
            with self.subTest(name):
                self.write("peaks.csv", peaks(1e3 * np.array(q)))
                got = self.ok("triax-fit", "--peaks", "peaks.csv", "--format", "json").json
                self.assertAlmostEqual(got["cohesion"] / 1e3, cohesion, delta=0.005)
                self.assertAlmostEqual(got["internal_friction_angle"], angle, delta=0.002)
                self.assertEqual([test["confining_stress"] for test in got["tests"]], [0, 1e5, 2e5])
                np.testing.assert_allclose([test["peak_deviatoric_stress"] for test in got["tests"]],
                                           1e3 * np.array(q), rtol=1e-12)

    def test_exact_envelope(self):
        """Peaks on a straight Mohr-Coulomb line give it back, with nothing left over."""
        cohesion, angle = 12e3, np.radians(31)
        confining = np.array([0, 5e4, 1e5, 2e5, 4e5])
        factor = (1 + np.sin(angle)) / (1 - np.sin(angle))
        self.write("peaks.csv", peaks(confining * (factor - 1) + 2 * cohesion * np.sqrt(factor), confining))
        got = self.ok("triax-fit", "--peaks", "peaks.csv", "--format", "json").json
        self.assertAlmostEqual(got["cohesion"], cohesion, delta=1e-3)
        self.assertAlmostEqual(got["internal_friction_angle"], 31, delta=1e-6)
        self.assertLess(got["fit_rms"], 1e-3)

    def test_residual_of_the_fit(self):
        """fit_rms against numpy's least squares."""
        q = 1e3 * np.array(SPECIMENS["SPL3"][0])
        s, t = np.array([0, 1e5, 2e5]) + q / 2, q / 2
        slope, intercept = np.polyfit(s, t, 1)
        self.write("peaks.csv", peaks(q))
        got = self.ok("triax-fit", "--peaks", "peaks.csv", "--format", "json").json
        rest = t - intercept - slope * s
        self.assertTrue(any(np.isclose(got["fit_rms"], np.sqrt(np.sum(rest**2) / n), rtol=1e-6) for n in (3, 1)), got)

    def test_forms_of_the_table(self):
        """A byte-order mark, other columns, comments, quotes, Windows line ends."""
        q = 1e3 * np.array(SPECIMENS["SPL1"][0])
        plain = self.ok("triax-fit", *self.command("--format", "json")).json
        text = "\ufeff# peaks\r\nname,\"peak_deviatoric_stress\",confining_stress\r\n" + "".join(
            f"t{k},{value:.17g},{k * 1e5}\r\n" for k, value in enumerate(q))
        (self.folder / "other.csv").write_bytes(text.encode())
        got = self.ok("triax-fit", "--peaks", "other.csv", "--format", "json").json
        self.assertEqual(got["cohesion"], plain["cohesion"])

    def test_bad_tables(self):
        cases = {"word": ("confining_stress,peak_deviatoric_stress\n0,91e3\n1e5,many\n", 3, "many"),
                 "nan": ("confining_stress,peak_deviatoric_stress\n0,nan\n", 2, "nan"),
                 "fields": ("confining_stress,peak_deviatoric_stress\n0,91e3\n1e5,3e5\n2e5\n", 4, "columns"),
                 "column": ("confining_stress,peak\n0,91e3\n", 1, "peak_deviatoric_stress"),
                 "negative": ("confining_stress,peak_deviatoric_stress\n0,-5\n", 2, "positive"),
                 "empty": ("", 1, "empty")}
        for name, (text, line, word) in cases.items():
            with self.subTest(name):
                self.write(f"{name}.csv", text)
                self.fails(INPUT, "triax-fit", "--peaks", f"{name}.csv", names=[f"{name}.csv:{line}: ", word])
        self.fails(INPUT, "triax-fit", "--peaks", "absent.csv", names="absent.csv")
        self.fails(INPUT, "triax-fit", "--peaks", ".", names=".")

    def test_impossible_fits(self):
        cases = {"one test": ([91e3], [0]), "the same confining stress": ([91e3, 92e3], [1e5, 1e5]),
                 "steeper than any angle": ([1e3, 1e9], [0, -4e8])}
        for what, (q, confining) in cases.items():
            with self.subTest(what):
                self.write("peaks.csv", peaks(q, confining))
                self.fails(QUALITY, "triax-fit", "--peaks", "peaks.csv", "-o", "fit.json")
        self.assertEqual(self.files(), ["peaks.csv"])

    def test_nothing_to_fit(self):
        self.fails(USAGE, "triax-fit", names="--peaks")

    # From trajectories ---------------------------------------------------------------------------------------------

    def trajectory(self, name, confining, peak, residual, change=None):
        """A run's file with a stress-strain curve put into it: rises to `peak` at 3 % strain, falls to `residual`
        well before 11 %."""
        if not (self.folder / "run.h5").exists():
            write_model(self.folder / "one.h5", [[0, 0, 0]], [0.001])
            self.ok("dem-run", "one.h5", "--time.end", "1ms", "-o", "run.h5")
        strain = np.linspace(0, 0.13, 1301)
        stress = np.where(strain < 0.03, peak * np.sin(np.pi / 2 * strain / 0.03),
                          residual + (peak - residual) * np.exp(-(strain - 0.03) / 0.004))

        def add(file):
            for column, values in (("axial_strain", strain), ("volumetric_strain", -0.3 * strain),
                                   ("deviatoric_stress", stress), ("axial_stress", stress + confining),
                                   ("confining_stress", np.full_like(strain, confining))):
                file.create_dataset(f"granular/series/triaxial/{column}", data=values, chunks=values.shape,
                                    fletcher32=True)
            if change:
                change(file)

        copy_with(self.folder / "run.h5", self.folder / name, add)
        return name

    def test_trajectories(self):
        q = 1e3 * np.array(SPECIMENS["SPL2"][0])
        names = [self.trajectory(f"t{k}.h5", 1e5 * k, q[k], 0.6 * q[k]) for k in range(3)]
        got = self.ok("triax-fit", *names, "--format", "json").json
        self.assertAlmostEqual(got["cohesion"] / 1e3, 22.89646, delta=0.005)
        self.assertAlmostEqual(got["internal_friction_angle"], 34.12328, delta=0.002)
        for k, test in enumerate(got["tests"]):
            self.assertAlmostEqual(test["confining_stress"], 1e5 * k, delta=1e-6)
            self.assertAlmostEqual(test["peak_deviatoric_stress"] / q[k], 1, 9)
            self.assertAlmostEqual(test["peak_strain"], 0.03, delta=1e-4)
            self.assertAlmostEqual(test["residual_deviatoric_stress"] / (0.6 * q[k]), 1, delta=1e-6)
            self.assertAlmostEqual(test["residual_ratio"], 0.6, delta=1e-6)

    # A material with known constants -------------------------------------------------------------------------------

    def material_curve(self, confining, cohesion=15e3, angle=33, youngs=2e7, poisson=0.22, dilatancy=12, last=0.13):
        """Linear elastic, perfectly plastic with a constant dilatancy: strain, stress, volumetric strain."""
        sine, psi = np.sin(np.radians(angle)), np.sin(np.radians(dilatancy))
        peak = confining * 2 * sine / (1 - sine) + 2 * cohesion * np.sqrt((1 + sine) / (1 - sine))
        strain = np.linspace(0, last, 1301)
        elastic = np.minimum(strain, peak / youngs)
        return strain, youngs * elastic, (1 - 2 * poisson) * elastic - 2 * psi / (1 - psi) * (strain - elastic)

    def sheared(self, name, confining, target=None, achieved=None, **material):
        strain, stress, volume = self.material_curve(confining, **material)

        def change(file):
            group = file["granular/series/triaxial"]
            for column, values in (("axial_strain", strain), ("deviatoric_stress", stress),
                                   ("volumetric_strain", volume)):
                group[column][...] = values
            if achieved is not None:
                group["confining_stress"][...] = achieved
            if target is not None:
                group.create_dataset("confining_stress_target", data=np.full_like(strain, target), chunks=strain.shape,
                                     fletcher32=True)

        return self.trajectory(name, confining, 1e5, 1e5, change)

    def laboratory(self, name, confining, volume=True, **material):
        strain, stress, swelling = self.material_curve(confining, **material)
        rows = zip(strain, stress, np.full_like(strain, confining), swelling)
        columns = 4 if volume else 3
        header = ("axial_strain", "deviatoric_stress", "confining_stress", "volumetric_strain")[:columns]
        return self.write(name, "# measured\n" + ",".join(header) + "\n" + "".join(
            ",".join(f"{value:.17g}" for value in row[:columns]) + "\n" for row in rows))

    def test_constants_of_a_material(self):
        names = [self.sheared(f"t{k}.h5", 1e5 * k, target=1e5 * k) for k in range(3)]
        got = self.ok("triax-fit", *names, "--format", "json").json
        self.assertAlmostEqual(got["cohesion"], 15e3, delta=1e-2)
        self.assertAlmostEqual(got["internal_friction_angle"], 33, delta=1e-6)
        self.assertAlmostEqual(got["residual_cohesion"], 15e3, delta=1e-2)
        self.assertAlmostEqual(got["residual_internal_friction_angle"], 33, delta=1e-6)
        self.assertIsNone(got["laboratory"])
        for k, test in enumerate(got["tests"]):
            self.assertAlmostEqual(test["youngs_modulus"] / 2e7, 1, delta=1e-9)
            self.assertAlmostEqual(test["poissons_ratio"], 0.22, delta=1e-9)
            self.assertAlmostEqual(test["dilatancy_angle"], 12, delta=1e-6)
            self.assertGreater(test["dilatancy_strain"], test["peak_strain"])
            self.assertEqual((test["confining_stress_asked"], test["held"]), (1e5 * k, True))
            self.assertAlmostEqual(test["fit_residual"], 0, delta=1e-3)

    def test_without_volume_or_target(self):
        name = self.sheared("a.h5", 0), self.trajectory("b.h5", 1e5, 3e5, 2e5, lambda file: file[
            "granular/series/triaxial"].__delitem__("volumetric_strain"))
        first, second = self.ok("triax-fit", *name, "--format", "json").json["tests"]
        for test in first, second:
            self.assertIsNone(test["confining_stress_asked"])
            self.assertIsNone(test["held"])
        for key in ("poissons_ratio", "dilatancy_angle", "dilatancy_strain", "volumetric_strain_at_peak"):
            self.assertIsNone(second[key], key)
            self.assertIsNotNone(first[key], key)

    def test_confining_stress_not_held(self):
        """The result and the picture are written all the same; which test and by how much is said."""
        names = [self.sheared("a.h5", 0, target=0, achieved=100),
                 self.sheared("b.h5", 1e5, target=1e5, achieved=0.97e5),
                 self.sheared("c.h5", 2e5, target=2e5)]
        got = self.run_tool("triax-fit", *names, "--format", "json", "--plot", "fit.svg")
        self.assertEqual(got.code, QUALITY, str(got))
        self.assertEqual([test["held"] for test in got.json["tests"]], [True, False, True])
        warning, error = got.err.splitlines()
        self.assertIn("b.h5: confining stress 97000 Pa", warning)
        self.assertIn("3 % of the stress asked for", warning)
        self.assertTrue(error.startswith("triax-fit: error: 1 of 3 tests"), str(got))
        self.assertIn("b.h5", error)
        self.assertIn("fit.svg", self.files())
        self.fails(QUALITY, "triax-fit", *names, "-q", "-o", "fit.json", names="b.h5")
        self.assertIn("fit.json", self.files())
        self.ok("triax-fit", *names, "--confining_tolerance", 0.04)
        # Without confinement the peak is the measure.
        worst = self.sheared("d.h5", 0, target=0, achieved=2500)
        got = self.run_tool("triax-fit", worst, names[2], "--format", "json")
        self.assertEqual(got.code, QUALITY, str(got))
        self.assertIn("peak deviatoric stress", got.err)

    def test_target_of_the_scene(self):
        """Where the series has no target the run's configuration tells it."""
        def configured(file):
            file["granular/series/triaxial/confining_stress"][...] = 0.9e5
            del file["parameters/config"]
            file["parameters/config"] = np.bytes_('{"triaxial": {"confining_stress": 100000.0}}')

        names = self.sheared("a.h5", 0), self.trajectory("b.h5", 1e5, 3e5, 2e5, configured)
        got = self.run_tool("triax-fit", *names, "--format", "json")
        self.assertEqual(got.code, QUALITY, str(got))
        self.assertEqual([test["confining_stress_asked"] for test in got.json["tests"]], [None, 1e5])

    # Beside the laboratory -----------------------------------------------------------------------------------------

    def test_laboratory_alone(self):
        curves = [part for k in range(3) for part in ("--curve", self.laboratory(f"l{k}.csv", 1e5 * k))]
        got = self.ok("triax-fit", *curves, "--format", "json", "--plot", "fit.svg").json
        self.assertAlmostEqual(got["cohesion"], 15e3, delta=1e-2)
        self.assertAlmostEqual(got["internal_friction_angle"], 33, delta=1e-6)
        self.assertIsNone(got["laboratory"])
        self.assertEqual([test["laboratory"] for test in got["tests"]], [True] * 3)
        for test in got["tests"]:
            self.assertAlmostEqual(test["youngs_modulus"] / 2e7, 1, delta=1e-9)
            self.assertAlmostEqual(test["dilatancy_angle"], 12, delta=1e-6)

    def test_laboratory_beside_computed(self):
        names = [self.sheared(f"t{k}.h5", 1e5 * k) for k in range(3)]
        curves = [part for k in range(3) for part in (
            "--curve", self.laboratory(f"l{k}.csv", 5e4 + 1e5 * k, volume=k > 0, cohesion=21e3, angle=36))]
        alone = self.ok("triax-fit", *names, "--format", "json").json
        got = self.ok("triax-fit", *curves, *names, "--format", "json", "--plot", "fit.svg").json
        for key in ("cohesion", "internal_friction_angle", "fit_rms", "tests"):
            self.assertEqual(got[key], alone[key])
        laboratory = got["laboratory"]
        self.assertAlmostEqual(laboratory["cohesion"], 21e3, delta=1e-2)
        self.assertAlmostEqual(laboratory["internal_friction_angle"], 36, delta=1e-6)
        self.assertLess(laboratory["fit_rms"], 1)
        self.assertEqual([test["source"] for test in laboratory["tests"]], ["l0.csv", "l1.csv", "l2.csv"])
        self.assertIsNone(laboratory["tests"][0]["poissons_ratio"])
        picture = (self.folder / "fit.svg").read_text()
        for words in ("laboratory: c = 21.00 kPa", "Change of volume", "150 kPa, laboratory, l1.csv",
                      "stroke-dasharray"):
            self.assertIn(words, picture)
        # One curve is drawn, and that it cannot be fitted is said.
        got = self.ok("triax-fit", *names, *curves[:2], "--format", "json")
        self.assertIn("drawn but not fitted", got.err)
        self.assertIsNone(got.json["laboratory"]["cohesion"])
        self.assertEqual(len(got.json["laboratory"]["tests"]), 1)

    def test_bad_laboratory_curves(self):
        head = "axial_strain,deviatoric_stress,confining_stress\n"
        cases = {"word": (head + "0,0,1e5\n0.01,many,1e5\n", ":3:6: deviatoric_stress: ", "many"),
                 "percent": (head + "0,0,1e5\n1.5,2e4,1e5\n", ":3:1: axial_strain: ", "fraction"),
                 "unloading": (head + "0,0,1e5\n0.02,2e4,1e5\n0.01,1e4,1e5\n", ":4:1: axial_strain: ", "falls"),
                 "fields": (head + "0,0\n", ":2: ", "columns"),
                 "column": ("axial_strain,confining_stress\n0,1e5\n", ":1: ", "deviatoric_stress"),
                 "empty": ("", ":1: ", "empty")}
        for name, (text, place, word) in cases.items():
            with self.subTest(name):
                self.write(f"{name}.csv", text)
                self.fails(INPUT, "triax-fit", "--curve", f"{name}.csv", names=[f"{name}.csv{place}", word])
        self.fails(INPUT, "triax-fit", "--curve", "absent.csv", names="absent.csv")

    def test_table(self):
        names = [self.sheared(f"t{k}.h5", 1e5 * k, target=1e5 * k) for k in range(3)]
        got = self.ok("triax-fit", *names, "--table", "tests.csv", "--format", "json").json
        lines = (self.folder / "tests.csv").read_text().splitlines()
        self.assertTrue(lines[0].startswith("# peak: cohesion 15000"), lines[0])
        rows = list(csv.DictReader(line for line in lines if not line.startswith("#")))
        self.assertEqual(len(rows), 3)
        for row, test in zip(rows, got["tests"]):
            self.assertEqual(set(row), set(test))
            for key in set(row) - {"source", "laboratory", "held", "fit_residual"}:
                self.assertTrue(np.isclose(float(row[key]), test[key], rtol=1e-8, atol=1e-12), key)
            self.assertEqual((row["source"], row["held"], row["laboratory"]), (test["source"], "1", "0"))
        again = self.ok("triax-fit", "--peaks", "tests.csv", "--format", "json").json
        self.assertAlmostEqual(again["cohesion"], got["cohesion"], delta=1e-2)
        self.fails(EXISTS, "triax-fit", *names, "--table", "tests.csv", names="tests.csv")

    def test_plot(self):
        names = [self.trajectory(f"t{k}.h5", 1e5 * k, 1e5 + 2e5 * k, 1e5 + 1e5 * k) for k in range(2)]
        self.ok("triax-fit", *names, "--plot", "fit.svg")
        picture = (self.folder / "fit.svg").read_text()
        self.assertIn("</svg>", picture)
        self.fails(EXISTS, "triax-fit", *names, "--plot", "fit.svg", names="fit.svg")
        self.assertEqual((self.folder / "fit.svg").read_text(), picture)

    def test_damaged_trajectories(self):
        good = self.trajectory("good.h5", 0, 9e4, 5e4)
        flip_byte(self.folder / good, self.folder / "flipped.h5", "/granular/series/triaxial/deviatoric_stress")
        self.fails(INPUT, "triax-fit", good, "flipped.h5", names=["flipped.h5", "deviatoric_stress"])
        self.trajectory("nan.h5", 1e5, 2e5, 1e5,
                        lambda file: file["granular/series/triaxial/deviatoric_stress"].__setitem__(100, np.nan))
        self.fails(INPUT, "triax-fit", good, "nan.h5", names=["nan.h5"])
        self.fails(INPUT, "triax-fit", good, "run.h5", names=["run.h5", "/granular/series/triaxial/axial_strain"])
        self.fails(INPUT, "triax-fit", good, "absent.h5", names="absent.h5")
        self.fails(INPUT, "triax-fit", good, "one.h5", names=["one.h5", "model"])
        self.trajectory("uneven.h5", 1e5, 2e5, 1e5, lambda file: file["granular/series/triaxial"].__delitem__(
            "confining_stress"))
        self.fails(INPUT, "triax-fit", good, "uneven.h5", names=["uneven.h5", "confining_stress"])


if __name__ == "__main__":
    main()
