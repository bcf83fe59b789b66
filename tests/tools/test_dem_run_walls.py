# SPDX-License-Identifier: GPL-3.0-or-later
"""dem-run: walls of triangles, what they take, pressure maps, monitored grains."""
import xml.etree.ElementTree

import h5py
import numpy as np

from rank_runs import RankRuns, mpirun
from scenes import MASS, RADIUS, Scenes
from talus_tools import CONFIGURATION, INPUT, STOPPED, main, write_model

BOX_FACES = [[0, 2, 3], [0, 3, 1], [4, 5, 7], [4, 7, 6], [0, 1, 5], [0, 5, 4],
             [2, 6, 7], [2, 7, 3], [0, 4, 6], [0, 6, 2], [1, 3, 7], [1, 7, 5]]


def box_points(lower, upper):
    return np.array([[(lower, upper)[k >> d & 1][d] for d in range(3)] for k in range(8)])


def write_off(path, points, faces):
    path.write_text(f"OFF\n{len(points)} {len(faces)} 0\n" + "".join(f"{x:.17g} {y:.17g} {z:.17g}\n" for x, y, z in points) +
                    "".join(f"{len(f)} " + " ".join(map(str, f)) + "\n" for f in faces))


def write_stl(path, points, faces):
    path.write_text("solid a\n" + "".join(
        " facet normal 0 0 0\n  outer loop\n" + "".join("   vertex {} {} {}\n".format(*points[k]) for k in face) +
        "  endloop\n endfacet\n" for face in faces) + "endsolid a\n")


