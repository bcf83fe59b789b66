# SPDX-License-Identifier: GPL-3.0-or-later
"""runout-analyse: a slide whose every grain is known in advance, and rasters and trajectories that cannot be used."""
import shutil
import subprocess

import h5py
import numpy as np

from common_behaviour import ReadsInput
from rasters import read_raster, write_raster
from talus_tools import DEGREES, EXISTS, INPUT, USAGE, ToolTest, copy_with, main, write_model

RADIUS = 0.5
VELOCITY = np.array([10.0, 0, -5])


class RunoutAnalyse(ReadsInput, ToolTest):
    """A block of 7 x 7 x 4 released grains flies at a constant velocity for 10 s, away from as many that stay."""

    tool = "runout-analyse"
    arguments = ("-q",)  # so few grains are worth a warning
    needs_output = False
    wrong_kind = "model"
    damaged = ("/particles/all/position/value", "/particles/all/radius", "/particles/all/position/step")
    keys = ("max_travel_distance", "travel_histogram", "runout_length", "drop_height", "runout_ratio", "runout_angle",
            "moved_volume", "excavated_volume", "deposited_volume", "affected_area", "center_of_mass_displacement")

    def input(self):
        if (self.folder / "slide.h5").exists():
            return "slide.h5"
        grid = np.stack(np.meshgrid(np.arange(7), np.arange(7), np.arange(4), indexing="ij"), -1).reshape(-1, 3)
        block = 1000 + 1.5 * grid.astype(float)
        still = block + [0, 0, -40]
        self.count = len(block)
        self.start = np.vstack([block, still])
        velocity = np.vstack([np.tile(VELOCITY, (len(block), 1)), np.zeros_like(still)])
        write_model(self.folder / "block.h5", self.start, np.full(2 * len(block), RADIUS), velocity=velocity,
                    release=np.repeat(np.array([1, 0], dtype="u1"), len(block)))
        self.write("fly.json", {"gravity": [0, 0, 0], "material": {"youngs_modulus": 1e5},
                                "output": {"frame_interval": "1s", "float64": True, "series_interval": "1s"},
                                "stages": [{"name": "slide", "release": True, "end": "10s"}]})
        self.ok("dem-run", "block.h5", "-c", "fly.json", "-o", "slide.h5", "-q")
        with h5py.File(self.folder / "slide.h5", "r") as file:
            self.times = file["particles/all/position/time"][:]
            position = file["particles/all/position"]
            self.end = position["value"][-1] + position.attrs.get("origin", np.zeros(3))
        return "slide.h5"

    def test_numbers(self):
        self.input()
        got = self.ok("runout-analyse", "slide.h5", "--solid-volume-fraction", 0.5, "--cell", 1.5, "--format",
                      "json").json
        speed = np.linalg.norm(VELOCITY)
        self.assertEqual(got["particle_count"], 2 * self.count)
        self.assertEqual(got["released_count"], self.count)
        self.assertEqual(got["moved_count"], self.count)
        np.testing.assert_allclose(got["max_travel_distance"], speed * self.times, rtol=1e-9, atol=1e-9)
        fraction = np.array(got["travel_histogram"]["fraction"])
        edges = np.array(got["travel_histogram"]["bin_edges"])
        self.assertEqual(len(edges), len(fraction) + 1)
        travel = speed * self.times[-1]
        self.assertAlmostEqual(fraction[np.searchsorted(edges, travel) - 1], 0.5)
        self.assertAlmostEqual(fraction.sum(), 0.5)
        np.testing.assert_allclose(np.diff(edges), 50)
        self.assertEqual(edges[0], 50)
        moved = VELOCITY * self.times[-1]
        np.testing.assert_allclose(got["center_of_mass_displacement"], moved, atol=1e-6)
        solid = self.count * 4 / 3 * np.pi * RADIUS**3
        self.assertAlmostEqual(got["moved_volume"], solid / 0.5, 6)
        self.assertAlmostEqual(got["excavated_volume"] / (solid / 0.5), 1, delta=0.01)
        self.assertAlmostEqual(got["deposited_volume"] / (solid / 0.5), 1, delta=0.01)
        # Crown: the top of the highest released grain; toe: the moved grain furthest from it, level.
        crown, toe = np.array(got["crown"]), np.array(got["toe"])
        self.assertAlmostEqual(crown[2], self.start[:, 2].max() + RADIUS, 6)
        ends = self.end[:self.count]
        far = np.hypot(*(ends - crown)[:, :2].T).max()
        self.assertAlmostEqual(got["runout_length"], far, delta=RADIUS + 1e-6)
        self.assertAlmostEqual(got["runout_length"], np.hypot(*(toe - crown)[:2]), 6)
        self.assertAlmostEqual(got["drop_height"], crown[2] - toe[2], 6)
        self.assertAlmostEqual(got["runout_ratio"], got["drop_height"] / got["runout_length"], 9)
        self.assertAlmostEqual(got["runout_angle"], np.degrees(np.arctan(got["runout_ratio"])), 9)

    def outline(self, name, lower, upper):
        ring = [[lower[0], lower[1]], [upper[0], lower[1]], [upper[0], upper[1]], [lower[0], upper[1]],
                [lower[0], lower[1]]]
        return self.write(name, {"type": "FeatureCollection",
                                 "crs": {"type": "name", "properties": {"name": "urn:ogc:def:crs:EPSG::32149"}},
                                 "features": [{"type": "Feature", "properties": {},
                                               "geometry": {"type": "Polygon", "coordinates": [ring]}}]})

    def test_agreement(self):
        """Areas against an outline: what they must add up to, and none at all where it lies elsewhere."""
        for what, lower, upper in (("over the start", [995, 995], [1015, 1015]), ("beside", [1000, 1025], [1020, 1035]),
                                   ("over all", [990, 990], [1120, 1020])):
            with self.subTest(what):
                self.input()
                self.outline("seen.geojson", lower, upper)
                got = self.ok("runout-analyse", "slide.h5", "--observed-outline", "seen.geojson", "--cell", 2.5,
                              "--threshold", 0.3, "--format", "json").json
                true, false, missed = (got[f"{name}_area"] for name in ("true_positive", "false_positive",
                                                                        "false_negative"))
                self.assertAlmostEqual(true + false, got["affected_area"], 6)
                union = true + false + missed
                self.assertAlmostEqual(got["intersection_over_union"], true / union, 9)
                self.assertAlmostEqual(got["critical_success_index"], true / union, 9)
                if what == "beside":
                    self.assertEqual(true, 0)
                if what == "over all":
                    self.assertEqual(false, 0)
                    self.assertAlmostEqual(true, got["affected_area"])
                    self.assertAlmostEqual(true + missed, 130 * 30, delta=2.5 * 2 * 160)

    def test_observed_difference(self):
        """The computed change taken for the observed one agrees with itself."""
        self.input()
        self.ok("runout-analyse", "slide.h5", "--rasters", "own", "--raster-format", "asc", "--cell", 2.5)
        got = self.ok("runout-analyse", "slide.h5", "--observed-difference", "own_elevation_change.asc", "--format",
                      "json").json
        for change in ("deposit_agreement", "excavation_agreement"):
            self.assertAlmostEqual(got[change]["intersection_over_union"], 1)
        self.assertAlmostEqual(got["change_root_mean_square"], 0, delta=1e-3)
        self.assertAlmostEqual(got["observed_excavated_volume"] / got["excavated_volume"], 1, delta=1e-3)

    def test_rasters(self):
        self.input()
        got = self.ok("runout-analyse", "slide.h5", "--rasters", "maps/", "--raster-format", "asc", "--cell", 2,
                      "--format", "json").json
        names = ["deposit", "elevation_change", "excavation", "flow_thickness", "max_travel"]
        self.assertEqual([name for name in self.files(self.folder / "maps") if name.endswith(".asc")],
                         [f"{name}.asc" for name in names])
        maps = {name: read_raster(self.folder / "maps" / f"{name}.asc") for name in names}
        values, lower_left, cell = maps["deposit"]
        self.assertEqual(cell, 2)
        self.assertAlmostEqual(np.nansum(values) * cell**2 / got["deposited_volume"], 1, delta=1e-4)
        self.assertAlmostEqual(np.nansum(maps["excavation"][0]) * cell**2 / got["excavated_volume"], 1, delta=1e-4)
        change = np.nan_to_num(maps["elevation_change"][0])
        np.testing.assert_allclose(change, np.nan_to_num(values) - np.nan_to_num(maps["excavation"][0]), atol=1e-5)
        # The deposit lies under the grains' end, the excavation over their start.
        rows, columns = np.nonzero(np.nan_to_num(values) > 1e-6)
        x = lower_left[0] + (columns + 0.5) * cell
        y = lower_left[1] + (values.shape[0] - rows - 0.5) * cell
        ends = self.end[:self.count]
        self.assertTrue(np.all((x > ends[:, 0].min() - RADIUS - cell) & (x < ends[:, 0].max() + RADIUS + cell)))
        self.assertTrue(np.all((y > ends[:, 1].min() - RADIUS - cell) & (y < ends[:, 1].max() + RADIUS + cell)))
        travel = maps["max_travel"][0]
        self.assertAlmostEqual(np.nanmax(travel), got["max_travel_distance"][-1], delta=1e-3)

    def test_geotiff_is_the_same_raster(self):
        self.input()
        for form in ("asc", "tif"):
            self.ok("runout-analyse", "slide.h5", "--rasters", "map", "--raster-format", form, "--cell", 2)
        self.assertEqual((self.folder / "map_deposit.tif").read_bytes()[:2], b"II")
        if not shutil.which("gdal_translate"):
            self.skipTest("gdal_translate is not installed")
        subprocess.run(["gdal_translate", "-q", "-of", "AAIGrid", "map_deposit.tif", "back.asc"], cwd=self.folder,
                       check=True)
        first, second = read_raster(self.folder / "map_deposit.asc"), read_raster(self.folder / "back.asc")
        np.testing.assert_allclose(np.nan_to_num(first[0]), np.nan_to_num(second[0]), atol=1e-4)
        np.testing.assert_allclose(first[1], second[1])

    def test_pictures(self):
        self.input()
        self.ok("runout-analyse", "slide.h5", "--plot", "p/", "--plot-format", "svg")
        for name in ("map", "max_travel", "travel_histogram", "energy"):
            self.assertIn("</svg>", (self.folder / "p" / f"{name}.svg").read_text(), name)
        self.ok("runout-analyse", "slide.h5", "--plot", "p/")
        self.assertEqual((self.folder / "p" / "map.png").read_bytes()[:8], b"\x89PNG\r\n\x1a\n")

    def test_existing_rasters_and_pictures(self):
        self.input()
        self.write("m_deposit.tif", "precious")
        self.write("p_energy.png", "precious")
        self.fails(EXISTS, "runout-analyse", "slide.h5", "--rasters", "m", names="m_deposit.tif")
        self.fails(EXISTS, "runout-analyse", "slide.h5", "--plot", "p", names="p_energy.png")
        self.assertEqual((self.folder / "m_deposit.tif").read_text(), "precious")
        self.assertEqual((self.folder / "p_energy.png").read_text(), "precious")
        self.assertFalse([name for name in self.files() if name.startswith(("m_", "p_")) and
                          name not in ("m_deposit.tif", "p_energy.png")])
        self.ok("runout-analyse", "slide.h5", "--rasters", "m", "--plot", "p", "--overwrite")
        self.assertNotEqual((self.folder / "m_deposit.tif").read_bytes(), b"precious")

    def test_rasters_that_cannot_be_used(self):
        self.input()
        nothing = write_raster(self.folder / "nothing.asc", np.full((20, 20), -9999.0), (990, 990))
        far = write_raster(self.folder / "far.asc", np.zeros((20, 20)), (50000, 50000))
        self.write("words.asc", "ncols many\n")
        for option in ("--observed-difference", "--pre"):
            for name in (DEGREES, far, nothing, "words.asc", "absent.asc"):
                if option == "--observed-difference" and name == nothing:
                    continue  # no data means no change there
                with self.subTest(option, name=name):
                    self.fails(INPUT, "runout-analyse", "slide.h5", option, name, "-o", "out.json",
                               names=str(name).rsplit("/", 1)[-1])
        self.write("words.geojson", "{}")
        for name in ("words.geojson", "absent.geojson"):
            self.fails(INPUT, "runout-analyse", "slide.h5", "--observed-outline", name, names=name)
        self.assertNotIn("out.json", self.files())

    def test_not_a_number(self):
        self.input()
        copy_with(self.folder / "slide.h5", self.folder / "nan.h5",
                  lambda file: file["particles/all/position/value"].__setitem__((3, 5, 0), np.nan))
        self.fails(INPUT, "runout-analyse", "nan.h5", names=["nan.h5", "position"])
        copy_with(self.folder / "slide.h5", self.folder / "nan.h5",
                  lambda file: file["particles/all/radius"].__setitem__(5, np.nan))
        self.fails(INPUT, "runout-analyse", "nan.h5", names=["nan.h5", "radius"])

    def test_stage_that_is_not_there(self):
        self.input()
        got = self.run_tool("runout-analyse", "slide.h5", "--from", "slid")
        self.assertIn(got.code, (INPUT, USAGE), str(got))
        self.assertIn("slide", got.err)
        self.ok("runout-analyse", "slide.h5", "--from", "start")


if __name__ == "__main__":
    main()
