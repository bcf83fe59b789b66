# SPDX-License-Identifier: GPL-3.0-or-later
"""tile-trim: layers of the ground with boxes and materials of their own, against numpy; what dem-run makes of them."""
import h5py
import numpy as np

from rank_runs import mpirun
from rasters import elevation_at, write_raster
from talus_tools import CONFIGURATION, HELENS, INPUT, ToolTest, main
from test_tile_trim import read_box, read_model, rows_in_order, stl_of_cuboid, tiled_by_hand

PRE, POST = HELENS / "pre_runout_DEM.asc", HELENS / "post_runout_DEM.asc"


def materials(path):
    with h5py.File(path, "r") as file:
        group = file["particles/all"]
        return group["material"][:] if "material" in group else np.zeros(len(group["radius"]), int)


def overlaps(position, radius, others, other_radius):
    """Largest overlap of each grain with any of the others, in radii of the smaller of the two."""
    found = np.full(len(position), -np.inf)
    for start in range(0, len(position), 500):
        rows = slice(start, start + 500)
        distance = np.linalg.norm(position[rows, None] - others[None], axis=2)
        overlap = radius[rows, None] + other_radius - distance
        if len(others):
            found[rows] = (overlap / np.minimum(radius[rows, None], other_radius)).max(1)
    return found