class Walls(Scenes):
    def bounce(self, wall, *more, **options):
        write_model(self.folder / "one.h5", [[0.1, 0.2, 2 * RADIUS]], [RADIUS], velocity=[[0.5, 0.1, -1]])
        self.write("scene.json", {"material": {"friction": 0.4}, "walls": [wall], "time": {"end": "0.1s"},
                                  "output": {"frame_interval": "1ms", "series_interval": "0.2ms"}})
        return self.scene("one.h5", "-c", "scene.json", *more, **options)

    def test_triangles_are_a_plane(self):
        points = [[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0], [0.11, 0.2, 0]]
        faces = [[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]]
        write_off(self.folder / "sheet.off", points, faces)
        write_stl(self.folder / "sheet.stl", points, faces)
        plane, expected, _ = self.bounce({"name": "floor", "plane": {"point": [0, 0, 0], "normal": [0, 0, 1]}})
        for mesh in ("sheet.off", "sheet.stl"):
            result, values, _ = self.bounce({"name": "floor", "mesh": mesh})
            self.assertLess(abs(values["position"] - expected["position"]).max(), 1e-10 * RADIUS)
            self.assertLess(abs(values["angular_velocity"] - expected["angular_velocity"]).max(), 1e-8)
            for a, b in ((result["walls"][0], plane["walls"][0]),):
                self.assertEqual(a["name"], "floor")
                np.testing.assert_allclose(a["impulse"], b["impulse"], rtol=1e-9)
                self.assertAlmostEqual(a["peak_force"] / b["peak_force"], 1, 9)
                self.assertEqual(a["peak_force_time"], b["peak_force_time"])
                self.assertEqual(a["first_impact_time"], b["first_impact_time"])

    def test_map_in_the_file_and_for_paraview(self):
        write_off(self.folder / "plate.off", [[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], [[0, 1, 2, 3]])
        result, values, times = self.bounce({"name": "plate", "mesh": "plate.off"})
        wall = result["walls"][0]
        speed = values["velocity"]
        gravity = -9.81 * MASS * times[-1]
        lost = MASS * (speed[0, 0] - speed[-1, 0]) + [0, 0, gravity]
        np.testing.assert_allclose(wall["impulse"], lost, rtol=1e-9, atol=1e-12)
        self.assertAlmostEqual(wall["peak_force"], np.linalg.norm(wall["peak_force_vector"]), 9)
        force = self.series("walls/plate/force_z")
        self.assertLessEqual(-force.min(), wall["peak_force"] * (1 + 1e-12))
        fall = (-1 + np.sqrt(1 + 2 * 9.81 * RADIUS)) / 9.81
        self.assertAlmostEqual(wall["first_impact_time"], fall, delta=2 * result["time_step"])
        with h5py.File(self.folder / "run.h5", "r") as file:
            group = file["granular/walls/plate"]
            points, corners = group["points"][:], group["corners"][:]
            self.assertEqual(corners.shape, (2, 3))
            area = np.linalg.norm(np.cross(points[corners[:, 1]] - points[corners[:, 0]],
                                           points[corners[:, 2]] - points[corners[:, 0]]), axis=1) / 2
            np.testing.assert_allclose(group["area"][:], area)
            np.testing.assert_allclose(group["impulse_of_patch"][:].sum(axis=0), wall["impulse"], rtol=1e-12)
            np.testing.assert_allclose(-group["impulse_of_patch"][:, 2], group["normal_impulse"][:], atol=1e-15)
            np.testing.assert_allclose(group["mean_pressure"][:] * area * result["time"], group["normal_impulse"][:],
                                       atol=1e-15)
            self.assertEqual(group["peak_pressure"][:].max(), wall["peak_pressure"])
            self.assertEqual(group["peak_pressure"].attrs["unit"], b"Pa")
            self.assertEqual(group.attrs["peak_force"], wall["peak_force"])
            root = xml.etree.ElementTree.parse(self.folder / "run.walls.xdmf").getroot()
            self.assertEqual(root.find(".//Topology").get("TopologyType"), "Triangle")
            seen = 0
            for item in root.iter("DataItem"):
                name, path = item.text.split(":")
                self.assertEqual(name, "run.h5")
                self.assertEqual(tuple(int(d) for d in item.get("Dimensions").split()), file[path].shape)
                seen += 1
            self.assertEqual(seen, 8)

    def test_cells_of_a_plane(self):
        result, _, _ = self.bounce({"name": "floor", "plane": {"point": [0, 0, 0], "normal": [0, 0, 1]},
                                    "map": {"cell": "10cm", "half_width": "0.5m"}})
        with h5py.File(self.folder / "run.h5", "r") as file:
            group = file["granular/walls/floor"]
            self.assertEqual(group["corners"].shape, (100, 4))
            np.testing.assert_allclose(group["impulse_of_patch"][:].sum(axis=0), result["walls"][0]["impulse"])
            hit = np.flatnonzero(group["normal_impulse"][:])
            first = min(hit, key=lambda k: abs(group["points"][:][group["corners"][k]].mean(axis=0)[0] - 0.1))
            corners = group["points"][:][group["corners"][first]]
            self.assertTrue((corners.min(axis=0)[:2] <= [0.11, 0.21]).all() and (corners.max(axis=0)[:2] >= [0.1, 0.2]).all())
        self.assertIn("Quadrilateral", (self.folder / "run.walls.xdmf").read_text())

    def test_map_coordinates(self):
        """A mesh beside a model with an origin stands where the map says, and is written relative to it."""
        origin = np.array([561000.0, 5120000.0, 300.0])
        write_off(self.folder / "far.off", np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) + origin,
                  [[0, 1, 2, 3]])
        write_model(self.folder / "far.h5", [[0.1, 0.2, 2 * RADIUS]], [RADIUS])
        with h5py.File(self.folder / "far.h5", "a") as file:
            file["particles/all/position"].attrs["origin"] = origin
        result, values, _ = self.scene("far.h5", "--walls.0.mesh", "far.off", "--time.end", "0.1s")
        self.assertGreater(result["walls"][0]["peak_force"], 0)
        self.assertAlmostEqual(values["position"][-1, 0, 2] - origin[2], RADIUS, delta=1e-3)
        with h5py.File(self.folder / "run.h5", "r") as file:
            points = file["granular/walls/wall0/points"][:] + file["particles/all/position"].attrs["origin"]
            np.testing.assert_allclose(points.min(axis=0), origin - [1, 1, 0])

    def test_monitors(self):
        write_model(self.folder / "pile.h5", [[0, 0, 0], [0, 0, 1.9996 * RADIUS]], [RADIUS, RADIUS], species=[1, 0])
        self.scene("pile.h5", "--monitors.0.name", "pile", "--monitors.0.box.lower", "-1,-1,-1",
                   "--monitors.0.box.upper", "1,1,0.001", "--damping.viscous", 300, "--time.end", "0.5s",
                   "--output.series_interval", "10ms")
        self.assertAlmostEqual(self.series("monitors/pile/force_z")[-1] / (-9.81 * MASS), 1, 4)
        with h5py.File(self.folder / "run.h5", "r") as file:
            self.assertEqual(file["granular/series/monitors/pile/torque_x"].attrs["unit"], b"N m")

    def test_what_is_wrong(self):
        write_model(self.folder / "one.h5", [[0, 0, 0.1]], [RADIUS])
        write_off(self.folder / "line.off", [[0, 0, 0], [1, 1, 1], [2, 2, 2]], [[0, 1, 2]])
        write_off(self.folder / "through.off", [[-1, -1, 0.1001], [1, -1, 0.1001], [0, 1, 0.1001]], [[0, 1, 2]])
        self.write("nan.off", "OFF\n3 1 0\n0 0 0\n1 nan 1\n0 1 0\n3 0 1 2\n")
        self.write("text.stl", "no mesh")
        self.write("empty.off", "OFF\n0 0 0\n")
        for mesh, word in (("none.stl", "no such file"), ("line.off", "face 1"), ("nan.off", "nan.off"),
                           ("text.stl", "text.stl"), ("empty.off", "no face"), ("through.off", "particle 0")):
            self.fails(INPUT, "dem-run", "one.h5", "--walls.0.mesh", mesh, "--time.end", "1ms", "-o", "out.h5",
                       names=[word, mesh if mesh != "through.off" else "wall0"])
        for scene, words in (({"walls": [{"mesh": "line.off", "plane": {"normal": [0, 0, 1]}}]}, "/walls/0/mesh"),
                             ({"walls": [{"mesh": "line.off", "map": {"cell": 1}}]}, "/walls/0/map/cell"),
                             ({"walls": [{"map": {"half_width": 1}}]}, "/walls/0/map"),
                             ({"walls": [{"map": {"half_width": 1, "cell": 1e-6}}]}, "/walls/0/map/cell"),
                             ({"walls": [{"name": "a/b"}]}, "/walls/0/name"),
                             ({"monitors": [{"name": "a", "box": {"lower": [0, 0, 0], "upper": [0, 1, 1]}}]}, "box/upper"),
                             ({"monitors": 2 * [{"name": "a", "box": {"lower": [0, 0, 0], "upper": [1, 1, 1]}}]},
                              "two monitors")):
            self.write("scene.json", {"time": {"end": 1}, **scene})
            got = self.run_tool("dem-run", "one.h5", "-c", "scene.json", "-o", "out.h5")
            self.assertEqual(got.code, CONFIGURATION, str(got))
            self.assertIn(words, got.err)
        self.fails(CONFIGURATION, "dem-run", "one.h5", "--monitors.0.box.lower", "0,0,0", "--monitors.0.box.upper",
                   "1,1,1", "--time.end", "1ms", "-o", "out.h5", names="no fixed grain")


