# SPDX-License-Identifier: GPL-3.0-or-later
"""Slides with and without sleep beside slides that differ by rounding only, for the benchmark of sleep."""
import json
import pathlib
import re
import shutil
import subprocess

import h5py
import numpy as np

from boxes import box
from harness import note

PIPELINES = pathlib.Path(__file__).resolve().parents[1]
HELENS = PIPELINES.parent / "data-samples" / "st-helens-2021"
PERTURBATION = 1e-12  # of the positions
MEASURES = ("moved_volume", "runout_length", "runout_length_95", "center_of_mass_travel")
BIN = 10.0  # m, of the histogram of travel


def without_comments(text):
    """A scene as JSON, without the lines of // comments."""
    return json.loads(re.sub(r"^\s*//.*$", "", text, flags=re.M))


def st_helens(_folder):
    return {"name": "st-helens", "radius": 2, "scene": "slide.json", "analyse": ["--pre", HELENS / "pre_runout_DEM.asc"],
            "trim": ["--pre", HELENS / "pre_runout_DEM.asc", "--post", HELENS / "post_runout_DEM.asc", "--shift", 8,
                     "--source-area", HELENS / "source_area.geojson", "--domain", HELENS / "corridor.geojson"]}


def paper(folder):
    ground = folder / "terrain"
    subprocess.run([PIPELINES / "paper-slope", "-o", ground, "--overwrite"], check=True, stdout=subprocess.DEVNULL)
    return {"name": "paper", "radius": 4, "scene": "paper-slide.json", "analyse": ["--pre", ground / "pre.asc", "--cell", 16],
            "trim": ["--pre", ground / "pre.asc", "--post", ground / "post.asc", "--shift", 16, "--source-area",
                     ground / "source_area.geojson", "--domain", ground / "domain.geojson"]}


SLOPES = {"st-helens": st_helens, "paper": paper}


def perturbed(source, target, seed):
    """A copy of an explicit model whose positions differ by PERTURBATION times themselves."""
    shutil.copyfile(source, target)
    draw = np.random.default_rng(seed)
    with h5py.File(target, "r+") as file:
        position = file["particles/all/position"]
        values = position[...]
        position[...] = values * (1 + PERTURBATION * draw.choice([-1.0, 1.0], size=values.shape))


def histogram(result):
    """Mobile grains by travel in bins of BIN, over the number of those released."""
    counts = result["travel_histogram"]["count"]
    return np.array([result["mobile_count"] - sum(counts), *counts]) / result["released_count"]


def distance(a, b):
    """How many grains are in other bins: half the sum of differences."""
    size = max(len(a), len(b))
    return float(0.5 * np.abs(np.pad(a, (0, size - len(a))) - np.pad(b, (0, size - len(b)))).sum())


def compare(programs, name, tolerances, references, radius=None):
    """The slope without sleep, `references` times from positions that differ by rounding, and once for each tolerance above 0."""
    slope = SLOPES[name](programs.scratch)
    radius = radius or slope["radius"]
    grains, model, other = (programs.scratch / f"{part}.h5" for part in ("box.pgbox", "slope.model", "perturbed.model"))
    box(programs.folder, grains, programs.threads, radius=0.06, radius_min_ratio=0.82, friction=0, solid_volume_fraction=0.64,
        route="compress", seed=1)
    made = programs.json("tile-trim", grains, *slope["trim"], "--radius-max", radius, "--explicit", "-o", model, "--overwrite")
    scene = without_comments((PIPELINES / "scenes" / slope["scene"]).read_text())

    def run(path, tolerance, what):
        done = programs.dem_run(path, scene, tolerance)
        slide = programs.json("runout-analyse", done.pop("trajectory"), *slope["analyse"], "--histogram-from", BIN,
                              "--bin-width", BIN)
        done.update({key: slide[key] for key in MEASURES}, travel=histogram(slide).tolist(), tolerance=tolerance)
        note(f"  {name}, {what}: {done['wall_time']:.1f} s, moved {done['moved_volume']:.4g} m3, runout "
             f"{done['runout_length_95']:.1f} m, asleep {done['asleep_fraction']:.2f}")
        return done

    awake = []
    for k in range(references):
        if k:
            perturbed(model, other, k)
        awake.append(run(other if k else model, 0, f"without sleep, {'perturbed' if k else 'as it is'}"))
    asleep = [run(model, t, f"tolerance {t:g}") for t in tolerances if t > 0]
    return {"name": name, "radius": radius, "grains": made["particle_count"], "mobile": made["particle_count"] -
            made["fixed_count"], "released": made["release_count"], "references": awake, "runs": asleep,
            **judged(awake, asleep)}


def judged(awake, asleep):
    """Spreads of the runs without sleep and, added to each run with sleep, its differences to them. Spread of a measure: largest
    less smallest; of the histograms: largest distance of two. The difference is that to the mean, of the histogram the mean
    distance to those without sleep."""
    spread, mean = {}, {}
    for name in MEASURES:
        values = [run[name] for run in awake]
        spread[name], mean[name] = max(values) - min(values), float(np.mean(values))
    travels = [np.array(run["travel"]) for run in awake]
    pairs = [distance(a, b) for k, a in enumerate(travels) for b in travels[:k]]
    spread["travel"], mean["travel"] = max(pairs), float(np.mean(pairs))
    for run in asleep:
        differences = {name: run[name] - mean[name] for name in MEASURES}
        differences["travel"] = float(np.mean([distance(np.array(run["travel"]), t) for t in travels]))
        run["differences"] = differences
        run["within_spread"] = {name: abs(d) <= spread[name] for name, d in differences.items()}
    wall, processor = (np.mean([run[key] for run in awake]) for key in ("wall_time", "processor_time"))
    for run in asleep:
        run["speed_up_wall_time"] = float(wall / run["wall_time"])
        run["speed_up_processor_time"] = float(processor / run["processor_time"])
    return {"spread": spread, "mean": mean, "outside_by_chance": outside_by_chance(len(awake))}


def outside_by_chance(references, draws=200000):
    """How often a further normal sample lies further from the mean of so many than these spread: what a difference means."""
    values = np.random.default_rng(1).normal(size=(draws, references + 1))
    first = values[:, :references]
    return float(np.mean(np.abs(values[:, -1] - first.mean(axis=1)) > first.max(axis=1) - first.min(axis=1)))
