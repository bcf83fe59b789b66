# SPDX-License-Identifier: GPL-3.0-or-later
"""Variants of a box from pgbox-gen through tile-trim to dem-run, and how a tiling of them repeats itself."""
import functools
import pathlib
import shutil
import subprocess
import tempfile

import h5py
import numpy as np

from talus_tools import BIN, CONFIGURATION, EXISTS, INPUT, ToolTest, datasets, main, physical

NAMES = ["box.pgbox.h5", "box.v2.pgbox.h5", "box.v3.pgbox.h5"]
MAKE = ["--radius", "0.06", "--variants", "3", "--no-provenance", "-q"]


@functools.lru_cache
def family():
    """The three boxes, made once for all tests of this script."""
    folder = tempfile.TemporaryDirectory(prefix="talus-variants-")
    done = subprocess.run([str(BIN / "pgbox-gen"), *MAKE, "-o", NAMES[0]], cwd=folder.name, capture_output=True,
                          text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    return folder


def touching(position, radius):
    """Pairs (i < j) that overlap, found cell by cell, with their overlaps."""
    size = 2 * radius.max()
    cells = {}
    for row, cell in enumerate(map(tuple, np.floor(position / size).astype(int))):
        cells.setdefault(cell, []).append(row)
    pairs, overlaps = [], []
    around = [(x, y, z) for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1)]
    for cell, rows in cells.items():
        near = np.concatenate([cells.get((cell[0] + a, cell[1] + b, cell[2] + c), []) for a, b, c in around])
        near = near.astype(int)
        for i in rows:
            j = near[near > i]
            overlap = radius[i] + radius[j] - np.linalg.norm(position[j] - position[i], axis=1)
            for k in np.nonzero(overlap > 0)[0]:
                pairs.append((i, j[k]))
                overlaps.append(overlap[k])
    order = sorted(range(len(pairs)), key=pairs.__getitem__)
    return np.array(pairs)[order], np.array(overlaps)[order]


