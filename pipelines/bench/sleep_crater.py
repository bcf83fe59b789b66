# SPDX-License-Identifier: GPL-3.0-or-later
"""A bed at rest that drains through a slot beside a wall, for the benchmark of sleep.

What rests far from the slot falls asleep and has to wake when the crater comes: where it sleeps on, the flank that is left stands
too steep and too much stays. Base, walls and the pit's ground are fixed grains; the scene is periodic in y.
"""
import math

import numpy as np

from accuracy_run import Model, merged
from sleep_heap import BULK, DEPTH, DIAMETER, MATERIAL, RADIUS, flank, profile
from sleep_run import last_frame

SLOT = 6 * DIAMETER   # m
DROP = 25 * DIAMETER  # m, from the base to the pit's ground
SETTLING = 1.2        # s, before the slot opens
SLENDER = 3.2         # length of the bed over its height


def size_of(count):
    """(length, height) of a bed of `count` grains, m; the length in whole diameters."""
    area = count * math.pi / 6 * (0.91 * DIAMETER)**3 / (BULK * DEPTH)
    length = math.ceil(math.sqrt(SLENDER * area) / DIAMETER) * DIAMETER
    return length, area / length


def fixed_grains(count):
    """(position, is part of the gate): base with the gate in it, walls at both ends, the pit's ground."""
    length, height = size_of(count)
    rows = (np.arange(round(DEPTH / DIAMETER)) + 0.5) * DIAMETER

    def line(points):
        return np.array([(x, y, z) for x, z in points for y in rows])

    base = line([(x, -RADIUS) for x in np.arange(RADIUS, length, DIAMETER)])
    walls = line([(x, z) for x in (-RADIUS, length + RADIUS) for z in np.arange(-RADIUS, 2.2 * height, DIAMETER)])
    ground = line([(x, -DROP) for x in np.arange(-1.5 * length, 1.5 * length, DIAMETER)])
    for part, seed in ((base, 1), (ground, 2)):
        part[:, 2] += np.random.default_rng(seed).uniform(-0.3 * RADIUS, 0.3 * RADIUS, len(part))  # the same for all seeds
    gate = np.concatenate([base[:, 0] < SLOT, np.zeros(len(walls) + len(ground), bool)])
    return np.concatenate([base, walls, ground]), gate


def model_of(grains, radius, fixed):
    position = np.concatenate([grains, fixed])
    return Model(position, np.concatenate([radius, np.full(len(fixed), RADIUS)]), np.zeros(position.shape),
                 species=np.repeat([0, 1], [len(grains), len(fixed)]).astype(np.uint8))


class Crater:
    """What sleep_repose.py asks of a scene."""
    name, title = "crater", "Angle of repose of a crater"
    quantities = {"angle": "degrees", "left": "% of the grains"}
    text = "rest in a bed, a part drains through a slot, the flank of what is left comes to rest"

    def __init__(self, count):
        self.count = count
        self.length, self.height = size_of(count)
        self.duration = 4 + 10 * self.length * self.height  # s (lengths in m): a good third of it is rest

    def scene(self, duration):
        return {"gravity": [0, 0, -9.81], "material": MATERIAL, "time": {"end": duration},
                "box": {"lower": [-3 * self.length, 0, -DROP - 1], "upper": [3 * self.length, DEPTH, 4 * self.height],
                        "periodic": [False, True, False]},
                "walls": [{"name": "floor", "plane": {"point": [0, 0, -DROP - 3 * RADIUS], "normal": [0, 0, 1]}}],
                "output": {"fields": ["position", "velocity"], "float64": True}}

    def start(self, seed, programs):
        """The bed of that seed, settled behind the closed gate and without it, and the scene."""
        draw = np.random.default_rng(seed)
        spacing = 1.1 * DIAMETER
        across, along = int(self.length / spacing), int(DEPTH / spacing)
        k = np.arange(self.count)
        grains = np.stack([(k % across + 0.5) * self.length / across, (k // across % along + 0.5) * DEPTH / along,
                           (k // (across * along) + 0.7) * spacing], axis=1)
        grains += draw.uniform(-0.04, 0.04, grains.shape) * DIAMETER
        radius = draw.uniform(0.82 * RADIUS, RADIUS, self.count)
        fixed, gate = fixed_grains(self.count)
        path = programs.scratch / "bed.model.h5"
        model_of(grains, radius, fixed).write(path)
        settled = programs.dem_run(path, merged(self.scene(SETTLING), {"damping": {"viscous": 5}}), 0)
        grains = last_frame(settled["trajectory"])[:self.count]
        return model_of(grains, radius, fixed[~gate]), self.scene(self.duration)

    def measure(self, position, radius):
        """Slope of the crater's flank (degrees) and what is left above the base (%)."""
        above = position[:, 2] > -RADIUS
        x, height = profile(position[above], radius[above])
        inside = (x > 0) & (x < self.length)
        angle = flank(self.length - x[inside][::-1], height[inside][::-1])
        if angle is None:
            raise RuntimeError("the bed is too small for a crater: take more grains")
        return {"angle": angle, "left": 100 * float(above.mean())}
