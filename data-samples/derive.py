#!/usr/bin/env python3
# SPDX-License-Identifier: GPL-3.0-or-later
"""Makes the derived files of st-helens-2021/ from the source's grids; run it in this folder, it needs only
Python's standard library and gives the same bytes every time.

  post_runout_DEM.asc    elevation before + measured change; where no change was measured: elevation before
  source_area.geojson    outline of the cells of the mapped source area
  runout_footprint.geojson  outline of the cells where a change was measured
  corridor.geojson       the footprint's cells and all within 40 m of them: a domain for the slide
  *.prj                  EPSG:32149, which the source's documentation states and the grids do not carry
"""
import json
import pathlib

FOLDER = pathlib.Path(__file__).parent / "st-helens-2021"
WKT = (
    'PROJCS["NAD_1983_StatePlane_Washington_South_FIPS_4602",GEOGCS["GCS_North_American_1983",'
    'DATUM["D_North_American_1983",SPHEROID["GRS_1980",6378137.0,298.257222101]],PRIMEM["Greenwich",0.0],'
    'UNIT["Degree",0.0174532925199433]],PROJECTION["Lambert_Conformal_Conic"],PARAMETER["False_Easting",500000.0],'
    'PARAMETER["False_Northing",0.0],PARAMETER["Central_Meridian",-120.5],'
    'PARAMETER["Standard_Parallel_1",47.3333333333333],PARAMETER["Standard_Parallel_2",45.8333333333333],'
    'PARAMETER["Latitude_Of_Origin",45.3333333333333],UNIT["Meter",1.0]]'
)
SYSTEM = {"type": "name", "properties": {"name": "urn:ogc:def:crs:EPSG::32149"}}
HEADER_LINES = 6


def read(name):
    """Header lines and rows (north first) of number strings, so that digits survive untouched."""
    lines = (FOLDER / name).read_text().splitlines()
    header = {key.lower(): value for key, value in (line.split() for line in lines[:HEADER_LINES])}
    return lines[:HEADER_LINES], header, [line.split() for line in lines[HEADER_LINES:] if line.strip()]


def rings_of(cells):
    """Closed rings around a set of (column, row from the south) cells, by following cell edges with the inside on
    the left: outer rings run anticlockwise, holes clockwise. Cells that meet in a corner only get rings of their own."""
    step = {}
    for column, row in cells:
        edges = (((0, -1), (0, 0), (1, 0)), ((1, 0), (1, 0), (1, 1)), ((0, 1), (1, 1), (0, 1)), ((-1, 0), (0, 1), (0, 0)))
        for (across, up), start, end in edges:
            if (column + across, row + up) not in cells:
                a, b = (column + start[0], row + start[1]), (column + end[0], row + end[1])
                step.setdefault(a, []).append(b)
    rings = []
    while step:
        first = min(step)
        ring = [first]
        while True:
            here = ring[-1]
            choices = step[here]
            if len(choices) > 1 and len(ring) > 1:  # two corners touch: turn left, staying with the same cell
                before = ring[-2]
                inward = (here[0] - before[0], here[1] - before[1])
                left = (here[0] - inward[1], here[1] + inward[0])
                there = left if left in choices else choices[0]
            else:
                there = choices[0]
            choices.remove(there)
            if not choices:
                del step[here]
            if there == first:
                break
            ring.append(there)
        corners = [
            p
            for k, p in enumerate(ring)
            if (p[0] - ring[k - 1][0]) * (ring[(k + 1) % len(ring)][1] - p[1])
            != (p[1] - ring[k - 1][1]) * (ring[(k + 1) % len(ring)][0] - p[0])
        ]
        rings.append(corners)
    return rings


def area(ring):
    return sum(a[0] * b[1] - b[0] * a[1] for a, b in zip(ring, ring[1:] + ring[:1])) / 2


def contains(ring, x, y):
    inside = False
    for a, b in zip(ring, ring[1:] + ring[:1]):
        if (a[1] > y) != (b[1] > y) and x < a[0] + (y - a[1]) / (b[1] - a[1]) * (b[0] - a[0]):
            inside = not inside
    return inside


def write_outline(name, cells, header, what):
    x0, y0, edge = float(header["xllcorner"]), float(header["yllcorner"]), float(header["cellsize"])
    rings = rings_of(cells)
    outer = [ring for ring in rings if area(ring) > 0]
    holes = [ring for ring in rings if area(ring) < 0]
    polygons = []
    for ring in outer:
        inner = [h for h in holes if contains(ring, h[0][0] + 1e-3, h[0][1] + 1e-3) or contains(ring, h[0][0] - 1e-3, h[0][1] - 1e-3)]
        polygons.append([[[round(x0 + c * edge, 6), round(y0 + r * edge, 6)] for c, r in loop + loop[:1]] for loop in [ring] + inner])
    document = {
        "type": "FeatureCollection",
        "name": name.removesuffix(".geojson"),
        "crs": SYSTEM,
        "features": [
            {
                "type": "Feature",
                "properties": {"what": what, "cells": len(cells), "area_m2": len(cells) * edge * edge},
                "geometry": {"type": "MultiPolygon", "coordinates": polygons},
            }
        ],
    }
    (FOLDER / name).write_text(json.dumps(document, indent=1) + "\n")


def main():
    lines, header, before = read("pre_runout_DEM.asc")
    _, change_header, change = read("DEM_of_Difference.asc")
    _, source_header, source = read("landslide_polygon.asc")
    no_data = float(header["nodata_value"])
    height = len(before)

    after = []
    for row_before, row_change in zip(before, change):
        row = []
        for elevation, difference in zip(row_before, row_change):
            measured = float(difference) != float(change_header["nodata_value"])
            known = float(elevation) != no_data
            row.append(f"{float(elevation) + float(difference):.6f}" if measured and known else elevation)
        after.append(" ".join(row))
    (FOLDER / "post_runout_DEM.asc").write_text("\n".join(lines + after) + "\n")

    def cells(rows, head):
        blank = float(head["nodata_value"])
        return {(c, height - 1 - r) for r, row in enumerate(rows) for c, value in enumerate(row) if float(value) != blank}

    footprint = cells(change, change_header)
    write_outline("source_area.geojson", cells(source, source_header), header, "mapped source area")
    write_outline("runout_footprint.geojson", footprint, header, "cells with a measured change of elevation")
    reach = 4
    near = {(c + i, r + j) for c, r in footprint for i in range(-reach, reach + 1) for j in range(-reach, reach + 1)
            if i * i + j * j <= reach * reach}
    write_outline("corridor.geojson", near, header, "cells within 40 m of the runout footprint")
    for name in ("pre_runout_DEM", "post_runout_DEM", "DEM_of_Difference", "landslide_polygon"):
        (FOLDER / f"{name}.prj").write_text(WKT + "\n")


if __name__ == "__main__":
    main()
