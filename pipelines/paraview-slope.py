# SPDX-License-Identifier: GPL-3.0-or-later
"""A model or trajectory of a slope in ParaView, in a batch:

    pvbatch pipelines/paraview-slope.py slide.traj.xdmf slide.png [travel|release|radius]
    xvfb-run -a pvbatch ...     # without a display (Debian: paraview, python3-paraview, xvfb, xauth)

Takes the .xdmf beside the HDF5 file (ParaView's "XDMF Reader", which shows our time series) and draws spheres as point
gaussians, from the valley side, every frame of a trajectory as slide.0000.png and so on. Needs ParaView 5.9 or later; it draws
every grain, so for models of more than some ten million use slope-picture. A tiled model shows its tiles, as balls.
"""
import os
import pathlib
import sys

import numpy as np
from paraview import simple
from vtkmodules.numpy_interface import dataset_adapter


def tile_edge(reader):
    """Tiles stand on a lattice: the least distance between two of their planes across x."""
    points = dataset_adapter.WrapDataObject(reader.GetClientSideObject().GetOutput()).Points
    steps = np.diff(np.unique(np.round(np.asarray(points)[:, 0], 3)))
    return steps.min() if len(steps) else 1.0


def main():
    if len(sys.argv) < 3:
        sys.exit(__doc__)
    source, output = pathlib.Path(sys.argv[1]), pathlib.Path(sys.argv[2])
    if not source.exists():
        sys.exit(f"paraview-slope: error: {source}: no such file")
    if not os.environ.get("DISPLAY"):
        sys.stderr.write("paraview-slope: no DISPLAY: should ParaView stop now, start it with `xvfb-run -a`\n")
    reader = simple.XDMFReader(FileNames=[str(source)])
    reader.UpdatePipeline()
    names = list(reader.PointData.keys())
    colour = next((name for name in [*sys.argv[3:4], "travel", "release", "kept"] if name in names), None)
    view = simple.CreateView("RenderView")
    view.ViewSize = [1600, 1200]
    if hasattr(view, "UseColorPaletteForBackground"):  # since 5.10, on unless told
        view.UseColorPaletteForBackground = 0
    view.Background, view.OrientationAxesVisibility = [1, 1, 1], 0
    shown = simple.Show(reader, view)
    shown.SetRepresentationType("Point Gaussian")
    if "radius" in names:
        shown.UseScaleFunction, shown.ScaleByArray = 0, 1
        shown.SetScaleArray, shown.GaussianRadius = ["POINTS", "radius"], 1.0
    else:
        shown.GaussianRadius = 0.5 * tile_edge(reader)
    simple.ColorBy(shown, ("POINTS", colour) if colour else None)
    low, high = (reader.GetDataInformation().GetBounds()[k::2] for k in (0, 1))
    middle, size = [(a + b) / 2 for a, b in zip(low, high)], max(b - a for a, b in zip(low, high))
    view.CameraFocalPoint, view.CameraViewUp = middle, [0, 0, 1]
    view.CameraPosition = [middle[0] + 1.2 * size, middle[1] - 0.9 * size, middle[2] + size]
    simple.ResetCamera(view)
    times = list(reader.TimestepValues) if hasattr(reader, "TimestepValues") else []
    for k, moment in enumerate(times or [0.0]):
        view.ViewTime = moment
        name = output.with_name(f"{output.stem}.{k:04d}{output.suffix}") if len(times) > 1 else output
        simple.SaveScreenshot(str(name), view)


if __name__ == "__main__":
    main()
