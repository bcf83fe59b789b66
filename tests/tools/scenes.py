# SPDX-License-Identifier: GPL-3.0-or-later
"""Runs of dem-run and what comes out of them."""
import h5py
import numpy as np

from talus_tools import ToolTest, physical, write_model

RADIUS, DENSITY = 0.01, 1000.0
MASS = 4 / 3 * np.pi * RADIUS**3 * DENSITY


class Scenes(ToolTest):
    tool = "dem-run"

    def scene(self, model, *arguments, fields="position,velocity,angular_velocity,force", **options):
        """Runs a model and returns the result, the fields at all frames and the times."""
        result = self.ok("dem-run", model, *arguments, "--output.float64", "--output.fields", fields, "-o", "run.h5",
                         "--overwrite", "--format", "json", "-q", **options).json
        with h5py.File(self.folder / "run.h5", "r") as file:
            group = file["particles/all"]
            values = {name: group[name]["value"][:] for name in fields.split(",")}
            for name in values:
                self.assertEqual(values[name].dtype, np.float64)
            values["position"] = values["position"] + group["position"].attrs.get("origin", np.zeros(3))
            return result, values, group["position/time"][:]

    def series(self, name, path="run.h5"):
        with h5py.File(self.folder / path, "r") as file:
            return file[f"granular/series/{name}"][:]

    def pair(self, speed, name="pair.h5", gap=1e-5):
        write_model(self.folder / name, [[0, 0, 0], [2 * RADIUS + gap, 0, 0]], [RADIUS, RADIUS],
                    velocity=[[speed / 2, 0, 0], [-speed / 2, 0, 0]])
        return name

    def assertSamePhysics(self, a, b):
        first, second = physical(self.folder / a), physical(self.folder / b)
        self.assertEqual(sorted(first), sorted(second))
        for name in first:
            self.assertEqual(first[name].shape, second[name].shape, name)
            self.assertEqual(first[name].tobytes(), second[name].tobytes(), name)
