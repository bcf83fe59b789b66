# SPDX-License-Identifier: GPL-3.0-or-later
"""dem-run: textbook cases with closed forms, set up in a few lines of h5py."""
import h5py
import numpy as np

from scenes import MASS, RADIUS, Scenes
from talus_tools import copy_with, datasets, main, write_model


class TextbookCases(Scenes):
    def test_free_fall(self):
        """Velocity Verlet is exact under constant acceleration."""
        write_model(self.folder / "one.h5", [[1, 2, 3]], [RADIUS], velocity=[[0.5, -1, 4]])
        result, value, t = self.scene("one.h5", "--time.end", "0.8s", "--output.frame-interval", "50ms")
        self.assertEqual(result["particle_count"], 1)
        self.assertGreaterEqual(len(t), 17)
        self.assertAlmostEqual(t[-1], 0.8, delta=result["time_step"])
        expected = [1, 2, 3] + np.outer(t, [0.5, -1, 4]) + np.outer(t**2 / 2, [0, 0, -9.81])
        np.testing.assert_allclose(value["position"][:, 0], expected, atol=1e-10)
        np.testing.assert_allclose(value["velocity"][:, 0], [0.5, -1, 4] + np.outer(t, [0, 0, -9.81]), atol=1e-10)
        np.testing.assert_allclose(value["force"][:, 0], np.tile([0, 0, -MASS * 9.81], (len(t), 1)), atol=1e-12)
        self.assertLess(abs(result["energy_error"]), 1e-9)

    def test_hertz_impact(self):
        """Hertz 1881, two equal spheres at a relative speed of 0.1 m/s, undamped: contact time 2.9432752 delta/v,
        greatest overlap and force (reference case c01)."""
        gap = 1e-6
        result, value, t = self.scene(self.pair(0.1, gap=gap), "--gravity", "0,0,0", "--material.restitution", 1,
                                      "--time.step", "1us", "--time.end", "1.2ms", "--output.frame-interval", "1us")
        overlap = 2 * RADIUS - (value["position"][:, 1, 0] - value["position"][:, 0, 0])
        self.assertAlmostEqual(overlap.max() / 3.095554e-5, 1, delta=1e-3)
        force = value["force"]
        np.testing.assert_allclose(force[:, 0], -force[:, 1], atol=1e-15)
        self.assertAlmostEqual(-force[:, 0, 0].min() / 0.845727, 1, delta=1e-3)
        touching = t[overlap > 0]
        self.assertAlmostEqual((touching[-1] - touching[0]) / 0.0009111069, 1, delta=5e-3)
        self.assertAlmostEqual(value["velocity"][-1, 1, 0], 0.05, delta=5e-5)
        self.assertLess(abs(result["energy_error"]), 1e-4)

    def test_restitution(self):
        """The damping maps exactly on a linear oscillator: rebound is known in closed form and does not depend on
        speed (reference case c02). The nominal value is not what comes out, except with damping exact."""
        cases = [(0.2, [], 0.2083949), (0.5, [], 0.4868624), (0.9, [], 0.8796255),
                 (0.2, ["--contact.separation", "no-tension"], 0.3308688),
                 (0.5, ["--contact.separation", "no-tension"], 0.5397921),
                 (0.2, ["--contact.damping", "exact"], 0.2), (0.8, ["--contact.damping", "exact"], 0.8)]
        for nominal, arguments, expected in cases:
            for speed in (0.01, 1):
                with self.subTest(nominal=nominal, arguments=arguments, speed=speed):
                    _, value, _ = self.scene(self.pair(speed), "--gravity", "0,0,0", "--material.restitution", nominal,
                                             "--time.step", "0.5us", "--time.end", f"{1.2e-5 / speed + 0.004}s",
                                             *arguments)
                    after = value["velocity"][-1, 1, 0] - value["velocity"][-1, 0, 0]
                    self.assertAlmostEqual(after / speed, expected, delta=1e-3)

    def test_sphere_that_slides_then_rolls(self):
        """5/7 of the speed is left when rolling begins, at 2 v / (7 mu g) (reference case c13)."""
        self.write("floor.json", {"material": {"friction": 0.4},
                                  "walls": [{"name": "floor", "plane": {"point": [0, 0, 0], "normal": [0, 0, 1]},
                                             "material": {"friction": 0.2}}],
                                  "stress_free_start": False})
        rest = 1.2e-6  # overlap under its weight: (3 m g / (4 E* sqrt(r)))^(2/3)
        effective = 1e8 / (2 * (1 - 0.04))
        rest = (3 * MASS * 9.81 / (4 * effective * np.sqrt(RADIUS)))**(2 / 3)
        write_model(self.folder / "ball.h5", [[0, 0, RADIUS - rest]], [RADIUS], velocity=[[0.5, 0, 0]])
        result, value, t = self.scene("ball.h5", "-c", "floor.json", "--time.end", "0.15s",
                                      "--output.frame-interval", "5ms")
        begins = 2 * 0.5 / (7 * 0.2 * 9.81)
        sliding = t < begins - 0.003
        np.testing.assert_allclose(value["velocity"][sliding, 0, 0], 0.5 - 0.2 * 9.81 * t[sliding], rtol=5e-3)
        rolling = t > begins + 0.005
        np.testing.assert_allclose(value["velocity"][rolling, 0, 0], 0.5 * 5 / 7, rtol=3e-3)
        np.testing.assert_allclose(value["angular_velocity"][rolling, 0, 1] * RADIUS, 0.5 * 5 / 7, rtol=3e-3)
        # The wall carries the weight, and the friction while it slides.
        force = self.series("walls/floor/force_z")
        self.assertAlmostEqual(abs(force[-1]) / (MASS * 9.81), 1, delta=0.01)
        self.assertLess(abs(result["energy_error"]), 1e-3)

    def test_bonded_pair_is_pulled_apart(self):
        """Breaks when the pull reaches twice P_b pi (2 ri rj / (ri + rj))^2: tension, one record, mode 0."""
        write_model(self.folder / "pair.h5", [[0, 0, 0], [2 * RADIUS, 0, 0]], [RADIUS, RADIUS], species=[1, 0],
                    velocity=[[0, 0, 0], [0.002, 0, 0]])
        arguments = ["--gravity", "0,0,0", "--stress-free-start", "--material.restitution", 1, "--time.step", "1us"]
        pressure = 20.0
        capacity = pressure * np.pi * RADIUS**2
        stiffness = 2 * 1e8 / (3 * (1 - 0.04)) * np.sqrt(RADIUS / 2)
        speed = np.sqrt(2 / MASS * 0.4 * stiffness * (capacity / stiffness)**(5 / 3))  # carried exactly to capacity
        for factor, broken in ((0.8, 0), (4, 1)):
            with self.subTest(factor):
                copy_with(self.folder / "pair.h5", self.folder / "pull.h5",
                          lambda file: file["particles/all/velocity"].__setitem__((1, 0), factor * speed))
                result, value, _ = self.scene("pull.h5", *arguments, "--bond.bond-pressure", pressure,
                                              "--bond.bond-friction", 10, "--time.end", "20ms",
                                              "--output.frame-interval", "10us")
                self.assertEqual(result["bonds_broken"], broken)
                self.assertEqual(result["bonds"], 1 - broken)
                record = datasets(self.folder / "run.h5")
                self.assertEqual(len(record["granular/bond_breakages/step"]), broken)
                pull = -value["force"][:, 1, 0].min()
                if broken:
                    self.assertEqual(list(record["granular/bond_breakages/pair"][0]), [0, 1])
                    self.assertEqual(record["granular/bond_breakages/mode"][0], 0)
                    self.assertAlmostEqual(pull / capacity, 1, delta=0.02)
                    np.testing.assert_array_equal(value["force"][-1, 1], 0)
                else:
                    self.assertLess(pull, capacity)

    def test_periodic_sides(self):
        """Two grains that meet through a periodic face, and never would without."""
        write_model(self.folder / "pair.h5", [[0.05, 0.05, 0.05], [0.95, 0.05, 0.05]], [RADIUS, RADIUS],
                    velocity=[[-0.5, 0, 0], [0.5, 0, 0]])
        arguments = ["--gravity", "0,0,0", "--material.restitution", 1, "--time.end", "0.2s", "--box.lower", "0,0,0",
                     "--box.upper", "1,0.1,0.1", "--time.step", "10us"]
        _, value, _ = self.scene("pair.h5", *arguments, "--box.periodic", "true,true,false")
        np.testing.assert_allclose(value["velocity"][-1, :, 0], [0.5, -0.5], atol=2e-3)
        _, value, _ = self.scene("pair.h5", *arguments, "--box.periodic", "false,true,false")
        np.testing.assert_allclose(value["velocity"][-1, :, 0], [-0.5, 0.5], atol=1e-12)

    def test_fixed_grains_stay(self):
        write_model(self.folder / "pair.h5", [[0, 0, 0], [0, 0, 0.03]], [RADIUS, RADIUS], species=[1, 0])
        result, value, _ = self.scene("pair.h5", "--time.end", "0.1s")
        self.assertEqual(result["mobile_count"], 1)
        np.testing.assert_array_equal(value["position"][-1, 0], [0, 0, 0])
        self.assertLess(value["position"][-1, 1, 2], 0.03)

    def test_other_forms_of_the_smallest_model(self):
        """Position as {step, time, value}, single precision, a mass of its own."""
        with h5py.File(self.folder / "one.h5", "w") as file:
            granular = file.create_group("granular")
            granular.attrs["kind"] = "model"
            granular.attrs["complete"] = np.int32(1)
            file["particles/all/position/step"] = np.array([0])
            file["particles/all/position/time"] = np.array([0.0])
            file["particles/all/position/value"] = np.zeros((1, 1, 3), dtype="f4")
            file["particles/all/radius"] = np.array([RADIUS], dtype="f4")
            file["particles/all/mass"] = np.array([3.0])
        _, value, t = self.scene("one.h5", "--time.end", "0.1s")
        np.testing.assert_allclose(value["position"][-1, 0, 2], -9.81 / 2 * t[-1]**2, rtol=1e-9)
        np.testing.assert_allclose(value["force"][-1, 0, 2], -3 * 9.81, rtol=1e-9)


if __name__ == "__main__":
    main()