class Variants(ToolTest):
    def setUp(self):
        super().setUp()
        for name in NAMES:
            shutil.copy(pathlib.Path(family().name) / name, self.folder / name)

    def test_what_the_files_say(self):
        boxes = []
        for k, name in enumerate(NAMES):
            with h5py.File(self.folder / name, "r") as file:
                attributes = dict(file["granular/pgbox"].attrs)
                self.assertEqual(attributes["variant"], k + 1)
                self.assertEqual(attributes["variants"], 3)
                boxes.append((file["particles/all/position"][:], file["particles/all/radius"][:],
                              attributes["family"], attributes["skin_thickness"], attributes["skin_fraction"]))
        position, radius, name, skin, fraction = boxes[0]
        self.assertGreaterEqual(skin, 2 * radius.max())
        self.assertAlmostEqual(fraction, 1 - (1 - 2 * skin)**3, 12)
        inside = np.minimum(position, 1 - position).min(axis=1) > skin
        for other in boxes[1:]:
            self.assertEqual(other[2:], (name, skin, fraction))
            np.testing.assert_array_equal(other[0][~inside], position[~inside])
            self.assertFalse(np.any(np.all(other[0][inside] == position[inside], axis=1)))
            np.testing.assert_array_equal(np.sort(other[1]), np.sort(radius))
        with h5py.File(self.folder / NAMES[1], "r") as file:
            attributes = file["granular/pgbox"].attrs
            tolerance = max(0.1, 3.6 / np.sqrt(inside.sum()))
            self.assertAlmostEqual(attributes["interior_coordination_number"],
                                   attributes["first_interior_coordination_number"], delta=tolerance)
            self.assertLess(attributes["interior_unbalanced_force"], 1e-3)

    def test_same_bytes_again_and_the_first_is_the_plain_box(self):
        self.ok("pgbox-gen", *MAKE, "-j", 1, "-o", "again.pgbox.h5")
        for name in NAMES:
            with self.subTest(name):
                self.assertEqual((self.folder / name).read_bytes(),
                                 (self.folder / name.replace("box", "again", 1)).read_bytes())
        self.ok("pgbox-gen", "--radius", "0.06", "--no-provenance", "-q", "-o", "plain.pgbox.h5")
        plain, first = physical(self.folder / "plain.pgbox.h5"), physical(self.folder / NAMES[0])
        self.assertEqual(plain.keys(), first.keys())
        for key, value in plain.items():
            np.testing.assert_array_equal(first[key], value, key)

    def test_contacts_across_seams(self):
        got = self.ok("tile-trim", *NAMES, "--cuboid", "3,3,3", "--explicit", "--seed", 4, "-o", "explicit.model.h5",
                      "--format", "json").json
        tiled = self.ok("tile-trim", *NAMES, "--cuboid", "3,3,3", "--seed", 4, "-o", "tiled.model.h5", "--format",
                        "json").json
        self.assertEqual(sum(got["tiles_by_variant"]), 27)
        self.assertEqual(tiled["tiles_by_variant"], got["tiles_by_variant"])
        self.assertGreater(min(got["tiles_by_variant"]), 0)
        model = datasets(self.folder / "explicit.model.h5")
        position, radius = model["particles/all/position"], model["particles/all/radius"]
        pairs, overlaps = touching(position, radius)
        np.testing.assert_array_equal(model["connectivity/contacts"], pairs)
        np.testing.assert_allclose(model["granular/contacts/normal_overlap"], overlaps, atol=1e-12)
        # The tiled form, by hand: corner + box, kept rows only.
        with h5py.File(self.folder / "tiled.model.h5", "r") as file:
            boxes = [file[f"granular/boxes/{k:04}/position"][:] for k in range(3)]
            tiling = {name: item[()] for name, item in file["granular/tiling"].items()}
        rows, at = [], 0
        for index, box, kind in zip(tiling["index"], tiling["box"], tiling["class"]):
            keep = np.ones(len(boxes[box]), bool)
            if kind == 1:
                size = (len(keep) + 7) // 8
                keep = np.unpackbits(tiling["kept_mask"][at:at + size], bitorder="little")[:len(keep)].astype(bool)
                at += size
            rows.append(index + boxes[box][keep])
        np.testing.assert_allclose(np.concatenate(rows), position, atol=1e-12)
        dry = self.ok("tile-trim", *NAMES, "--cuboid", "3,3,3", "--seed", 4, "-n", "--format", "json").json
        self.assertEqual(dry["particle_count"], len(position))
        self.ok("tile-trim", *NAMES, "--cuboid", "3,3,3", "--seed", 5, "-o", "other.model.h5", "-q")
        drawn = datasets(self.folder / "other.model.h5")["granular/tiling/box"]
        self.assertFalse(np.array_equal(drawn, tiling["box"]), "another seed draws other tiles")

    def test_runs_of_both_forms_are_the_same(self):
        ends = []
        for form in ([], ["--explicit"]):
            self.ok("tile-trim", *NAMES, "--cuboid", "2,2,2", *form, "-o", "m.model.h5", "--overwrite", "-q")
            self.ok("dem-run", "m.model.h5", "--time.end", "2ms", "-o", "m.traj.h5", "--overwrite",
                    "-q")
            ends.append(datasets(self.folder / "m.traj.h5")["particles/all/position/value"][-1])
        np.testing.assert_array_equal(ends[0], ends[1])

    def test_pattern(self):
        alone = self.ok("pgbox-stats", NAMES[0], "--format", "json").json
        self.assertNotIn("tiling_pattern", alone)
        got = self.ok("pgbox-stats", *NAMES, "--format", "json").json
        self.assertEqual(got["coordination_number"], alone["coordination_number"])
        pattern = got["tiling_pattern"]
        f = pattern["skin_fraction"]
        self.assertAlmostEqual(pattern["predicted"], f + (1 - f) / 3, 12)
        self.assertEqual(pattern["shifts"][0]["tiles"], [1, 0, 0])
        for shift in pattern["shifts"]:
            # Between what the drawn pairs of tiles ask for and no gain at all: interiors remember a part.
            self.assertGreater(shift["autocorrelation"], shift["expected_as_drawn"] - 0.1)
            self.assertLess(shift["autocorrelation"], 0.95)
            c, same = pattern["variant_correlation"], shift["same_variant"]
            self.assertAlmostEqual(shift["autocorrelation"], same + (1 - same) * c, delta=0.03)

    def test_what_is_refused(self):
        self.fails(INPUT, "tile-trim", NAMES[0], NAMES[1], NAMES[1], "--cuboid", "3,3,3", "-o", "x.h5",
                   names=[NAMES[1], "variant 2"])
        self.ok("pgbox-gen", "--radius", "0.06", "--seed", 2, "--variants", 2, "-o", "other.pgbox.h5", "-q")
        self.ok("pgbox-gen", "--radius", "0.06", "--seed", 2, "-o", "plain.pgbox.h5", "-q")
        self.fails(INPUT, "tile-trim", NAMES[0], "other.v2.pgbox.h5", "--cuboid", "3,3,3", "-o", "x.h5",
                   names=["other.v2.pgbox.h5", "family", "--variants"])
        self.fails(INPUT, "pgbox-stats", NAMES[0], "plain.pgbox.h5", names=["plain.pgbox.h5", "family"])
        with h5py.File(self.folder / NAMES[2], "r+") as file:  # a lie that the attributes do not show
            position = file["particles/all/position"][:]
            row = int(np.argmin(position[:, 0]))
            file["particles/all/position"][row, 1] = position[row, 1] + 1e-9
        self.fails(INPUT, "tile-trim", *NAMES, "--cuboid", "3,3,3", "-o", "x.h5", names=[NAMES[2], "does not fit"])
        self.write("new.v3.pgbox.h5", "mine")
        self.fails(EXISTS, "pgbox-gen", *MAKE, "-o", "new.pgbox.h5", names="new.v3.pgbox.h5")
        self.assertEqual((self.folder / "new.v3.pgbox.h5").read_text(), "mine")
        self.assertNotIn("new.pgbox.h5", self.files())
        self.fails(CONFIGURATION, "pgbox-gen", *MAKE, "--skin-thickness", "0.1", "-o", "thin.pgbox.h5",
                   names=["skin_thickness", "0.12"])
        self.assertNotIn("thin.pgbox.h5", self.files())


if __name__ == "__main__":
    main()
