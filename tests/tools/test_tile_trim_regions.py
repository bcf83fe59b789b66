# SPDX-License-Identifier: GPL-3.0-or-later
"""tile-trim: combinations of solids, structures cut out, rasters of different systems and with holes, and what is
measured at the surface; each against numpy."""
import json

import numpy as np

from rasters import elevation_at, write_raster
from talus_tools import CONFIGURATION, HELENS, INPUT, USAGE, ToolTest, main
from test_tile_trim import read_box, read_model, tiled_by_hand


def prism(path, corners, lower, upper):
    """A closed OFF mesh: a polygon (counter-clockwise) from one height to another."""
    n = len(corners)
    lines = ["OFF", f"{2 * n} {n + 2} 0"]
    lines += [f"{x:.17g} {y:.17g} {z:.17g}" for z in (lower, upper) for x, y in corners]
    lines += [f"4 {k} {(k + 1) % n} {n + (k + 1) % n} {n + k}" for k in range(n)]
    lines += [f"{n} " + " ".join(map(str, reversed(range(n)))), f"{n} " + " ".join(str(n + k) for k in range(n))]
    path.write_text("\n".join(lines) + "\n")
    return path.name


def distance_outside(corners, x, y):
    """Distance to a convex polygon (counter-clockwise); negative inside."""
    corners = np.asarray(corners, float)
    edges = np.roll(corners, -1, 0) - corners
    point = np.column_stack([x, y])[:, None] - corners[None]
    along = np.clip(np.sum(point * edges, 2) / np.sum(edges**2, 1), 0, 1)
    distance = np.linalg.norm(point - along[..., None] * edges, axis=2).min(1)
    inside = np.all(edges[:, 0] * point[..., 1] - edges[:, 1] * point[..., 0] > 0, axis=1)
    return np.where(inside, -distance, distance)


def mercator(scale):
    """A .prj of a transverse Mercator system in metres."""
    return ('PROJCS["test",GEOGCS["WGS 84",DATUM["WGS_1984",SPHEROID["WGS 84",6378137,298.257223563]],'
            'PRIMEM["Greenwich",0],UNIT["degree",0.0174532925199433]],PROJECTION["Transverse_Mercator"],'
            'PARAMETER["latitude_of_origin",0],PARAMETER["central_meridian",-123],'
            f'PARAMETER["scale_factor",{scale}],PARAMETER["false_easting",500000],PARAMETER["false_northing",0],'
            'UNIT["metre",1]]')


