# SPDX-License-Identifier: GPL-3.0-or-later
"""tile-trim: each kind of region against the same cut in numpy, and rasters that cannot be used."""
import h5py
import numpy as np

from common_behaviour import ReadsInput
from rasters import elevation_at, inside, write_raster
from talus_tools import CONFIGURATION, DEGREES, HELENS, INPUT, USAGE, ToolTest, check_xdmf, copy_with, main


def read_box(path):
    with h5py.File(path, "r") as file:
        return (file["particles/all/position"][:], file["particles/all/radius"][:],
                file["particles/all/box/edges"][0])


def read_model(path):
    """Positions in the coordinates of the region, radii, and marks of an explicit model."""
    with h5py.File(path, "r") as file:
        group = file["particles/all"]
        origin = group["position"].attrs.get("origin", np.zeros(3))
        marks = [group[name][:].astype(bool) if name in group else np.zeros(len(group["radius"]), bool)
                 for name in ("species", "release")]
        return group["position"][:] + origin, group["radius"][:], *marks


def tiled_by_hand(position, radius, length, lower, upper):
    """Every copy of a box's grains that could touch [lower, upper]."""
    first = np.floor(np.array(lower) / length).astype(int) - 1
    last = np.ceil(np.array(upper) / length).astype(int) + 1
    shifts = np.stack(np.meshgrid(*[np.arange(a, b + 1) for a, b in zip(first, last)], indexing="ij"), -1)
    copies = (shifts.reshape(-1, 1, 3) * length + position).reshape(-1, 3)
    return copies, np.tile(radius, len(copies) // len(radius))


def rows_in_order(values):
    return values[np.lexsort(np.round(values, 9).T)]


def stl_of_cuboid(size):
    corners = np.array([[x, y, z] for x in (0, size[0]) for y in (0, size[1]) for z in (0, size[2])])
    faces = [(0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5), (0, 4, 5), (0, 5, 1),
             (2, 3, 7), (2, 7, 6), (0, 2, 6), (0, 6, 4), (1, 5, 7), (1, 7, 3)]
    lines = ["solid cuboid"]
    for face in faces:
        lines += [" facet normal 0 0 0", "  outer loop"]
        lines += ["   vertex " + " ".join(f"{c:.17g}" for c in corners[k]) for k in face]
        lines += ["  endloop", " endfacet"]
    return "\n".join([*lines, "endsolid cuboid", ""])


class TileTrim(ReadsInput, ToolTest):
    tool = "tile-trim"
    arguments = ("--cuboid", "2,2,2")
    wrong_kind = "model"
    damaged = ("/particles/all/position", "/particles/all/radius", "/connectivity/contacts")
    keys = ("particle_count", "fixed_count", "release_count", "tiles_total", "tiles_full", "tiles_cut", "tiles_skipped",
            "grains_tested", "wall_time", "bytes_written")

    def input(self):
        return self.box()

    def trim(self, *arguments, explicit=True):
        extra = ["--explicit"] if explicit else []
        return self.ok("tile-trim", self.box(), *arguments, *extra, "-o", "model.h5", "--overwrite", "--format",
                       "json").json

    def expect_grains(self, position, radius):
        """The model in the folder holds exactly these grains."""
        found, found_radius, _, _ = read_model(self.folder / "model.h5")
        self.assertEqual(len(found), len(position))
        np.testing.assert_allclose(rows_in_order(np.column_stack([found, found_radius])),
                                   rows_in_order(np.column_stack([position, radius])), atol=1e-9)

    def test_cuboid(self):
        position, radius, length = read_box(self.folder / self.box())
        size = np.array([2.2, 1.7, 3.1])
        got = self.trim("--cuboid", "2.2,170cm,3.1")
        copies, radii = tiled_by_hand(position, radius, length, [0, 0, 0], size)
        keep = np.all((copies - radii[:, None] >= 0) & (copies + radii[:, None] <= size), axis=1)
        self.assertEqual(got["particle_count"], keep.sum())
        self.expect_grains(copies[keep], radii[keep])
        # In the middle of the region the packing is that of the box.
        middle = np.all((copies >= 0.6) & (copies < size - 0.6), axis=1)
        self.assertAlmostEqual(got["box_solid_volume_fraction"], 0.64, delta=5e-4)
        self.assertGreater(middle.sum(), 0)

    def test_cylinder(self):
        position, radius, length = read_box(self.folder / self.box())
        got = self.trim("--cylinder", "1.8,2.5")
        copies, radii = tiled_by_hand(position, radius, length, [-0.9, -0.9, 0], [0.9, 0.9, 2.5])
        keep = ((np.hypot(copies[:, 0], copies[:, 1]) + radii <= 0.9) & (copies[:, 2] - radii >= 0) &
                (copies[:, 2] + radii <= 2.5))
        self.assertEqual(got["particle_count"], keep.sum())
        self.expect_grains(copies[keep], radii[keep])

    def test_mesh(self):
        self.write("cuboid.stl", stl_of_cuboid([2.2, 1.7, 3.1]))
        mesh = self.trim("--mesh", "cuboid.stl")
        position, radius, _, _ = read_model(self.folder / "model.h5")
        cuboid = self.trim("--cuboid", "2.2,1.7,3.1")
        self.assertEqual(mesh["particle_count"], cuboid["particle_count"])
        self.assertAlmostEqual(mesh["region_volume"], 2.2 * 1.7 * 3.1, delta=1e-6)
        self.expect_grains(position, radius)

    def test_mesh_that_is_no_solid(self):
        text = stl_of_cuboid([2, 2, 2]).split(" facet")
        self.write("open.stl", " facet".join(text[:-1]) + "endsolid cuboid\n")
        self.write("words.stl", "solid nothing\n of the kind\n")
        for name in ("open.stl", "words.stl", "absent.stl"):
            self.fails(INPUT, "tile-trim", self.box(), "--mesh", name, "-o", "x.h5", names=name)
        self.assertNotIn("x.h5", self.files())

    def test_rescaled(self):
        position, radius, length = read_box(self.folder / self.box())
        scale = 0.5 / radius.max()
        got = self.trim("--cuboid", "15,15,15", "--radius-max", "50cm")
        self.assertAlmostEqual(got["radius_max"], 0.5, 12)
        copies, radii = tiled_by_hand(position * scale, radius * scale, length * scale, [0, 0, 0], [15, 15, 15])
        keep = np.all((copies - radii[:, None] >= 0) & (copies + radii[:, None] <= 15), axis=1)
        self.expect_grains(copies[keep], radii[keep])

    def test_contacts_come_along(self):
        self.trim("--cuboid", "2.5,2.5,2.5")
        position, radius, _, _ = read_model(self.folder / "model.h5")
        branch = position[None] - position[:, None]
        touching = np.argwhere(np.triu(radius[:, None] + radius - np.linalg.norm(branch, axis=2) > 0, 1))
        with h5py.File(self.folder / "model.h5", "r") as file:
            stored = file["connectivity/contacts"][:]
        np.testing.assert_array_equal(stored[np.lexsort((stored[:, 1], stored[:, 0]))], touching)

    def test_tiled_and_explicit_are_the_same_model(self):
        for region in (["--cuboid", "2.2,3,4.1"], ["--cylinder", "2,4"]):
            tiled = self.ok("tile-trim", self.box(), *region, "-o", "tiled.h5", "--overwrite", "--format", "json").json
            explicit = self.ok("tile-trim", self.box(), *region, "--explicit", "-o", "model.h5", "--overwrite",
                               "--format", "json").json
            self.assertEqual(tiled["particle_count"], explicit["particle_count"])
            for name in ("tiled", "model"):
                self.ok("dem-run", f"{name}.h5", "--time.end", "1us", "--time.step", "1us", "--output.float64", "-o",
                        f"{name}.traj.h5", "--overwrite")
            with h5py.File(self.folder / "tiled.traj.h5", "r") as a, h5py.File(self.folder / "model.h5", "r") as b:
                np.testing.assert_array_equal(a["particles/all/position/value"][0], b["particles/all/position"][:])
                np.testing.assert_array_equal(a["particles/all/radius"][:], b["particles/all/radius"][:])

    def test_same_bytes_with_one_and_two_threads(self):
        for threads in (1, 2):
            self.ok("tile-trim", self.box(), "--cylinder", "3,5", "-j", threads, "--no-provenance", "-o",
                    f"{threads}.h5")
        self.assertEqual((self.folder / "1.h5").read_bytes(), (self.folder / "2.h5").read_bytes())

    def test_xdmf(self):
        self.trim("--cuboid", "2,2,2", explicit=False)
        seen, _ = check_xdmf(self, self.folder / "model.xdmf")
        self.assertIn("/granular/tiling/centre", seen)
        self.trim("--cuboid", "2,2,2")
        seen, _ = check_xdmf(self, self.folder / "model.xdmf")
        self.assertIn("/particles/all/position", seen)

    def test_regions_that_cannot_be(self):
        box = self.box()
        self.fails(USAGE, "tile-trim", box, "-o", "x.h5", names="--cuboid")
        for arguments in (["--cuboid", "2,2"], ["--cuboid", "2,2,-1"], ["--cuboid", "2,2,nan"], ["--cylinder", "2,2,2"],
                          ["--cylinder", "2,2", "--cuboid", "2,2,2"], ["--pre", "pre.asc"],
                          ["--cuboid", "2,2,2", "--shift", "7"], ["--cuboid", "2,2,2", "--radius-max", "0"]):
            with self.subTest(arguments):
                self.fails(USAGE, "tile-trim", box, *arguments, "-o", "x.h5")
        # A radius larger than the region.
        self.fails(CONFIGURATION, "tile-trim", box, "--cuboid", "2,2,2", "--radius-max", "5m", "-o", "x.h5",
                   names=["radius", "5", "--radius-max"])
        self.fails(CONFIGURATION, "tile-trim", box, "--cylinder", "0.1,2", "-o", "x.h5", names="radius")
        self.assertEqual(self.files(), [box])

    def test_not_a_number(self):
        for dataset, place in (("particles/all/position", (0, 2)), ("particles/all/radius", 0)):
            copy_with(self.folder / self.box(), self.folder / "nan.h5",
                      lambda file: file[dataset].__setitem__(place, np.nan))
            self.fails(INPUT, "tile-trim", "nan.h5", "--cuboid", "2,2,2", "-o", "x.h5",
                       names=["nan.h5", dataset, "row 0"])

    def test_box_larger_than_it_can_be(self):
        def grow(file):
            file["particles/all/radius"][...] = 0.7
        copy_with(self.folder / self.box(), self.folder / "big.h5", grow)
        self.fails(INPUT, "tile-trim", "big.h5", "--cuboid", "9,9,9", "-o", "x.h5", names=["big.h5", "radius"])


class Parts(ToolTest):
    """A tiled model as input: parts of it, and the explicit form."""
    tool = "tile-trim"

    def setUp(self):
        super().setUp()
        self.ok("pgbox-gen", "--radius", 0.09, "-o", "box.h5")
        self.ok("tile-trim", "box.h5", "--cylinder", "5,6", "-o", "whole.h5")
        self.ok("tile-trim", "box.h5", "--cylinder", "5,6", "--explicit", "-o", "explicit.h5")

    def test_written_out_it_is_the_explicit_model(self):
        got = self.ok("tile-trim", "whole.h5", "--explicit", "-o", "out.h5", "--format", "json").json
        self.assertGreater(got["particles_expanded_per_second"], 0)
        with h5py.File(self.folder / "explicit.h5") as a, h5py.File(self.folder / "out.h5") as b:
            for name in ("particles/all/position", "particles/all/radius", "connectivity/contacts",
                         "granular/contacts/image", "granular/contacts/normal_overlap"):
                np.testing.assert_array_equal(a[name][()], b[name][()], name)
            self.assertEqual(got["contact_count"], len(a["connectivity/contacts"]))

    def test_part(self):
        lower, upper = np.array([-1.3, -0.4, 1.2]), np.array([1.6, 2.1, 3.7])
        part = ",".join(str(v) for v in (*lower, *upper))
        tiled = self.ok("tile-trim", "whole.h5", "--part", part, "-o", "part.h5", "--format", "json").json
        straight = self.ok("tile-trim", "whole.h5", "--part", part, "--explicit", "-o", "a.h5", "--format", "json").json
        self.ok("tile-trim", "part.h5", "--explicit", "-o", "b.h5")
        self.assertGreater(tiled["tiles_skipped"], 0)
        with h5py.File(self.folder / "explicit.h5") as whole:
            position, pairs = whole["particles/all/position"][()], whole["connectivity/contacts"][()]
        keep = np.all((position >= lower) & (position < upper), axis=1)
        self.assertTrue(0 < keep.sum() < len(position))
        number = np.cumsum(keep) - 1
        pairs = number[pairs[keep[pairs].all(axis=1)]]
        self.assertEqual(tiled["particle_count"], keep.sum())
        self.assertEqual(straight["particle_count"], keep.sum())
        for name in ("a.h5", "b.h5"):
            with h5py.File(self.folder / name) as file:
                np.testing.assert_array_equal(file["particles/all/position"][()], position[keep])
                np.testing.assert_array_equal(file["connectivity/contacts"][()], pairs)

    def test_contacts_wanted(self):
        none = self.ok("tile-trim", "whole.h5", "--explicit", "--contacts", "none", "-o", "a.h5", "--format", "json").json
        self.assertEqual(none["contact_count"], 0)
        with h5py.File(self.folder / "a.h5") as file:
            self.assertNotIn("connectivity/contacts", file)
        self.fails(USAGE, "tile-trim", "whole.h5", "--contacts", "none", "-o", "b.h5", names="explicit")

    def test_parts_that_cannot_be(self):
        for part, code, names in (("1,2,3", USAGE, "part"), ("1,0,0,0,1,1", CONFIGURATION, "part"),
                                  ("90,90,90,91,91,91", CONFIGURATION, ["part", "clear"])):
            self.fails(code, "tile-trim", "whole.h5", "--part", part, "-o", "x.h5", names=names)
        self.fails(USAGE, "tile-trim", "box.h5", "--cuboid", "2,2,2", "--part", "0,0,0,1,1,1", "-o", "x.h5", names="part")
        self.fails(INPUT, "tile-trim", "whole.h5", "--cuboid", "2,2,2", "-o", "x.h5", names="whole.h5")
        self.fails(INPUT, "tile-trim", "explicit.h5", "--part", "0,0,0,1,1,1", "-o", "x.h5", names="explicit.h5")
        self.assertNotIn("x.h5", self.files())


class Forecast(ToolTest):
    """tile-trim -n against what then happens."""
    tool = "tile-trim"

    def test_within_two_percent(self):
        self.ok("pgbox-gen", "--radius", 0.06, "--radius-min-ratio", 0.82, "--route", "compress", "--friction", 0, "-o", "box.h5")
        real = ["--pre", HELENS / "pre_runout_DEM.asc", "--post", HELENS / "post_runout_DEM.asc", "--shift", "8m",
                "--source-area", HELENS / "source_area.geojson", "--domain", "361100,70950,361400,71250"]
        cases = {"cylinder": ["--cylinder", "20,30", "--radius-max", "8cm"],
                 "finer cylinder": ["--cylinder", "20,30", "--radius-max", "4cm"],
                 "real": [*real, "--radius-max", "50cm"], "finer real": [*real, "--radius-max", "25cm"],
                 "written out": [*real, "--radius-max", "80cm", "--explicit"],
                 "written out in parts": [*real, "--radius-max", "40cm", "--explicit"]}
        for what, words in cases.items():
            with self.subTest(what):
                told = self.ok("tile-trim", "box.h5", *words, "-n", "-o", "n.h5", "--format", "json").json
                self.assertNotIn("n.h5", self.files())
                done = self.ok("tile-trim", "box.h5", *words, "-o", "x.h5", "--overwrite", "--format",
                               "json").json
                keys = ["particle_count", "bytes_written"] + (["contact_count"] if "--explicit" in words else [])
                for key in keys:
                    self.assertAlmostEqual(told[key] / done[key], 1, delta=0.02, msg=f"{what}: {key}")
                # What waits between threads differs from run to run.
                self.assertAlmostEqual(told["peak_memory"] / done["peak_memory"], 1, delta=0.05,
                                       msg=what)


class Slope(ToolTest):
    tool = "tile-trim"

    def setUp(self):
        super().setUp()
        self.ok("pgbox-gen", "--radius", 0.09, "-o", "box.h5")
        x, y = np.meshgrid(np.arange(30), np.arange(30)[::-1])
        self.slope = 100 + 0.3 * 10 * x + 2 * np.sin(y)
        self.pre = write_raster(self.folder / "pre.asc", self.slope)
        dug = np.hypot(x - 15, y - 15) < 5
        self.post = write_raster(self.folder / "post.asc", self.slope - 8 * dug)

    def slope_of(self, *arguments, pre=None, post=None):
        return ["box.h5", "--pre", pre or self.pre, "--post", post or self.post, *arguments, "-o", "slope.h5"]

    def test_real_slope(self):
        pre, post = HELENS / "pre_runout_DEM.asc", HELENS / "post_runout_DEM.asc"
        source = HELENS / "source_area.geojson"
        got = self.ok("tile-trim", "box.h5", "--pre", pre, "--post", post, "--shift", "8m", "--source-area", source,
                      "--domain", "361200,70950,361320,71120", "--radius-max", 2, "--fixed-thickness", 3, "--explicit",
                      "-o", "slope.h5", "--format", "json").json
        position, radius, fixed, release = read_model(self.folder / "slope.h5")
        x, y, z = position.T
        self.assertEqual(got["particle_count"], len(position))
        self.assertEqual(got["fixed_count"], fixed.sum())
        self.assertEqual(got["release_count"], release.sum())
        self.assertAlmostEqual(radius.max(), 2, 9)
        self.assertTrue(np.all((x > 361200) & (x < 361320) & (y > 70950) & (y < 71120)))
        top, after = elevation_at(pre, x, y), elevation_at(post, x, y)
        lower = np.minimum(top, after) - 8
        self.assertTrue(np.all(z < top + 1e-6), "below the surface before the event")
        self.assertTrue(np.all(z > lower - 1e-6), "above the lower boundary")
        self.assertTrue(np.all(fixed[z - lower < 3 - 1e-6]), "the bottom layer is fixed")
        self.assertTrue(0.1 < fixed.mean() < 0.7, fixed.mean())
        self.assertGreater(release.sum(), 100)
        self.assertFalse(np.any(release & fixed))
        expected = (z > after) & inside(source, x, y)
        np.testing.assert_array_equal(release, expected & ~fixed)
        # Solid volume over the released volume is the box's fraction, as far as so few grains can tell.
        fraction = np.sum(4 / 3 * np.pi * radius[expected]**3) / got["region_release_volume"]
        self.assertAlmostEqual(fraction, 0.64, delta=0.05)

    def test_domain_outlines_and_boxes(self):
        whole = self.ok("tile-trim", *self.slope_of("--radius-max", 2, "--shift", 8, "--format", "json")).json
        part = self.ok("tile-trim", *self.slope_of("--radius-max", 2, "--shift", 8, "--domain", "50,50,200,150",
                                                   "--format", "json", "--overwrite")).json
        self.assertAlmostEqual(part["domain_area"], 150 * 100, delta=1)
        self.assertLess(part["particle_count"], whole["particle_count"])
        ring = [[50, 50], [200, 50], [200, 150], [50, 150], [50, 50]]
        self.write("domain.geojson", {"type": "FeatureCollection", "features": [
            {"type": "Feature", "properties": {}, "geometry": {"type": "Polygon", "coordinates": [ring]}}]})
        outline = self.run_tool("tile-trim", *self.slope_of("--radius-max", 2, "--shift", 8, "--domain",
                                                            "domain.geojson", "--format", "json", "--overwrite"))
        if outline.code == INPUT:  # GeoJSON without a system is in degrees
            self.assertIn("domain.geojson", outline.err)
        else:
            self.assertEqual(outline.json["particle_count"], part["particle_count"], str(outline))

    def test_rasters_that_cannot_be_used(self):
        nothing = write_raster(self.folder / "nothing.asc", np.full((30, 30), -9999.0))
        far = write_raster(self.folder / "far.asc", self.slope, lower_left=(50000, 50000))
        nan = self.slope.copy()
        nan[15, 15] = np.nan
        hole = write_raster(self.folder / "hole.asc", nan)
        self.write("words.asc", (self.folder / self.pre).read_text().replace("100", "abc", 1))
        lines = (self.folder / self.pre).read_text().splitlines()
        self.write("short.asc", "\n".join(lines[:20]))
        self.write("text.tif", "no raster\n")
        cases = [("degrees", DEGREES, DEGREES, [DEGREES.name, "degrees"]),
                 ("no data at all", nothing, self.post, ["nothing.asc", "data"]),
                 ("not overlapping", self.pre, far, ["far.asc", "overlap"]),
                 ("not a raster", "text.tif", self.post, "text.tif"),
                 ("missing", "absent.tif", self.post, "absent.tif"),
                 ("after: no data", self.pre, nothing, "nothing.asc"),
                 ("after: missing", self.pre, "absent.tif", "absent.tif"),
                 ("cut off", "short.asc", self.post, "short.asc"),
                 ("a word in it", "words.asc", self.post, ["words.asc", "line", "abc"]),
                 ("not a number in it", hole, self.post, ["hole.asc", "line 16, column 16", "nan"])]
        for what, pre, post, names in cases:
            with self.subTest(what):
                self.fails(INPUT, "tile-trim", *self.slope_of("--radius-max", 2, pre=pre, post=post), names=names)
        self.assertNotIn("slope.h5.part", self.files())

    def test_domain_elsewhere(self):
        got = self.run_tool("tile-trim", *self.slope_of("--radius-max", 2, "--domain", "90000,90000,90100,90100"))
        self.assertIn(got.code, (CONFIGURATION, INPUT), str(got))
        self.assertEqual(len(got.err.splitlines()), 1)
        self.assertIn("domain", got.err)
        for domain in ("1,2,3", "200,50,50,150", "a,b,c,d", "absent.geojson"):
            with self.subTest(domain):
                got = self.run_tool("tile-trim", *self.slope_of("--radius-max", 2, "--domain", domain))
                self.assertIn(got.code, (USAGE, CONFIGURATION, INPUT), str(got))
                self.assertEqual(len(got.err.splitlines()), 1, str(got))

    def test_radius_larger_than_the_layer(self):
        self.fails(CONFIGURATION, "tile-trim", *self.slope_of("--radius-max", 20), names=["radius", "20"])
        self.assertNotIn("slope.h5", self.files())


if __name__ == "__main__":
    main()
