# SPDX-License-Identifier: GPL-3.0-or-later
"""The chain on the real slope at a coarse scale: box, judgement, tiles, run, analysis. What one tool writes the next
reads, rows stay particles, and the mass that moves is the mass that was released."""
import pathlib
import shutil
import tempfile

import h5py
import numpy as np

from rasters import elevation_at, inside, read_raster
from talus_tools import DONE, HELENS, INPUT, STOPPED, ToolTest, check_xdmf, datasets, main, physical

PRE, POST = HELENS / "pre_runout_DEM.asc", HELENS / "post_runout_DEM.asc"
SOURCE, DIFFERENCE = HELENS / "source_area.geojson", HELENS / "DEM_of_Difference.asc"


class Pipeline(ToolTest):
    """Made once for all tests of this class, which only read."""

    @classmethod
    def setUpClass(cls):
        cls.made = pathlib.Path(tempfile.mkdtemp(prefix="talus-test-"))
        cls.addClassCleanup(shutil.rmtree, cls.made, ignore_errors=True)
        chain = cls("run_chain")
        chain.folder = cls.made
        chain.run_chain()
        cls.results = chain.results

    def setUp(self):
        self.folder = self.made

    def run_chain(self):
        self.results = {}

        def step(tool, *arguments):
            self.results[tool] = self.ok(tool, *arguments, "--format", "json").json

        step("pgbox-gen", "--radius", 0.06, "--radius-min-ratio", 0.82, "-o", "box.pgbox.h5")
        step("pgbox-stats", "box.pgbox.h5")
        step("tile-trim", "box.pgbox.h5", "--pre", PRE, "--post", POST, "--shift", "8m", "--source-area", SOURCE,
             "--domain", "361190,70850,361330,71130", "--radius-max", 2, "-o", "slope.model.h5")
        self.write("scene.json", {  # weak, so that it goes within seconds
            "gravity": [0, 0, -9.81], "material": {"density": "2.4g/cm3", "friction": 0.1},
            "bond": {"bond_pressure": "0.5kPa", "bond_friction": 2}, "stress_free_start": True,
            "output": {"frame_interval": "1s", "series_interval": "100ms"},
            "stages": [{"name": "settle", "until": "rest", "limit": "1s", "damping": {"viscous": "2Hz"}},
                       {"name": "slide", "release": True, "end": "6s"}]})
        step("dem-run", "slope.model.h5", "-c", "scene.json", "-o", "slide.traj.h5")
        step("runout-analyse", "slide.traj.h5", "--pre", PRE, "--observed-difference", DIFFERENCE, "--rasters", "map",
             "--raster-format", "asc", "--plot", "picture")

    def slide(self):
        with h5py.File(self.made / "slide.traj.h5", "r") as file:
            group = file["particles/all"]
            origin = group["position"].attrs["origin"]
            marks = {mark.attrs["name"].decode(): int(mark.attrs["step"]) for mark in file["granular/stages"].values()}
            first = int(np.flatnonzero(group["position/step"][:] <= marks["slide"])[-1])
            return (group["position/value"][first:].astype(float) + origin, group["radius"][:],
                    group["release"][:].astype(bool), group["species"][:])

    def test_counts_agree(self):
        model, run, slide = (self.results[tool] for tool in ("tile-trim", "dem-run", "runout-analyse"))
        self.assertGreater(model["particle_count"], 1000)
        self.assertGreater(model["release_count"], 300)
        self.assertEqual(model["particle_count"], run["particle_count"])
        self.assertEqual(run["mobile_count"], model["particle_count"] - model["fixed_count"])
        self.assertEqual(slide["particle_count"], run["particle_count"])
        self.assertEqual(slide["released_count"], model["release_count"])
        self.assertGreater(run["bonds_released"], 0)
        self.assertLess(abs(run["energy_error"]), 0.05)

    def test_what_moves_came_from_the_source(self):
        """Grains that moved were released, or lie under or below the mass that slid over them."""
        position, radius, release, species = self.slide()
        gone = np.linalg.norm(position[-1] - position[0], axis=1)
        self.assertTrue(np.all(gone[species == 1] == 0), "fixed grains stay")
        moved = gone > 2 * radius.max()
        self.assertGreater(np.mean(moved[release]), 0.3, "the released mass slides")
        x, y, _ = position[0].T
        self.assertTrue(np.all(inside(SOURCE, x[release], y[release])))
        share = np.sum(radius[moved & release]**3) / np.sum(radius[moved]**3)
        self.assertGreater(share, 0.5, "most of what moved was released")
        self.assertLess(-np.min(position[-1] - position[0], axis=0)[2], 60, "no grain fell out of the model")
        # Downhill: the centre of mass of the released grains falls, and moves the way the ground falls.
        shift = (position[-1] - position[0])[release].mean(axis=0)
        self.assertLess(shift[2], -1)
        x0, y0 = x[release].mean(), y[release].mean()
        gradient = np.array([elevation_at(PRE, x0 + 20, y0) - elevation_at(PRE, x0 - 20, y0),
                             elevation_at(PRE, x0, y0 + 20) - elevation_at(PRE, x0, y0 - 20)])
        self.assertGreater(shift[:2] @ -gradient, 0)

    def test_travel_distances(self):
        """Eq. 25 of the paper, from the trajectory: the sum of the ways between outputs."""
        position, radius, _, _ = self.slide()
        travel = np.cumsum(np.linalg.norm(np.diff(position, axis=0), axis=2), axis=0)
        got = self.results["runout-analyse"]
        np.testing.assert_allclose(got["max_travel_distance"], [0, *travel.max(axis=1)], rtol=1e-5, atol=1e-3)
        gone = np.linalg.norm(position[-1] - position[0], axis=1)
        self.assertEqual(got["moved_count"], np.sum(gone > got["moved_distance"]))
        solid = np.sum(4 / 3 * np.pi * radius[gone > got["moved_distance"]]**3)
        self.assertAlmostEqual(got["moved_volume"] * got["solid_volume_fraction"] / solid, 1, delta=1e-6)

    def test_volumes_and_areas(self):
        got = self.results["runout-analyse"]
        for key in ("moved_volume", "excavated_volume", "deposited_volume", "affected_area", "runout_length",
                    "drop_height"):
            self.assertGreater(got[key], 0, key)
        self.assertAlmostEqual(got["true_positive_area"] + got["false_negative_area"], 22400, delta=1)
        self.assertAlmostEqual(got["true_positive_area"] + got["false_positive_area"], got["affected_area"], delta=1)
        self.assertGreater(got["true_positive_area"], 0)
        values, lower_left, cell = read_raster(self.made / "map_deposit.asc")
        self.assertEqual((values.shape, cell), ((122, 80), 10))
        np.testing.assert_allclose(lower_left, (361015.59563119, 70223.434086869), atol=1e-3)
        self.assertAlmostEqual(np.nansum(values) * 100 / got["deposited_volume"], 1, delta=1e-3)
        self.assertTrue((self.made / "picture_map.png").stat().st_size > 10000)

    def test_energy(self):
        """Gravity's work goes somewhere: potential energy falls, what is dissipated grows, and the sum is kept."""
        record = datasets(self.made / "slide.traj.h5")
        series = {name: record[f"granular/series/{name}"] for name in
                  ("time", "potential_energy", "kinetic_energy", "dissipated_energy", "total_energy",
                   "supplied_energy")}
        self.assertLess(series["potential_energy"][-1], series["potential_energy"][0])
        self.assertGreater(series["dissipated_energy"][-1], 0)
        released = series["potential_energy"][0] - series["potential_energy"].min()
        drift = np.abs(series["total_energy"] - series["supplied_energy"] - series["total_energy"][0])
        self.assertLess(drift.max(), 0.05 * released + 1e-9)

    def test_provenance(self):
        with h5py.File(self.made / "slide.traj.h5", "r") as file:
            records = [file["granular/provenance"][name] for name in sorted(file["granular/provenance"])]
            self.assertEqual([record.attrs["program"] for record in records], [b"pgbox-gen", b"tile-trim", b"dem-run"])
            self.assertIn("slope.model.h5", records[2]["inputs"][0].decode())

    def test_sidecars(self):
        check_xdmf(self, self.made / "slope.model.xdmf")
        seen, times = check_xdmf(self, self.made / "slide.traj.xdmf")
        self.assertIn("/particles/all/position/value", seen)
        frames = datasets(self.made / "slide.traj.h5")["particles/all/position/time"]
        np.testing.assert_allclose(times, np.unique(frames), rtol=1e-6)

    def test_nothing_unfinished_is_left(self):
        self.assertFalse([name for name in self.files() if name.endswith((".part", ".tmp", ".resume", ".ckpt.h5"))])

    def test_again(self):
        """The same settings give the same bytes, interrupted or not, with one thread or two."""
        folder = pathlib.Path(tempfile.mkdtemp(prefix="talus-test-"))
        self.addCleanup(shutil.rmtree, folder, ignore_errors=True)
        shutil.copy(self.made / "slope.model.h5", folder)
        shutil.copy(self.made / "scene.json", folder)
        self.folder, code = folder, STOPPED
        for _ in range(60):
            got = self.run_tool("dem-run", "slope.model.h5", "-c", "scene.json", "-j", 1, "-o", "slide.traj.h5",
                                "--resume", "auto", "--max-wall", "2s")
            code = got.code
            if code != STOPPED:
                break
        self.assertEqual(code, DONE, str(got))
        first, second = physical(self.made / "slide.traj.h5"), physical(folder / "slide.traj.h5")
        self.assertEqual(sorted(first), sorted(second))
        for name in first:
            self.assertEqual(first[name].tobytes(), second[name].tobytes(), name)

    def test_each_tool_refuses_the_others_files(self):
        for tool, arguments, wrong in (("pgbox-stats", [], "slope.model.h5"),
                                       ("tile-trim", ["--cuboid", "1,1,1", "-o", "x.h5"], "slide.traj.h5"),
                                       ("dem-run", ["--time.end", "1s", "-o", "x.h5"], "box.pgbox.h5"),
                                       ("runout-analyse", [], "slope.model.h5"),
                                       ("triax-fit", [], "slide.traj.h5")):
            with self.subTest(tool):
                self.fails(INPUT, tool, wrong, *arguments, names=wrong)


if __name__ == "__main__":
    main()