class Regions(ToolTest):
    tool = "tile-trim"

    def box(self, name="box.pgbox.h5"):
        if not (self.folder / name).exists():
            self.ok("pgbox-gen", "--radius", 0.09, "-o", name)
        return name

    def trim(self, *arguments, explicit=True):
        return self.ok("tile-trim", self.box(), *arguments, *(["--explicit"] if explicit else []), "-o", "model.h5",
                       "--overwrite", "--format", "json").json

    def test_combination(self):
        position, radius, length = read_box(self.folder / self.box())
        prism(self.folder / "wedge.off", [(0, 0), (1, 0), (0, 1)], 0, 1)
        self.write("region.json", {"surface_rule": "centre", "region": [
            {"add": {"cylinder": ["200cm", 2.5]}},
            {"add": {"cuboid": [1, 1, 1], "offset": [0.5, 0.3, "1m"], "axis": [0, 0, 1], "angle": "30deg"}},
            {"subtract": {"cylinder": [0.8, 4], "offset": [-2, 0, 1.2], "axis": [0, 1, 0], "angle": "90deg"}},
            {"subtract": {"mesh": "wedge.off", "offset": [-0.9, -0.4, 0.1]}},
            {"intersect": {"cuboid": [4, 4, 2.2], "offset": [-2, -2, 0.05]}}]})
        got = self.trim("-c", "region.json")
        copies, radii = tiled_by_hand(position, radius, length, [-1, -1, 0], [2, 2, 2.5])
        x, y, z = copies.T
        cylinder = (np.hypot(x, y) <= 1) & (z >= 0) & (z <= 2.5)
        c, s = np.cos(np.radians(30)), np.sin(np.radians(30))
        u, v = c * (x - 0.5) + s * (y - 0.3), -s * (x - 0.5) + c * (y - 0.3)
        cuboid = (u >= 0) & (u <= 1) & (v >= 0) & (v <= 1) & (z >= 1) & (z <= 2)
        hole = (np.hypot(y, z - 1.2) <= 0.4) & (x >= -2) & (x <= 2)
        wedge = (x > -0.9) & (y > -0.4) & (x + 0.9 + y + 0.4 < 1) & (z > 0.1) & (z < 1.1)
        keep = (cylinder | cuboid) & ~hole & ~wedge & (z >= 0.05) & (z <= 2.25) & (np.abs(x) <= 2)
        found, found_radius, _, _ = read_model(self.folder / "model.h5")
        self.assertEqual(got["particle_count"], keep.sum())
        self.assertGreater(keep.sum(), 200)
        order, wanted = np.lexsort(np.round(found, 9).T), np.lexsort(np.round(copies[keep], 9).T)
        np.testing.assert_allclose(found[order], copies[keep][wanted], atol=1e-9)
        np.testing.assert_allclose(found_radius[order], radii[keep][wanted], atol=1e-12)
        # the volume, by random places
        self.assertLess(got["region_volume_error"], 2e-3 * got["region_volume"])
        self.assertAlmostEqual(got["kept_volume"] + got["missing_volume"],
                               got["region_volume"] * got["box_solid_volume_fraction"], 9)
        # read back what --print-config says: the same model
        self.write("again.json", self.ok("tile-trim", self.box(), "-c", "region.json", "--print-config").out)
        self.assertEqual(self.trim("-c", "again.json")["particle_count"], got["particle_count"])

    def test_sphere_rule_of_a_combination(self):
        self.write("tube.json", {"region": [{"add": {"cylinder": [2, 2]}}, {"subtract": {"cylinder": [0.8, 2]}}]})
        got = self.trim("-c", "tube.json")
        position, radius, _, _ = read_model(self.folder / "model.h5")
        axis = np.hypot(position[:, 0], position[:, 1])
        self.assertTrue(np.all(axis + radius <= 1 + 1e-12) and np.all(axis - radius >= 0.4 - 1e-12))
        self.assertAlmostEqual(got["region_volume"], np.pi * (1 - 0.16) * 2, delta=5 * got["region_volume_error"])
        self.assertGreater(got["missing_volume_fraction"], 0.1)

    def test_parts_that_cannot_be(self):
        box = self.box()
        cases = [([{"subtract": {"cuboid": [1, 1, 1]}}], ["region", "add"]),
                 ([{"add": {"cuboid": [1, 1]}}], ["/region/0/add", "cuboid"]),
                 ([{"add": {}}], ["/region/0", "add"]),
                 ([{"add": {"cuboid": [2, 2, 2], "cylinder": [1, 1]}}], ["/region/0/add", "2 shapes"]),
                 ([{"add": {"cuboid": [2, 2, 2]}, "subtract": {"cylinder": [1, 1]}}], ["/region/0", "2 operations"]),
                 ([{"add": {"cuboid": [2, 2, 2], "axis": [0, 0, 0]}}], ["/region/0/add", "axis"]),
                 ([{"add": {"cuboid": [2, 2, 2], "ofset": [0, 0, 0]}}], ["ofset", "offset"]),
                 ([{"add": {"cuboid": [2, 2, 2]}}, {"subtract": {"cuboid": [3, 3, 3]}}], ["nothing is left"]),
                 ([{"add": {"cuboid": [2, 2, 2]}}, {"cut_out": {"cylinder": [1, 1], "offset": [9, 9, 9]}}],
                  ["cylinder", "beside the region", "offset"])]
        for parts, names in cases:
            with self.subTest(parts):
                self.write("bad.json", {"region": parts})
                got = self.run_tool("tile-trim", box, "-c", "bad.json", "-o", "x.h5")
                self.assertEqual(got.code, CONFIGURATION, str(got))
                self.assertEqual((got.out, len(got.err.splitlines())), ("", 1), str(got))
                for name in names:
                    self.assertIn(name, got.err)
        self.write("mesh.json", {"region": [{"add": {"mesh": "absent.off"}}]})
        self.fails(INPUT, "tile-trim", box, "-c", "mesh.json", "-o", "x.h5", names="absent.off")
        self.fails(INPUT, "tile-trim", box, "--cuboid", "2,2,2", "--cut-out", "absent.off", "-o", "x.h5",
                   names="absent.off")
        self.fails(USAGE, "tile-trim", box, "--cuboid", "2,2,2", "--nodata", "fill", "-o", "x.h5", names="nodata")
        self.assertNotIn("x.h5", self.files())


