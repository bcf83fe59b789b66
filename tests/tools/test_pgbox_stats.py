# SPDX-License-Identifier: GPL-3.0-or-later
"""pgbox-stats: its numbers against the same measures in numpy, its pictures, and damaged boxes."""
import h5py
import numpy as np

from common_behaviour import ReadsInput
from talus_tools import EXISTS, INPUT, USAGE, ToolTest, copy_with, main


class PgboxStats(ReadsInput, ToolTest):
    tool = "pgbox-stats"
    needs_output = False
    wrong_kind = "model"
    damaged = ("/particles/all/position", "/particles/all/radius", "/connectivity/contacts",
               "/granular/contacts/image", "/granular/contacts/normal_overlap")
    keys = ("particle_count", "box_length", "solid_volume_fraction", "coordination_number",
            "coordination_number_no_rattlers", "rattler_fraction", "mean_overlap_ratio", "max_overlap_ratio",
            "pressure", "unbalanced_force", "relative_standard_deviation", "kurtosis", "overlap_by_polar_angle",
            "fabric_tensor", "radial_distribution")

    def input(self):
        return self.box()

    def test_numbers(self):
        self.ok("pgbox-gen", "--radius", 0.06, "--radius-min-ratio", 0.8, "-o", "box.h5")
        got = self.ok("pgbox-stats", "box.h5", "--format", "json").json
        with h5py.File(self.folder / "box.h5", "r") as file:
            position, radius = file["particles/all/position"][:], file["particles/all/radius"][:]
            pair = file["connectivity/contacts"][:]
            image = file["granular/contacts/image"][:]
            length = file["particles/all/box/edges"][0]
        branch = position[pair[:, 1]] + image * length - position[pair[:, 0]]
        distance = np.linalg.norm(branch, axis=1)
        normal = branch / distance[:, None]
        overlap = radius[pair].sum(axis=1) - distance
        n = len(radius)
        self.assertEqual(got["particle_count"], n)
        self.assertAlmostEqual(got["box_length"], length)
        self.assertAlmostEqual(got["solid_volume_fraction"], np.sum(4 / 3 * np.pi * radius**3) / length**3, 9)
        self.assertAlmostEqual(got["coordination_number"], 2 * len(pair) / n, 9)
        ratio = overlap / radius[pair].mean(axis=1)  # over the pair's or over all grains' mean radius
        self.assertAlmostEqual(got["mean_overlap_ratio"] / np.mean(ratio), 1, delta=0.02)
        self.assertAlmostEqual(got["max_overlap_ratio"] / np.max(ratio), 1, delta=0.2)
        # Rattlers: fewer than four contacts, taken out one after the other.
        alive, contact = np.ones(n, bool), np.ones(len(pair), bool)
        while True:
            count = np.bincount(pair[contact].ravel(), minlength=n)
            out = alive & (count < 4)
            if not out.any():
                break
            alive &= ~out
            contact &= alive[pair].all(axis=1)
        self.assertAlmostEqual(got["rattler_fraction"], 1 - alive.mean(), 9)
        self.assertAlmostEqual(got["coordination_number_no_rattlers"], 2 * contact.sum() / alive.sum(), 9)
        np.testing.assert_allclose(got["fabric_tensor"], normal.T @ normal / len(pair), atol=1e-9)
        self.assertAlmostEqual(np.trace(got["fabric_tensor"]), 1, 9)
        # Overlap against polar angle: sum in 5 degree bins over sin(theta), mean 1.
        theta = np.degrees(np.arccos(np.abs(normal[:, 2])))
        sums, _ = np.histogram(theta, bins=18, range=(0, 90), weights=overlap)
        value = sums / np.sin(np.radians(np.arange(18) * 5 + 2.5))
        value /= value.mean()
        np.testing.assert_allclose(got["overlap_by_polar_angle"], value, rtol=1e-6, atol=1e-9)
        self.assertAlmostEqual(np.mean(got["overlap_by_polar_angle"]), 1, 9)
        self.assertAlmostEqual(got["relative_standard_deviation"] / value.std(), 1, delta=0.03)
        # Pressure: a third of the trace of the mean stress, from Hertz's law.
        reduced = radius[pair].prod(axis=1) / radius[pair].sum(axis=1)
        force = 2 * 1e8 / (3 * (1 - 0.2**2)) * np.sqrt(reduced) * overlap**1.5
        self.assertAlmostEqual(got["pressure"] / (np.sum(force * distance) / 3 / length**3), 1, 6)
        self.assertLess(got["unbalanced_force"], 1e-3)
        radial = got["radial_distribution"]
        self.assertEqual(len(radial["r_over_diameter"]), len(radial["g"]))
        peak = radial["r_over_diameter"][int(np.argmax(radial["g"]))]
        self.assertTrue(0.9 < peak < 1.15, peak)

    def test_structure_numbers(self):
        self.ok("pgbox-gen", "--radius", 0.06, "--radius-min-ratio", 0.8, "-o", "box.h5")
        got = self.ok("pgbox-stats", "box.h5", "--format", "json").json
        with h5py.File(self.folder / "box.h5", "r") as file:
            position, radius = file["particles/all/position"][:], file["particles/all/radius"][:]
            image = file["granular/contacts/image"][:]
            length = file["particles/all/box/edges"][0]
        n = len(radius)
        diameter = 2 * radius.mean()
        # Each axis: exact volumes of spheres between planes add up, and so do those at the face.
        seam = got["seam"]
        for axis, name in enumerate("xyz"):
            profile = seam[name]["profile"]
            slabs = len(profile["solid_volume_fraction"])
            self.assertEqual(slabs, max(8, int(length / diameter)))
            self.assertAlmostEqual(seam["slab_width"] * slabs, length, 12)
            self.assertAlmostEqual(np.mean(profile["solid_volume_fraction"]), got["solid_volume_fraction"], 9)
            self.assertEqual(seam[name]["contacts_across_face"], int((image[:, axis] != 0).sum()))
            face = seam[name]["solid_volume_fraction"]
            values = np.array(profile["solid_volume_fraction"])
            self.assertAlmostEqual(face["face"], (values[0] + values[-1]) / 2, 12)
            self.assertAlmostEqual(face["z_score"], (face["face"] - face["inside"]) / face["standard_error"], 9)
            # A slab by points thrown into it.
            points = np.random.default_rng(axis).random((4000, 3)) * length
            points[:, axis] *= 1 / slabs
            apart = points[:, None] - position[None]
            apart -= length * np.round(apart / length)
            inside = (np.einsum("pik,pik->pi", apart, apart) < radius**2).any(axis=1)
            self.assertAlmostEqual(values[0], inside.mean(), delta=0.035)
        self.assertIs(seam["uniform"], True)
        # The first shell of the structure factor.
        waves = np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 0], [1, -1, 0], [1, 0, 1], [1, 0, -1],
                          [0, 1, 1], [0, 1, -1]])
        terms = np.exp(-2j * np.pi * position @ waves.T / length)
        factor = got["structure_factor"]
        self.assertEqual(factor["vectors"][0], 9)
        self.assertAlmostEqual(factor["s"][0], np.mean(np.abs(terms.sum(axis=0)) ** 2) / n, 9)
        weighted = np.abs((radius[:, None] ** 3 * terms).sum(axis=0)) ** 2 / (radius**6).sum()
        self.assertAlmostEqual(factor["s_by_volume"][0], weighted.mean(), 9)
        self.assertAlmostEqual(factor["k_times_diameter"][0],
                               np.mean(2 * np.pi * np.linalg.norm(waves, axis=1) * diameter / length), 9)
        # Cells: their volumes are (4/3 pi r^3) / fraction, so the fractions' mean and spread bound the whole's.
        local = got["local_solid_fraction"]
        self.assertLess(local["volume_error"], 1e-9)
        self.assertEqual(local["grains_without_cell"], 0)
        self.assertAlmostEqual(local["mean"], got["solid_volume_fraction"], delta=0.01)
        self.assertTrue(local["min"] < got["solid_volume_fraction"] < local["max"] < 0.85)
        self.assertAlmostEqual(np.sum(local["distribution"]["density"]) * local["distribution"]["bin_width"], 1, 9)
        self.assertLess(got["local_order"]["crystal_fraction"], 0.05)
        for name in ("overlap", "force"):
            spread = got[f"{name}_distribution"]
            density, centre = np.array(spread["density"]), np.array(spread[f"{name}_over_mean"])
            self.assertAlmostEqual(density.sum() * spread["bin_width"], 1, 9)
            self.assertAlmostEqual((density * centre).sum() * spread["bin_width"], 1, delta=0.01)

    def test_damaged_seam(self):
        self.ok("pgbox-gen", "--radius", 0.04, "-o", "box.h5")
        self.assertIs(self.ok("pgbox-stats", "box.h5", "--format", "json").json["seam"]["uniform"], True)

        def shrink(file):  # half of the grains within a radius of the upper and lower face
            height, radius = file["particles/all/position"][:, 2], file["particles/all/radius"][:]
            near = np.flatnonzero((height < 0.04) | (height > 0.96))
            radius[near[::2]] *= 0.5
            file["particles/all/radius"][...] = radius
        copy_with(self.folder / "box.h5", self.folder / "seam.h5", shrink)
        seam = self.ok("pgbox-stats", "seam.h5", "--format", "json").json["seam"]
        self.assertIs(seam["uniform"], False)
        self.assertIs(seam["z"]["solid_volume_fraction"]["conspicuous"], True)
        self.assertLess(seam["z"]["solid_volume_fraction"]["z_score"], -5)
        self.assertIs(seam["x"]["solid_volume_fraction"]["conspicuous"], False)

    def test_run_on(self):
        self.ok("pgbox-gen", "--radius", 0.09, "--friction", 0, "--unbalanced-force", 1e-7, "-o", "box.h5")
        self.assertNotIn("run_on", self.ok("pgbox-stats", "box.h5", "--format", "json").json)
        got = self.ok("pgbox-stats", "box.h5", "--run-on", 1000, "--format", "json").json
        run = got["run_on"]
        self.assertEqual(run["steps"], 1000)
        self.assertIs(run["quasi_static"], True)
        self.assertLess(run["max_displacement_ratio"], 1e-4)
        self.assertAlmostEqual(run["coordination_number_before"], got["coordination_number"], 9)
        self.assertAlmostEqual(run["unbalanced_force_before"] / got["unbalanced_force"], 1, delta=0.05)

        def push(file):  # one grain out of its place by a twentieth of its radius
            file["particles/all/position"][7, 0] = min(0.999, file["particles/all/position"][7, 0] + 0.0045)
        copy_with(self.folder / "box.h5", self.folder / "pushed.h5", push)
        run = self.ok("pgbox-stats", "pushed.h5", "--run-on", 1000, "--format", "json", "-q").json["run_on"]
        self.assertIs(run["quasi_static"], False)
        self.assertGreater(run["max_kinetic_ratio"], 1e-4)
        got = self.run_tool("pgbox-stats", "box.h5", "--run-on", -1)
        self.assertNotEqual(got.code, 0, str(got))

    def test_threads(self):
        box = self.box()
        one, two = (self.ok("pgbox-stats", box, "--run-on", 50, "--format", "json", "-j", j).out for j in (1, 2))
        self.assertEqual(one, two)

    def test_output_file(self):
        box = self.box()
        printed = self.ok("pgbox-stats", box, "--format", "json")
        got = self.ok("pgbox-stats", box, "--format", "json", "-o", "stats.json")
        self.assertEqual(got.out, "")
        self.assertEqual((self.folder / "stats.json").read_text(), printed.out)

    def test_plot(self):
        box = self.box()
        self.ok("pgbox-stats", box, "--plot", "box.svg", "-q")
        picture = (self.folder / "box.svg").read_text()
        self.assertIn("<svg", picture)
        self.assertIn("</svg>", picture)
        self.fails(EXISTS, "pgbox-stats", box, "--plot", "box.svg", names="box.svg")
        self.assertEqual((self.folder / "box.svg").read_text(), picture)
        self.ok("pgbox-stats", box, "--plot", "box.png", "-q")
        self.assertEqual((self.folder / "box.png").read_bytes()[:8], b"\x89PNG\r\n\x1a\n")
        got = self.run_tool("pgbox-stats", box, "--plot", "box.tiff")
        self.assertEqual(got.code, USAGE, str(got))

    def test_not_a_number(self):
        box = self.folder / self.box()
        for dataset, place in (("particles/all/position", (5, 1)), ("particles/all/radius", 5),
                               ("granular/contacts/normal_overlap", 5)):
            for value in (np.nan, np.inf):
                with self.subTest(dataset, value=value):
                    copy_with(box, self.folder / "nan.h5", lambda file: file[dataset].__setitem__(place, value))
                    got = self.fails(INPUT, "pgbox-stats", "nan.h5", names=["nan.h5", "5", "finite"])
                    self.assertRegex(got.err, "nan|inf")
        copy_with(box, self.folder / "negative.h5", lambda file: file["particles/all/radius"].__setitem__(3, -0.1))
        self.fails(INPUT, "pgbox-stats", "negative.h5", names=["negative.h5", "/particles/all/radius", "row 3"])

    def test_contacts_that_are_not_the_positions(self):
        def move(file):
            file["particles/all/position"][0] = [0.5, 0.5, 0.5]
        copy_with(self.folder / self.box(), self.folder / "moved.h5", move)
        got = self.ok("pgbox-stats", "moved.h5", "--format", "json")
        self.assertIs(got.json["periodic"], False)
        self.assertGreater(got.json["contacts_missing"] + got.json["contacts_extra"], 0)
        self.assertIn("moved.h5", got.err)

    def test_missing_dataset(self):
        for dataset in ("particles/all/position", "particles/all/radius", "particles/all/box"):
            copy_with(self.folder / self.box(), self.folder / "less.h5", lambda file: file.__delitem__(dataset))
            self.fails(INPUT, "pgbox-stats", "less.h5", names=["less.h5", dataset])


if __name__ == "__main__":
    main()
