# SPDX-License-Identifier: GPL-3.0-or-later
"""A heap poured through a funnel onto a rough base: its angle of repose and runout, for the benchmark of sleep.

The funnel's plates and the base are fixed grains; the scene is periodic in y. Grains run out of the funnel, heap up under it and
come to rest: what sleeps too early stands too steep, what never wakes carries what should slide.
"""
import math

import numpy as np

from accuracy_run import Model

RADIUS = 0.01  # m, of the largest grains; the smallest have 0.82 of it
DIAMETER = 2 * RADIUS
DEPTH = 6 * DIAMETER      # m, in y
SLOT = 6 * DIAMETER       # m, width of the funnel's outlet
STEEP = math.radians(60)  # of the funnel's plates
BULK = 0.6                # solid fraction expected in the heap
EXPECTED = math.radians(22)
MATERIAL = {"density": 2400.0, "youngs_modulus": 2e6, "poissons_ratio": 0.2, "restitution": 0.2, "friction": 0.5}


def sizes_of(count):
    """(half width, height) of the heap that `count` grains are expected to make, m."""
    area = count * math.pi / 6 * (0.91 * DIAMETER)**3 / (BULK * DEPTH)
    half = math.sqrt(area / math.tan(EXPECTED))
    return half, half * math.tan(EXPECTED)


def pour(count, seed):
    """The model: `count` grains loose in a funnel above the base, jittered and of random size by the seed."""
    draw = np.random.default_rng(seed)
    half, height = sizes_of(count)
    outlet = height + 5 * DIAMETER
    spacing = 1.1 * DIAMETER
    layers, z = [], outlet + spacing
    while sum(len(layer) for layer in layers) < count:
        inner = SLOT / 2 + (z - outlet) / math.tan(STEEP) - 2 * DIAMETER
        across, along = max(int(2 * inner / spacing), 1), int(DEPTH / spacing)
        x, y = np.meshgrid((np.arange(across) - (across - 1) / 2) * spacing, (np.arange(along) + 0.5) * DEPTH / along)
        layers.append(np.stack([x.ravel(), y.ravel(), np.full(x.size, z)], axis=1))
        z += spacing
    grains = np.concatenate(layers)[:count]
    grains += draw.uniform(-0.04, 0.04, grains.shape) * DIAMETER
    radius = draw.uniform(0.82 * RADIUS, RADIUS, count)

    rows = (np.arange(round(DEPTH / DIAMETER)) + 0.5) * DIAMETER
    up = np.arange(0, (z - outlet) / math.sin(STEEP) + 4 * DIAMETER, DIAMETER)
    plates = [(side * (SLOT / 2 + u * math.cos(STEEP)), y, outlet + u * math.sin(STEEP))
              for side in (-1, 1) for u in up for y in rows]
    reach = math.ceil((1.8 * half + 10 * DIAMETER) / DIAMETER)
    base = np.array([((k + 0.5) * DIAMETER, y, 0) for k in range(-reach, reach) for y in rows])
    base[:, 2] = np.random.default_rng(1).uniform(-1.3 * RADIUS, -0.7 * RADIUS, len(base))  # the same for all seeds
    fixed = np.concatenate([np.array(plates), base])
    position = np.concatenate([grains, fixed])
    return Model(position, np.concatenate([radius, np.full(len(fixed), RADIUS)]), np.zeros(position.shape),
                 species=np.repeat([0, 1], [count, len(fixed)]).astype(np.uint8))


def scene_of(model, duration):
    """Without walls but for a floor far below, which catches what rolls off the base."""
    low, high = model.position.min(axis=0), model.position.max(axis=0)
    return {"gravity": [0, 0, -9.81], "material": MATERIAL, "time": {"end": duration},
            "box": {"lower": [2 * low[0], 0, low[2] - 4 * RADIUS], "upper": [2 * high[0], DEPTH, high[2] + 4 * RADIUS],
                    "periodic": [False, True, False]},
            "walls": [{"name": "floor", "plane": {"point": [0, 0, low[2] - 3 * RADIUS], "normal": [0, 0, 1]}}],
            "output": {"fields": ["position", "velocity"], "float64": True}}


def duration_of(count):
    """s: twice what the funnel takes to empty and the last grains to fall: about half the run is rest. The outflow through a
    slot is about sqrt(g) (width - 1.5 d)^1.5 a unit of depth (Beverloo's rule in two dimensions, coefficient 1)."""
    area = count * math.pi / 6 * (0.91 * DIAMETER)**3 / (0.5 * DEPTH)
    return 2 * (area / (math.sqrt(9.81) * (SLOT - 1.5 * DIAMETER)**1.5) + 0.5)


def profile(position, radius, depth=DEPTH, cell=2 * DIAMETER):
    """Surface of the heap along x: (x, height), m, height the mean over y of the highest point in square cells. A cell
    boundary lies at x = 0."""
    columns = max(1, round(depth / cell))
    k = np.floor(position[:, 0] / cell).astype(int)
    j = np.clip((np.mod(position[:, 1], depth) / depth * columns).astype(int), 0, columns - 1)
    first = k.min()
    top = np.zeros((k.max() - first + 1, columns))  # an empty cell shows the base
    np.maximum.at(top, (k - first, j), position[:, 2] + radius)
    return (np.arange(len(top)) + first + 0.5) * cell, top.mean(axis=1)


def flank(x, height, low=0.2, high=0.8):
    """Slope angle (degrees) of one flank, x outwards from the middle: the best line through the bins from where the surface
    falls below `high` of the heap's height to where it falls below `low` of it. None where these are fewer than three."""
    top = np.convolve(height, np.full(3, 1 / 3), "valid").max() if len(height) > 2 else height.max()
    start = int(np.argmax(height < high * top))
    below = np.flatnonzero(height[start:] < low * top)
    end = start + (int(below[0]) if len(below) else len(height) - start)
    if end - start < 3:
        return None
    return math.degrees(math.atan(-np.polyfit(x[start:end], height[start:end], 1)[0]))


def measure(position, radius, outlet):
    """Angle of the heap (degrees, mean of both flanks), its height and runout in diameters. Runout: from the middle, within
    which 99 % of the grains lie that left the funnel."""
    out = position[:, 2] < outlet - DIAMETER
    position, radius = position[out], radius[out]
    x, height = profile(position, radius)
    sides = [flank(x[x > 0], height[x > 0]), flank(-x[x < 0][::-1], height[x < 0][::-1])]
    if None in sides:
        raise RuntimeError("the heap is too small for a slope: take more grains")
    return {"angle": sum(sides) / 2, "runout": float(np.quantile(np.abs(position[:, 0]), 0.99) / DIAMETER),
            "height": float(height.max() / DIAMETER), "left_in_funnel": int(np.sum(~out))}


def outlet_of(count):
    return sizes_of(count)[1] + 5 * DIAMETER


class Heap:
    """What sleep_repose.py asks of a scene."""
    name, title = "heap", "Angle of repose of a poured heap"
    quantities = {"angle": "degrees", "runout": "d"}
    text = "run through a funnel onto a rough base and come to rest"

    def __init__(self, count):
        self.count = count

    def start(self, seed, _programs):
        """The model of that seed and the scene."""
        model = pour(self.count, seed)
        return model, scene_of(model, duration_of(self.count))

    def measure(self, position, radius):
        return measure(position, radius, outlet_of(self.count))