class Surfaces(ToolTest):
    tool = "tile-trim"

    def setUp(self):
        super().setUp()
        self.ok("pgbox-gen", "--radius", 0.09, "-o", "box.h5")
        x, y = np.meshgrid(np.arange(30), np.arange(30)[::-1])
        self.slope = 100 + 0.3 * 10 * x + 2 * np.sin(y)
        self.dug = self.slope - 8 * (np.hypot(x - 15, y - 15) < 5)

    def raster(self, name, values, **options):
        return write_raster(self.folder / name, values, **options)

    def arguments(self, *more, pre="pre.asc", post="post.asc"):
        return ["box.h5", "--pre", pre, "--post", post, "--shift", 8, "--radius-max", 2, *more, "-o", "slope.h5",
                "--overwrite", "--format", "json"]

    def test_structures_cut_out_of_a_real_slope(self):
        centre = np.array([361260.0, 71035.0])
        ring = 12 * np.exp(2j * np.pi * np.arange(12) / 12)
        pier = np.column_stack([ring.real, ring.imag]) + centre
        wall = centre + np.array([[-45, -60], [-40, -60], [-40, 20], [-45, 20]])
        prism(self.folder / "pier.off", pier, 200, 600)
        prism(self.folder / "wall.off", wall, 100, 600)
        slope = self.arguments("--domain", "361200,70950,361320,71120", "--explicit",
                               pre=HELENS / "pre_runout_DEM.asc", post=HELENS / "post_runout_DEM.asc")
        whole = self.ok("tile-trim", *slope).json
        before, before_radius, *_ = read_model(self.folder / "slope.h5")
        got = self.ok("tile-trim", *slope, "--cut-out", "pier.off,wall.off", "--cut-out-margin", "5cm").json
        after, radius, fixed, released = read_model(self.folder / "slope.h5")
        gap = np.minimum(*[distance_outside(shape, before[:, 0], before[:, 1]) for shape in (pier, wall)])
        keep = gap - before_radius >= 0.05
        self.assertTrue(np.all(np.abs(gap - before_radius - 0.05) > 1e-6), "no case of rounding")
        np.testing.assert_allclose(after, before[keep], atol=1e-9)
        self.assertEqual(got["particle_count"], keep.sum())
        self.assertLess(keep.sum(), len(keep))
        self.assertGreater(fixed.sum(), 0)
        self.assertGreater(released.sum(), 0)
        # what the structures take of the volume
        lost = whole["region_volume"] - got["region_volume"]
        x, y = np.meshgrid(np.linspace(361200, 361320, 400), np.linspace(70950, 71120, 400))
        x, y = x.ravel(), y.ravel()
        top, post = (elevation_at(HELENS / f"{name}_runout_DEM.asc", x, y) for name in ("pre", "post"))
        inside = np.minimum(distance_outside(pier, x, y), distance_outside(wall, x, y)) < 0
        expected = np.mean(np.where(inside, top - np.minimum(top, post) + 8, 0)) * 120 * 170
        self.assertAlmostEqual(lost / expected, 1, delta=0.02)
        prism(self.folder / "far.off", pier + 5000, 200, 600)
        self.fails(CONFIGURATION, "tile-trim", *slope, "--cut-out", "far.off", names=["far.off", "beside", "offset"])

    def test_another_projected_system(self):
        """Systems that differ in scale alone: the same slope after the tool has brought post into pre's system."""
        left, lower, cell, scale = 560000, 5100000, 10, 0.9996
        self.raster("pre.asc", self.slope, lower_left=(left, lower))
        self.raster("post.asc", self.dug, lower_left=(left, lower))
        (self.folder / "pre.prj").write_text(mercator(1))
        (self.folder / "post.prj").write_text(mercator(1))
        domain = ("--domain", f"{left + 20},{lower + 20},{left + 280},{lower + 280}")
        same = self.ok("tile-trim", *self.arguments(*domain)).json
        self.assertNotIn("post_reprojected", same["surfaces"])
        self.raster("post.asc", self.dug, lower_left=((left - 500000) * scale + 500000, lower * scale),
                    cell=cell * scale)
        (self.folder / "post.prj").write_text(mercator(scale))
        other = self.ok("tile-trim", *self.arguments(*domain)).json
        done = other["surfaces"]["post_reprojected"]
        self.assertEqual(done["method"], "bilinear")
        self.assertAlmostEqual(done["cell"], cell / 4, 3)
        self.assertAlmostEqual(other["region_release_volume"] / same["region_release_volume"], 1, delta=0.02)
        self.assertAlmostEqual(other["particle_count"] / same["particle_count"], 1, delta=0.01)
        # without its .prj post is taken to be in pre's system, 200 m and more away
        (self.folder / "post.prj").unlink()
        self.fails(INPUT, "tile-trim", *self.arguments(*[]), names=["post.asc", "overlap"])

    def test_cells_without_data(self):
        holed = self.dug.copy()
        holed[20:22, 8] = -9999
        self.raster("pre.asc", self.slope)
        self.raster("post.asc", holed)
        self.fails(CONFIGURATION, "tile-trim", *self.arguments(),
                   names=["post.asc", "no data", "x 85, y 85", "2 cells", "200 m2", "--nodata fill"])
        self.fails(CONFIGURATION, "tile-trim", *self.arguments("--domain", "20,99,280,280"),
                   names=["post.asc", "no data", "at its edge"])
        whole = self.ok("tile-trim", *self.arguments("--domain", "20,110,280,280")).json
        self.assertEqual(whole["surfaces"]["post_cells_filled"], 0)
        filled = self.ok("tile-trim", *self.arguments("--nodata", "fill")).json
        self.assertEqual(filled["surfaces"]["post_cells_filled"], 2)
        self.assertEqual(filled["surfaces"]["post_area_filled"], 200)
        self.raster("post.asc", self.dug)
        complete = self.ok("tile-trim", *self.arguments()).json
        self.assertAlmostEqual(filled["region_volume"] / complete["region_volume"], 1, delta=1e-3)
        wide = self.dug.copy()
        wide[8:26, 5:25] = -9999
        self.raster("post.asc", wide)
        self.fails(CONFIGURATION, "tile-trim", *self.arguments("--nodata", "fill", "--nodata-reach", "30m"),
                   names=["post.asc", "no data"])

    def test_surfaces_that_cannot_be_meant(self):
        self.raster("pre.asc", self.slope)
        for what, post, names in (("feet", self.dug / 0.3048, ["post.asc", "feet", "metres"]),
                                  ("another datum", self.dug + 3000, ["post.asc", "datums"]),
                                  ("exchanged", self.slope + 1, ["post.asc", "above pre.asc everywhere", "exchange"])):
            with self.subTest(what):
                self.raster("post.asc", post)
                self.fails(INPUT, "tile-trim", *self.arguments(), names=names)
        self.raster("post.asc", self.dug)
        self.fails(USAGE, "tile-trim", *self.arguments("--shift", 0), names=["shift", "0"])
        self.fails(CONFIGURATION, "tile-trim", *self.arguments("--shift", "3.9m"), names=["3.9 m", "cannot hold"])
        ring = [[500, 500], [600, 500], [600, 600], [500, 500]]
        self.write("far.geojson", {"type": "FeatureCollection", "features": [
            {"type": "Feature", "properties": {}, "geometry": {"type": "Polygon", "coordinates": [ring]}}]})
        self.fails(CONFIGURATION, "tile-trim", *self.arguments("--source-area", "far.geojson"),
                   names=["far.geojson", "source area", "outside the domain"])

    def test_surfaces_that_cross_are_reported(self):
        self.raster("pre.asc", self.slope)
        self.raster("post.asc", self.dug + 5 * (np.arange(30) > 25))
        got = self.ok("tile-trim", *self.arguments()).json["surfaces"]
        self.assertAlmostEqual(got["highest_change"], 5, delta=0.01)
        self.assertAlmostEqual(got["lowest_change"], -8, delta=0.01)
        # columns of cells 26 to 29 and half the way to 25, of all cells' centres from 5 to 295
        self.assertAlmostEqual(got["deposited_volume"], 290 * (30 + 5) * 5, delta=20)
        self.assertGreater(got["eroded_area"], 5000)

    def test_surface_is_measured(self):
        self.raster("pre.asc", self.slope)
        self.raster("post.asc", self.dug)
        got = {rule: self.ok("tile-trim", *self.arguments("--surface-rule", rule, "--explicit")).json
               for rule in ("centre", "sphere")}
        for rule, result in got.items():
            self.assertGreater(result["surface"]["samples"], 3000)
            self.assertLess(result["surface"]["share_open"], 0.1)
        self.assertTrue(0 < got["centre"]["surface"]["highest"] <= 1)
        self.assertLessEqual(got["sphere"]["surface"]["highest"], 0)
        # whole spheres only: about a radius lower
        deeper = got["sphere"]["surface"]["mean_depth"] - got["centre"]["surface"]["mean_depth"]
        self.assertTrue(0.7 < deeper < 1.6, deeper)
        self.assertLess(abs(got["centre"]["missing_volume_fraction"]), 0.01)
        self.assertGreater(got["sphere"]["missing_volume_fraction"], 0.1)
        # the envelope itself, by hand, from the explicit model
        position, radius, _, _ = read_model(self.folder / "slope.h5")
        random = np.random.default_rng(1)
        depth = []
        for x, y in random.uniform(20, 280, (1500, 2)):
            rest = radius**2 - (position[:, 0] - x)**2 - (position[:, 1] - y)**2
            highest = np.max(position[rest > 0, 2] + np.sqrt(rest[rest > 0]), initial=-1e9)
            top, right, left, north, south = elevation_at(
                self.folder / "pre.asc", np.array([x, x + 2, x - 2, x, x]), np.array([y, y, y, y + 2, y - 2]))
            depth.append(min((top - highest) / np.hypot(1, np.hypot(right - left, north - south) / 4) / 2, 6))
        found = got["sphere"]["surface"]
        self.assertAlmostEqual(found["mean_depth"], np.mean(depth), delta=5 * np.std(depth) / np.sqrt(1500))
        self.assertAlmostEqual(found["roughness"], np.std(depth), delta=0.15)

    def test_box_of_less_than_two_grains(self):
        self.ok("pgbox-gen", "--radius", 0.09, "-o", "small.h5")
        import h5py
        with h5py.File(self.folder / "small.h5", "r+") as file:
            file["particles/all/radius"][...] = 0.26
        self.fails(INPUT, "tile-trim", "small.h5", "--cuboid", "9,9,9", "-o", "x.h5", names=["small.h5", "two grains"])


if __name__ == "__main__":
    main()