class Strata(ToolTest):
    tool = "tile-trim"

    def boxes(self):
        for name, options in (("fine.pgbox.h5", ["--radius", 0.09]),
                              ("coarse.pgbox.h5", ["--radius", 0.09, "--seed", 5])):
            if not (self.folder / name).exists():
                self.ok("pgbox-gen", *options, "-o", name)
        return ["fine.pgbox.h5", "coarse.pgbox.h5"]

    def trim(self, config, *arguments, output="model.h5", boxes=None):
        self.write("strata.json", config)
        return self.ok("tile-trim", *(boxes or self.boxes()), "-c", "strata.json", *arguments, "-o", output,
                       "--overwrite", "--format", "json")

    def expect(self, wanted, output="model.h5"):
        """The explicit model holds these grains, given as (positions, radii, material)."""
        found, radius, _, _ = read_model(self.folder / output)
        got = np.column_stack([found, radius, materials(self.folder / output)])
        want = np.vstack([np.column_stack([p, r, np.full(len(r), m)]) for p, r, m in wanted])
        self.assertEqual(len(got), len(want))
        np.testing.assert_allclose(rows_in_order(got), rows_in_order(want), atol=1e-9)

    def test_two_flat_layers(self):
        fine, coarse = self.boxes()
        size = np.array([5.0, 4.0, 6.0])
        got = self.trim({"cuboid": list(size), "surface_rule": "centre", "radius_max": "0.1m", "strata": [
            {"box": 1, "material": 2, "radius_max": "20cm", "below": {"height": 3}}]}, "--explicit").json
        layers = []
        for name, largest in ((fine, 0.1), (coarse, 0.2)):
            position, radius, length = read_box(self.folder / name)
            scale = largest / radius.max()
            copies, radii = tiled_by_hand(position * scale, radius * scale, length * scale, [0, 0, 0], size)
            keep = np.all((copies >= 0) & (copies <= size), axis=1)
            layers.append((copies[keep], radii[keep]))
        (top, top_radius), (bottom, bottom_radius) = layers
        own = top[:, 2] > 3
        top, top_radius = top[own], top_radius[own]
        own = bottom[:, 2] <= 3
        bottom, bottom_radius = bottom[own], bottom_radius[own]
        over = overlaps(top, top_radius, bottom, bottom_radius)
        keep = over <= 0.05
        self.expect([(top[keep], top_radius[keep], 0), (bottom, bottom_radius, 2)])
        meet = got["interfaces"]
        self.assertEqual(meet["dropped_count"], (~keep).sum())
        self.assertGreater(meet["dropped_count"], 10)
        self.assertAlmostEqual(meet["dropped_volume"], 4 / 3 * np.pi * (top_radius[~keep]**3).sum(), 9)
        self.assertAlmostEqual(meet["largest_overlap"], over[keep].max(), 9)
        self.assertEqual([s["particle_count"] for s in got["strata"]], [keep.sum(), len(bottom)])
        self.assertEqual(got["strata"][1]["dropped_count"], 0)
        solid = 4 / 3 * np.pi * (np.sum(top_radius[keep]**3) + np.sum(bottom_radius**3))
        self.assertAlmostEqual(got["kept_volume"], solid, 6)
        self.assertAlmostEqual(got["missing_volume"],
                               got["region_volume"] * got["box_solid_volume_fraction"] - solid, 6)
        # Nothing is left out where any overlap but a grain on a grain is allowed, and less than above.
        more = self.trim({"cuboid": list(size), "surface_rule": "centre", "radius_max": "0.1m", "strata_overlap": 0.5,
                          "strata": [{"box": 1, "material": 2, "radius_max": "20cm", "below": {"height": 3}}]}).json
        self.assertLess(more["interfaces"]["dropped_count"], meet["dropped_count"])
        self.assertLess(more["missing_volume"], got["missing_volume"])

    def test_lens(self):
        self.write("cuboid.stl", stl_of_cuboid([1.3, 1.5, 1.2]))
        got = self.trim({"cuboid": [4, 4, 4], "surface_rule": "centre", "radius_max": "15cm", "strata": [
            {"box": 1, "material": 1, "below": {"height": 2.2}},
            {"box": 0, "material": 3, "inside": {"mesh": "cuboid.stl", "offset": [1, 1.1, 1.7]},
             "radius_max": "7cm"}]}, "--explicit").json
        position, radius, _, _ = read_model(self.folder / "model.h5")
        material = materials(self.folder / "model.h5")
        lens = np.all((position > [1, 1.1, 1.7]) & (position < [2.3, 2.6, 2.9]), axis=1)
        below = position[:, 2] <= 2.2
        np.testing.assert_array_equal(material, np.where(lens, 3, np.where(below, 1, 0)))
        self.assertEqual([s["particle_count"] for s in got["strata"]],
                         [(material == m).sum() for m in (0, 1, 3)])
        for m in (0, 1, 3):
            self.assertGreater((material == m).sum(), 50)
            others = material != m
            self.assertLessEqual(overlaps(position[~others], radius[~others], position[others], radius[others]).max(),
                                 0.05 + 1e-9)
        self.assertLessEqual(radius[lens].max(), 0.07 + 1e-12)

    def test_real_ground(self):
        """A depth and a raster of rock under St Helens; tiled equals explicit; what -n foretells."""
        values = np.array([line.split() for line in PRE.read_text().split("\n")[6:] if line.split()], float)
        head = dict(line.split() for line in PRE.read_text().split("\n")[:6])
        head = {k.lower(): float(v) for k, v in head.items()}
        cell = head["cellsize"]
        write_raster(self.folder / "rock.asc", np.where(values > -9000, values - 7, -9999),
                     (head["xllcorner"], head["yllcorner"]), cell)
        config = {"pre": str(PRE), "post": str(POST), "shift": "8m", "domain": "361150,71000,361350,71150",
                  "radius_max": "1m", "strata": [
                      {"box": 1, "material": 1, "radius_max": "150cm", "below": {"depth": "3m"}},
                      {"box": 0, "material": 2, "below": {"raster": "rock.asc"}}]}
        explicit = self.trim(config, "--explicit", output="explicit.h5").json
        tiled = self.trim(config, "--threads", 1, output="tiled.h5").json
        self.ok("tile-trim", "tiled.h5", "--explicit", "-o", "expanded.h5")
        with h5py.File(self.folder / "explicit.h5", "r") as a, h5py.File(self.folder / "expanded.h5", "r") as b:
            names = []
            a["particles/all"].visititems(lambda name, item: names.append(f"particles/all/{name}")
                                          if isinstance(item, h5py.Dataset) else None)
            names += ["connectivity/contacts", "granular/contacts/image", "granular/contacts/normal_overlap"]
            self.assertIn("particles/all/material", names)
            for name in names:
                np.testing.assert_array_equal(a[name][()], b[name][()], err_msg=name)
            pairs = a["connectivity/contacts"][:]
        position, radius, fixed, _ = read_model(self.folder / "explicit.h5")
        material = materials(self.folder / "explicit.h5")
        depth = elevation_at(PRE, position[:, 0], position[:, 1]) - position[:, 2]
        np.testing.assert_array_equal(material, np.where(depth >= 7, 2, np.where(depth >= 3, 1, 0)))
        across = material[pairs[:, 0]] != material[pairs[:, 1]]
        self.assertGreater(across.sum(), 100)
        i, j = pairs[across].T
        gap = radius[i] + radius[j] - np.linalg.norm(position[i] - position[j], axis=1)
        self.assertGreater(gap.min(), -1e-6)
        self.assertLessEqual((gap / np.minimum(radius[i], radius[j])).max(), 0.05 + 1e-6)
        for key in ("particle_count", "fixed_count", "release_count", "interfaces", "strata"):
            self.assertEqual(tiled[key], explicit[key])
        self.assertEqual(fixed.sum(), tiled["fixed_count"])
        for extra, got in (([], tiled), (["--explicit"], explicit)):
            foretold = self.trim(config, "-n", *extra, output="none.h5").json
            self.assertEqual(foretold["particle_count"], got["particle_count"])
            self.assertLess(abs(foretold["bytes_written"] - got["bytes_written"]),
                            max(8192, 0.02 * got["bytes_written"]))
        self.assertNotIn("none.h5", self.files())

    def test_dem_run(self):
        """Slippery ground slides on a tilt that rough ground stands on; tiled, explicit and ranks run the same."""
        config = {"cuboid": [3, 3, 2], "surface_rule": "centre", "strata": [
            {"box": 1, "material": 1, "inside": {"cuboid": [1.5, 3, 2]}}]}
        self.trim(config, output="tiled.h5")
        self.trim(config, "--explicit", output="explicit.h5")
        scene = {"gravity": [0, 6, -7.8], "time": {"end": "0.3s"}, "material": {"friction": 1.0},
                 "materials": [{"friction": 0.0}], "stress_free_start": True,
                 "output": {"frame_interval": "0.3s", "float64": True},
                 "walls": [{"name": "floor", "plane": {"point": [0, 0, 0.05], "normal": [0, 0, 1]}}]}
        self.write("scene.json", scene)
        frames = {}
        for run, name, ranks, extra in (("tiled", "tiled", 1, []), ("explicit", "explicit", 1, ["--threads", 1]),
                                        ("ranks", "tiled", 3, [])):
            self.ok("dem-run", f"{name}.h5", "-c", "scene.json", *extra, "-o", f"{run}.traj.h5", wrapper=mpirun(ranks))
            with h5py.File(self.folder / f"{run}.traj.h5", "r") as file:
                frames[run] = file["particles/all/position/value"][:]
                np.testing.assert_array_equal(file["particles/all/material"][:],
                                              materials(self.folder / "explicit.h5"))
        np.testing.assert_array_equal(frames["tiled"], frames["explicit"])
        np.testing.assert_array_equal(frames["tiled"], frames["ranks"])
        moved = np.linalg.norm(frames["tiled"][-1] - frames["tiled"][0], axis=1)
        slippery = materials(self.folder / "explicit.h5") == 1
        self.assertGreater(np.median(moved[slippery]), 1.2 * np.median(moved[~slippery]))

    def test_without_strata_nothing_changes(self):
        self.ok("tile-trim", self.boxes()[0], "--cuboid", "2,2,2", "-o", "plain.h5")
        with h5py.File(self.folder / "plain.h5", "r") as file:
            self.assertNotIn("scale", file["granular/boxes/0000"].attrs)
        self.ok("tile-trim", "plain.h5", "--explicit", "-o", "explicit.h5")
        with h5py.File(self.folder / "explicit.h5", "r") as file:
            self.assertNotIn("material", file["particles/all"])

    def test_empty_stratum_is_named(self):
        got = self.trim({"cuboid": [3, 3, 3], "strata": [{"box": 1, "below": {"height": -1}}]})
        self.assertIn("strata.0: holds no grain", got.err)
        self.assertEqual(got.json["strata"][1]["particle_count"], 0)
        got = self.trim({"cuboid": [3, 3, 3], "strata": [{"box": 1, "below": {"height": 5}}]})
        self.assertIn("box 0 fills nothing", got.err)

    def refuses(self, code, config, names, boxes=None):
        self.write("strata.json", config)
        got = self.run_tool("tile-trim", *(boxes or self.boxes()), "-c", "strata.json", "-o", "x.h5")
        self.assertEqual((got.code, got.out, len(got.err.splitlines())), (code, "", 1), str(got))
        for name in [names] if isinstance(names, str) else names:
            self.assertIn(name, got.err)
        self.assertNotIn("x.h5", self.files())

    def test_what_is_refused(self):
        cuboid = {"cuboid": [3, 3, 3]}
        below = {"below": {"height": 1}}
        self.refuses(CONFIGURATION, {**cuboid, "strata": [{"box": 2, **below}]}, ("strata.0.box", "found 2", "0 to 1"))
        self.refuses(CONFIGURATION, {**cuboid, "strata": [{"box": 0, **below}]}, ("coarse.pgbox.h5", "no stratum uses"))
        self.refuses(CONFIGURATION, {**cuboid, "strata": [{"box": 1}]}, ("/strata/0", "found 0 places"))
        self.refuses(CONFIGURATION, {**cuboid, "strata": [{"box": 1, "below": {"height": 1, "depth": 1}}]},
                     ("/strata/0", "found 2 places"))
        self.refuses(CONFIGURATION, {**cuboid, "strata": [{"box": 1, "below": {"depth": 1}}]},
                     ("strata.0.below.depth", "--pre"))
        self.refuses(CONFIGURATION, {**cuboid, "strata": [{"box": 1, "inside": {"cuboid": [1, 1]}}]},
                     ("strata.json:1:", "/strata/0/inside/cuboid", "[X, Y, Z]"))
        self.refuses(CONFIGURATION, {**cuboid, "strata": [{"box": 1, "material": 256, **below}]}, "/strata/0/material")
        self.refuses(CONFIGURATION, {**cuboid, "strata_overlap": 0.1}, "strata_overlap", boxes=self.boxes()[:1])
        self.refuses(CONFIGURATION, {**cuboid, "strata": [{"box": 1, **below}], "strata_overlap": 2}, "strata_overlap")
        self.refuses(INPUT, {**cuboid, "strata": [{"box": 1, "below": {"raster": "absent.asc"}}]}, "absent.asc")
        write_raster(self.folder / "small.asc", np.full((5, 5), 1.0), (1, 1), 1)
        self.refuses(CONFIGURATION, {**cuboid, "strata": [{"box": 1, "below": {"raster": "small.asc"}}]},
                     ("small.asc", "covers the region"))
        hole = np.full((8, 8), 1.0)
        hole[4, 4] = -9999
        write_raster(self.folder / "hole.asc", hole, (-2, -2), 1)
        self.refuses(CONFIGURATION, {**cuboid, "strata": [{"box": 1, "below": {"raster": "hole.asc"}}]}, "hole.asc")
        self.trim({**cuboid, "strata": [{"box": 1, **below}]}, output="model.h5")
        self.write("strata.json", {"strata": [{"box": 0, **below}]})
        self.fails(INPUT, "tile-trim", "model.h5", "-c", "strata.json", "--explicit", "-o", "x.h5", names="model.h5")


if __name__ == "__main__":
    main()