class Column(RankRuns):
    """A column of grains falls against a pier: the same at any number of threads and ranks and after a restart."""

    def prepare(self):
        self.ok("pgbox-gen", "--radius", 0.09, "-o", "box.h5")
        self.ok("tile-trim", "box.h5", "--cuboid", "1,1,1.5", "--explicit", "-o", "model.h5")
        write_off(self.folder / "pier.off", box_points([1.05, 0.2, -0.1], [1.4, 0.8, 2]), BOX_FACES)
        hills = [[x, y, -0.05 + 0.03 * np.sin(3 * x) * np.cos(4 * y)] for x in np.linspace(-3, 4, 15)
                 for y in np.linspace(-3, 4, 15)]
        write_off(self.folder / "hills.off", hills, [[15 * i + j, 15 * i + j + 15, 15 * i + j + 16, 15 * i + j + 1]
                                                     for i in range(14) for j in range(14)])
        self.write("scene.json", {
            "material": {"friction": 0.4, "youngs_modulus": "5MPa"}, "gravity": [3, 0, -9.81],
            "walls": [{"name": "pier", "mesh": "pier.off"},
                      {"name": "hills", "mesh": "hills.off", "velocity": [-0.05, 0, 0]}],
            "output": {"frame_interval": "50ms", "series_interval": "10ms"}, "time": {"end": "0.8s", "step": "60us"}})
        self.whole = self.ok("dem-run", *self.arguments("whole.h5")).out

    def arguments(self, output="run.h5", threads=1):
        return ["model.h5", "-c", "scene.json", "-j", threads, "-q", "-o", output]

    def test_threads_and_ranks(self):
        self.ok("dem-run", *self.arguments("two.h5", 2))
        self.assertSamePhysics("two.h5", "whole.h5")
        for ranks in (2, 3):
            self.ok("dem-run", *self.arguments(f"ranks{ranks}.h5"), wrapper=mpirun(ranks))
            self.assertSamePhysics(f"ranks{ranks}.h5", "whole.h5")
        with h5py.File(self.folder / "whole.h5", "r") as file:
            for name in ("pier", "hills"):
                self.assertGreater(file[f"granular/walls/{name}/normal_impulse"][:].sum(), 0)

    def test_restart_on_another_number_of_ranks(self):
        interrupted = 0
        for attempt in range(300):
            got = self.run_tool("dem-run", *self.arguments(), "--max-wall", "0.05s", "--resume", "auto",
                                wrapper=mpirun(1 + attempt % 2))
            if got.code != STOPPED:
                break
            interrupted += 1
        self.assertEqual(got.code, 0, str(got))
        self.assertGreater(interrupted, 0)
        self.assertSamePhysics("run.h5", "whole.h5")

    def test_another_mesh_is_refused(self):
        got = self.run_tool("dem-run", *self.arguments(), "--max-wall", "0.02s")
        self.assertEqual(got.code, STOPPED, str(got))
        write_off(self.folder / "pier.off", box_points([1.05, 0.2, -0.1], [1.4, 0.81, 2]), BOX_FACES)
        self.fails(INPUT, "dem-run", *self.arguments(), "--resume", "auto", names="mesh")


if __name__ == "__main__":
    main()
