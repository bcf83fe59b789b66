# SPDX-License-Identifier: GPL-3.0-or-later
"""pgbox-gen: boxes that are what they claim, the same bytes every time, and what it refuses."""
import h5py
import numpy as np

from common_behaviour import CommonBehaviour
from talus_tools import CONFIGURATION, INPUT, QUALITY, USAGE, ToolTest, is_fletcher32, main


def contacts_by_hand(position, radius, length):
    """Pairs (i < j) that overlap, through the faces too, with their overlaps."""
    branch = position[None, :, :] - position[:, None, :]
    branch -= length * np.round(branch / length)
    overlap = radius[:, None] + radius[None, :] - np.linalg.norm(branch, axis=2)
    i, j = np.nonzero(np.triu(overlap > 0, 1))
    return np.stack([i, j], axis=1), overlap[i, j]


class PgboxGen(CommonBehaviour, ToolTest):
    tool = "pgbox-gen"
    arguments = ("--radius", "0.09")
    keys = ("particle_count", "solid_volume_fraction", "coordination_number", "converged", "box_length")

    def input(self):
        return None

    def test_the_box_is_what_it_claims(self):
        for arguments in (["--radius", 0.06], ["--radius", "9cm", "--radius-min-ratio", 0.7, "--seed", 7]):
            with self.subTest(arguments):
                got = self.ok("pgbox-gen", *arguments, "-o", "box.h5", "--format", "json", "--overwrite").json
                self.assertIs(got["converged"], True)
                with h5py.File(self.folder / "box.h5", "r") as file:
                    position = file["particles/all/position"][:]
                    radius = file["particles/all/radius"][:]
                    mass = file["particles/all/mass"][:]
                    length = file["particles/all/box/edges"][0]
                    boundary = [b.decode() for b in file["particles/all/box"].attrs["boundary"]]
                    stored = file["connectivity/contacts"][:]
                    overlap = file["granular/contacts/normal_overlap"][:]
                    self.assertEqual(file["granular"].attrs["kind"], b"pgbox")
                    self.assertEqual(file["particles/all/position"].attrs["unit"], b"m")
                    self.assertEqual(file["particles/all/position"].dtype, np.float64)
                    self.assertEqual(file["granular/pgbox"].attrs["converged"], 1)
                    self.assertIn("history", file["granular/pgbox"])
                self.assertEqual(boundary, ["periodic"] * 3)
                self.assertEqual(len(position), got["particle_count"])
                self.assertTrue(np.all((position >= 0) & (position < length)))
                solid = np.sum(4 / 3 * np.pi * radius**3) / length**3
                self.assertAlmostEqual(solid, 0.64, delta=0.0005)
                self.assertAlmostEqual(got["solid_volume_fraction"], solid, delta=1e-9)
                np.testing.assert_allclose(mass, 4 / 3 * np.pi * radius**3 * 1000, rtol=1e-12)
                pairs, overlaps = contacts_by_hand(position, radius, length)
                order = np.lexsort((stored[:, 1], stored[:, 0]))
                np.testing.assert_array_equal(stored[order], pairs)
                np.testing.assert_allclose(overlap[order], overlaps, atol=1e-12)
                self.assertAlmostEqual(got["coordination_number"], 2 * len(pairs) / len(position), delta=1e-9)
                self.assertTrue(5.8 < got["coordination_number"] < 7, got["coordination_number"])
                # Net over mean contact force, from Hertz's law and the geometry alone.
                branch = position[pairs[:, 1]] - position[pairs[:, 0]]
                branch -= length * np.round(branch / length)
                normal = branch / np.linalg.norm(branch, axis=1)[:, None]
                reduced = radius[pairs[:, 0]] * radius[pairs[:, 1]] / radius[pairs].sum(axis=1)
                force = np.sqrt(reduced) * overlaps**1.5
                net = np.zeros_like(position)
                np.add.at(net, pairs[:, 0], -force[:, None] * normal)
                np.add.at(net, pairs[:, 1], force[:, None] * normal)
                self.assertLess(np.linalg.norm(net, axis=1).mean() / force.mean(), 1e-3)
                spread = radius.min() / radius.max()
                self.assertTrue(spread == 1 if "--radius-min-ratio" not in arguments else 0.7 <= spread < 0.75, spread)
                for dataset in ("particles/all/position", "particles/all/radius", "connectivity/contacts"):
                    self.assertTrue(is_fletcher32(self.folder / "box.h5", dataset), dataset)

    def test_same_bytes_every_time(self):
        made = []
        for name, arguments in (("a", ["-j", 1]), ("b", ["-j", 2]), ("c", ["-j", 2]), ("d", ["-j", 1, "--seed", 2])):
            self.ok("pgbox-gen", "--radius", 0.07, "--radius-min-ratio", 0.82, "--no-provenance", "-o", f"{name}.h5",
                    *arguments)
            made.append((self.folder / f"{name}.h5").read_bytes())
        self.assertEqual(made[0], made[1], "one thread and two")
        self.assertEqual(made[1], made[2], "a second time")
        self.assertNotEqual(made[0], made[3], "another seed")

    def test_configuration_file_is_as_good_as_switches(self):
        self.write("box.json", '{"radius": "9cm", "seed": 3, // a comment\n "material": {"youngs_modulus": "50MPa"}}')
        self.ok("pgbox-gen", "-c", "box.json", "--no-provenance", "-o", "a.h5")
        self.ok("pgbox-gen", "--radius", 0.09, "--seed", 3, "--material.youngs-modulus", 5e7, "--no-provenance",
                "-o", "b.h5")
        self.ok("pgbox-gen", "--set", "radius=90mm", "--set", "seed=3", "--set", "material.youngs_modulus=50MPa",
                "--no-provenance", "-o", "c.h5")
        a, b, c = ((self.folder / f"{name}.h5").read_bytes() for name in "abc")
        self.assertEqual(a, b)
        self.assertEqual(a, c)

    def test_provenance(self):
        self.ok("pgbox-gen", "--radius", 0.09, "--seed", 5, "-o", "box.h5")
        with h5py.File(self.folder / "box.h5", "r") as file:
            record = file["granular/provenance/0000"]
            self.assertEqual(record.attrs["program"], b"pgbox-gen")
            self.assertEqual(record["seed"][0], 5)
            self.assertIn(b"--seed 5", record["command_line"][()])
        self.ok("pgbox-gen", "--radius", 0.09, "--no-provenance", "-o", "bare.h5")
        with h5py.File(self.folder / "bare.h5", "r") as file:
            self.assertEqual(len(file.get("granular/provenance", ())), 0)

    def test_radius_larger_than_the_box(self):
        for radius in (0.25, 0.6, 5):
            self.fails(CONFIGURATION, "pgbox-gen", "--radius", radius, "-o", "x.h5", names=["radius", radius])
        self.assertEqual(self.files(), [])

    def test_values_out_of_range(self):
        for arguments in (["--radius", -1], ["--radius", "nan"], ["--radius", "inf"], ["--radius", "5kg"],
                          ["--solid-volume-fraction", 1.2], ["--radius-min-ratio", 0]):
            with self.subTest(arguments):
                self.fails(USAGE, "pgbox-gen", *arguments, "-o", "x.h5", names=arguments[0])
        self.write("nan.json", '{"radius": "nan", "solid_volume_fraction": 2}')
        got = self.run_tool("pgbox-gen", "-c", "nan.json", "-o", "x.h5")
        self.assertEqual(got.code, CONFIGURATION)
        self.assertIn('nan.json:1:12: error: /radius: found "nan"', got.err)
        self.assertIn("/solid_volume_fraction: found 2, expected", got.err)
        self.assertEqual(self.files(), ["nan.json"])

    def test_not_converged(self):
        got = self.fails(QUALITY, "pgbox-gen", "--radius", 0.06, "--iterations", 20, "-o", "x.h5",
                         names="not converged")
        self.assertIn("iterations", got.err)
        self.assertEqual(self.files(), [])

    def test_dry_run_tells_the_cost(self):
        got = self.ok("pgbox-gen", "--radius", 0.03, "-n", "--format", "json").json
        self.assertAlmostEqual(got["particle_count"], 0.64 / (4 / 3 * np.pi * 0.03**3), delta=1)
        for key in ("memory", "disk", "expected_wall_time"):
            self.assertGreater(got[key], 0)

    def test_grading(self):
        self.write("soil.csv", "# sieves\ndiameter,percent_finer\n1mm,0\n1.4mm,45\n2mm,100\n")
        got = self.ok("pgbox-gen", "--radius", "10cm", "--grading", "soil.csv", "--solid-volume-fraction", 0.67, "-o",
                      "box.h5", "--format", "json").json
        with h5py.File(self.folder / "box.h5", "r") as file:
            radius = np.sort(file["particles/all/radius"][:])
            grading = file["granular/pgbox/grading"]
            diameter, finer = grading["diameter"][:], grading["fraction_finer"][:]
            self.assertEqual(grading["diameter"].attrs["unit"], b"m")
            np.testing.assert_allclose(grading["asked/diameter"][:], [0.1, 0.14, 0.2])
            np.testing.assert_array_equal(grading["asked/fraction_finer"][:], [0, 0.45, 1])
            self.assertEqual(got["grading_distance"], file["granular/pgbox"].attrs["grading_distance"])
        self.assertAlmostEqual(np.sum(4 / 3 * np.pi * radius**3), 0.67, delta=1e-9)
        mass = np.cumsum(radius**3) / np.sum(radius**3)
        np.testing.assert_allclose(finer, [mass[np.sum(2 * radius <= d) - 1] for d in diameter], atol=1e-12)
        self.assertEqual((got["grading"]["diameter"], got["grading"]["fraction_finer"]), (list(diameter), list(finer)))
        # Semi-logarithmic between the laboratory's points, as near as whole grains allow.
        asked = np.interp(np.log(2 * radius), np.log([0.1, 0.14, 0.2]), [0, 0.45, 1])
        self.assertLess(np.max(np.abs(mass - asked)), 0.01)
        self.assertLess(got["grading_distance"], 0.01)

    def test_gradings_that_are_refused(self):
        self.write("soil.csv", "diameter,fraction_finer\n0.2mm,0\n2mm,1\n")
        self.write("falls.csv", "diameter,fraction_finer\n1mm,0\n2mm,0.6\n3mm,0.5\n4mm,1\n")
        before = self.files()
        self.fails(INPUT, "pgbox-gen", "--grading", "falls.csv", "-o", "x.h5", names="falls.csv:4: fraction_finer")
        self.fails(INPUT, "pgbox-gen", "--grading", "none.csv", "-o", "x.h5", names="none.csv")
        self.fails(CONFIGURATION, "pgbox-gen", "--grading", "soil.csv", "--box-length", 1, "-o", "x.h5", names="grains")
        self.fails(CONFIGURATION, "pgbox-gen", "--grading", "soil.csv", "--radius", 0.3, "-o", "x.h5", names="radius")
        self.fails(USAGE, "pgbox-gen", "--grading", "soil.csv", "--radius-min-ratio", 0.5, "-o", "x.h5",
                   names=["--radius-min-ratio", "grading"])
        self.assertEqual(self.files(), before)

    def test_sediment_route(self):
        arguments = ["--route", "sediment", "--radius", 0.08, "--friction", 0.4, "--no-provenance"]
        got = self.ok("pgbox-gen", *arguments, "--keep-stages", "-o", "box.pgbox.h5", "--format", "json").json
        self.assertAlmostEqual(got["solid_volume_fraction"], 0.64, delta=5e-4)
        self.assertEqual(got["particle_count"], round(0.64 / (4 / 3 * np.pi * 0.08**3)))
        self.assertLess(got["unbalanced_force"], 1e-3)
        self.assertTrue(0.57 < got["sediment_solid_volume_fraction"] < 0.63)
        with h5py.File(self.folder / "box.pgbox.h5", "r") as file:
            position, length = file["particles/all/position"][:], file["particles/all/box/edges"][0]
            radius = file["particles/all/radius"][:]
            pairs, image = file["connectivity/contacts"][:], file["granular/contacts/image"][:]
            overlap = file["granular/contacts/normal_overlap"][:]
            displacement = file["granular/contacts/tangential_displacement"][:]
            self.assertEqual(file["granular/contacts/tangential_displacement"].attrs["unit"], b"m")
            history = file["granular/pgbox/history"]
            self.assertEqual(sorted(set(history["stage"][:])), [1, 2, 3, 4])
            self.assertTrue(np.all(np.diff(history["time"][:]) >= 0))
        # Every grain in balance, from the file alone: Hertz and Mindlin by hand.
        branch = position[pairs[:, 1]] + length * image - position[pairs[:, 0]]
        normal = branch / np.linalg.norm(branch, axis=1)[:, None]
        reduced = radius[pairs[:, 0]] * radius[pairs[:, 1]] / radius[pairs].sum(axis=1)
        stiffness = 2 * 1e8 / (3 * (1 - 0.2**2)) * np.sqrt(reduced * overlap)
        tangential = -(3 * (1 - 0.2) / (2 - 0.2) * stiffness)[:, None] * displacement
        self.assertLess(np.max(np.linalg.norm(tangential, axis=1) / (0.4 * stiffness * overlap)), 1 + 1e-6)
        force = -(stiffness * overlap)[:, None] * normal + tangential
        net = np.zeros_like(position)
        np.add.at(net, pairs[:, 0], force)
        np.add.at(net, pairs[:, 1], -force)
        self.assertLess(np.linalg.norm(net, axis=1).mean() / (stiffness * overlap).mean(), 1e-3)
        # The stages are models that dem-run takes.
        for stage in ("sediment", "cut", "compressed", "homogenised"):
            with h5py.File(self.folder / f"box.{stage}.model.h5", "r") as file:
                self.assertEqual(file["granular"].attrs["complete"], 1)
                self.assertGreaterEqual(len(file["particles/all/position"]), got["particle_count"])
        self.ok("pgbox-gen", *arguments, "-j", 1, "-o", "again.h5")
        with h5py.File(self.folder / "again.h5", "r") as file:
            np.testing.assert_array_equal(file["particles/all/position"][:], position)

    def test_sediment_that_does_not_converge(self):
        for setting, measure in (("settle_limit=3.2", "settle_limit"), ("relax_limit=0.1", "unbalanced_force")):
            limits = ["--set", "sediment.settle_unbalanced_force=1e-9"] if "settle" in setting else [
                "--set", "sediment.unbalanced_force=1e-9"]
            got = self.fails(QUALITY, "pgbox-gen", "--route", "sediment", "--radius", 0.09, "--friction", 0.4, *limits,
                             "--set", "sediment." + setting, "-o", "x.h5", names="not converged")
            self.assertIn(measure, got.err)
        self.assertEqual(self.files(), [])

    def test_compression_with_friction(self):
        arguments = ["--radius", 0.08, "--friction", 0.4, "--no-provenance"]
        got = self.ok("pgbox-gen", *arguments, "-o", "box.pgbox.h5", "--format", "json").json
        self.assertAlmostEqual(got["solid_volume_fraction"], 0.64, delta=5e-4)
        self.assertLess(got["unbalanced_force"], 1e-3)
        self.assertTrue(5.5 < got["coordination_number"] < 6.5, got["coordination_number"])
        stress = np.array([got["stress_" + axis] for axis in "xyz"])
        self.assertAlmostEqual(np.max(np.abs(stress / stress.mean() - 1)), got["stress_deviation"], delta=1e-9)
        self.assertLess(got["stress_deviation"], 0.3 / np.sqrt(got["particle_count"]))
        with h5py.File(self.folder / "box.pgbox.h5", "r") as file:
            position, length = file["particles/all/position"][:], file["particles/all/box/edges"][0]
            radius = file["particles/all/radius"][:]
            pairs, image = file["connectivity/contacts"][:], file["granular/contacts/image"][:]
            displacement = file["granular/contacts/tangential_displacement"][:]
            history = {key: column[:] for key, column in file["granular/pgbox/history"].items()}
        # The stresses of normal and tangential forces, from the file alone.
        branch = position[pairs[:, 1]] + length * image - position[pairs[:, 0]]
        distance = np.linalg.norm(branch, axis=1)
        overlap = radius[pairs].sum(axis=1) - distance
        reduced = radius[pairs[:, 0]] * radius[pairs[:, 1]] / radius[pairs].sum(axis=1)
        stiffness = 2 * 1e8 / (3 * (1 - 0.2**2)) * np.sqrt(reduced * overlap)
        force = (stiffness * overlap / distance)[:, None] * branch + (
            3 * (1 - 0.2) / (2 - 0.2) * stiffness)[:, None] * displacement
        np.testing.assert_allclose((force * branch).sum(axis=0) / length**3, stress, rtol=3e-3)
        self.assertTrue(np.all(np.diff(history["step"]) >= 0))
        self.assertAlmostEqual(history["solid_volume_fraction"][-1], 0.64, delta=1e-9)
        self.assertLess(history["cell_deviation"][-1], 1e-12)
        self.ok("pgbox-gen", *arguments, "-j", 1, "-o", "again.h5")
        with h5py.File(self.folder / "again.h5", "r") as file:
            np.testing.assert_array_equal(file["particles/all/position"][:], position)

    def test_compression_with_friction_that_falls_short(self):
        for settings, measure in ((["servo.detours=0", "servo.stress_tolerance=1e-4"], "stress_deviation"),
                                  (["servo.unbalanced_force=1e-12", "servo.relax_steps=1000"], "unbalanced_force"),
                                  (["servo.compression_steps=200"], "solid_volume_fraction")):
            sets = [part for setting in settings for part in ("--set", setting)]
            got = self.fails(QUALITY, "pgbox-gen", "--radius", 0.09, "--friction", 0.4, *sets, "-o", "x.h5",
                             names="not converged")
            self.assertIn(measure, got.err)
        self.fails(USAGE, "pgbox-gen", "--radius", 0.09, "--friction", 0.4, "--attempts", 3, "-o", "x.h5",
                   names="attempts")
        self.assertEqual(self.files(), [])


if __name__ == "__main__":
    main()
