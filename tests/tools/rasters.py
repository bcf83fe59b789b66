# SPDX-License-Identifier: GPL-3.0-or-later
"""Small rasters and outlines: written, read and looked up without GDAL."""
import json

import numpy as np


def write_raster(path, values, lower_left=(0, 0), cell=10, no_data=-9999):
    """An ESRI ASCII grid; the first row of `values` is the northernmost."""
    values = np.asarray(values)
    head = (f"ncols {values.shape[1]}\nnrows {values.shape[0]}\nxllcorner {lower_left[0]}\n"
            f"yllcorner {lower_left[1]}\ncellsize {cell}\nNODATA_value {no_data}\n")
    path.write_text(head + "\n".join(" ".join(f"{v:.10g}" for v in row) for row in values) + "\n")
    return path.name


def read_raster(path):
    """Values (no data as NaN, north first), lower left corner and cell of an ESRI ASCII grid."""
    lines = path.read_text().split("\n")
    head = {}
    while lines and lines[0].split() and lines[0].split()[0][0].isalpha() and lines[0].split()[0] != "nan":
        key, value = lines.pop(0).split()
        head[key.lower()] = float(value)
    values = np.array(" ".join(lines).split(), dtype=float).reshape(int(head["nrows"]), int(head["ncols"]))
    values[values == head.get("nodata_value", -9999)] = np.nan
    cell = head["cellsize"] if "cellsize" in head else head["dx"]
    return values, (head["xllcorner"], head["yllcorner"]), cell


def elevation_at(path, x, y):
    """Bilinear between cell centres, as the tools take elevations."""
    values, (left, lower), cell = read_raster(path)
    column = (np.asarray(x) - left) / cell - 0.5
    row = values.shape[0] - 0.5 - (np.asarray(y) - lower) / cell
    c, r = np.floor(column).astype(int), np.floor(row).astype(int)
    u, v = column - c, row - r
    return ((1 - v) * ((1 - u) * values[r, c] + u * values[r, c + 1]) +
            v * ((1 - u) * values[r + 1, c] + u * values[r + 1, c + 1]))


def rings(path):
    """Outer and inner rings of a GeoJSON file's polygons, as arrays of corners."""
    for feature in json.loads(path.read_text())["features"]:
        geometry = feature["geometry"]
        polygons = [geometry["coordinates"]] if geometry["type"] == "Polygon" else geometry["coordinates"]
        for polygon in polygons:
            for ring in polygon:
                yield np.array(ring)[:, :2]


def inside(path, x, y):
    """Whether points lie inside the polygons of a GeoJSON file (even-odd)."""
    x, y = np.asarray(x), np.asarray(y)
    odd = np.zeros(x.shape, dtype=bool)
    for ring in rings(path):
        for (x0, y0), (x1, y1) in zip(ring[:-1], ring[1:]):
            if y0 != y1:
                odd ^= ((y0 > y) != (y1 > y)) & (x < x0 + (y - y0) / (y1 - y0) * (x1 - x0))
    return odd
