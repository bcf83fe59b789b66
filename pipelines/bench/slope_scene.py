# SPDX-License-Identifier: GPL-3.0-or-later
"""A synthetic slope of the published size: 800 m long, 500 m wide, 600 m of relief, with a bowl-shaped source."""
import math
import pathlib

import numpy as np

LENGTH, WIDTH, RELIEF = 800.0, 500.0, 600.0  # m
SOURCE_CENTRE = (370.0, 250.0)               # m
SOURCE_AXES = (352.5, 97.5)                  # m, half axes: 705 m by 195 m
SOURCE_DEPTH = 31.0                          # m, at the centre, vertically: 1.67 million m3


def surfaces(length=LENGTH, width=WIDTH, relief=RELIEF, cell=2.0):
    """Elevations (m) before and after the event at cell centres, north first; the slope falls towards +x, steepest in
    the middle, with a ripple across. The source is an elliptical bowl of SOURCE_DEPTH, scaled with the slope."""
    x = -cell / 2 + cell * np.arange(round(length / cell) + 2)
    y = -cell / 2 + cell * np.arange(round(width / cell) + 2)
    x, y = np.meshgrid(x / length, y[::-1] / width)
    pre = relief * (0.5 + 0.5 * np.cos(math.pi * np.clip(x, 0, 1)) * 0.6 + 0.2 * (1 - 2 * x))
    pre += 0.01 * relief * np.sin(6 * math.pi * y) * np.sin(4 * math.pi * x)
    inside = ((x - SOURCE_CENTRE[0] / LENGTH) / (SOURCE_AXES[0] / LENGTH))**2 + \
        ((y - SOURCE_CENTRE[1] / WIDTH) / (SOURCE_AXES[1] / WIDTH))**2
    return pre, pre - SOURCE_DEPTH * (length / LENGTH) * np.clip(1 - inside, 0, None)


def write_raster(path: pathlib.Path, values, cell):
    """An ESRI ASCII grid whose first cell centre lies half a cell outside the slope's corner."""
    head = (f"ncols {values.shape[1]}\nnrows {values.shape[0]}\nxllcorner {-cell:.10g}\nyllcorner {-cell:.10g}\n"
            f"cellsize {cell:.10g}\nNODATA_value -9999\n")
    path.write_text(head + "\n".join(" ".join(f"{v:.6f}" for v in row) for row in values) + "\n")
