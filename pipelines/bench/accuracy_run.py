# SPDX-License-Identifier: GPL-3.0-or-later
"""Runs of dem-run for the accuracy benchmark: a model written with h5py, a scene as JSON, results read back."""
import dataclasses
import json
import math
import pathlib
import subprocess
import sys

import h5py
import numpy as np

DEFAULT_STEP = 0.2  # of the Rayleigh time
KNOBS = {  # curve: what it changes in the scene
    "double": {},
    "mixed": {"precision": "mixed"},
    "exact damping": {"contact": {"damping": "exact"}},
    "no-tension": {"contact": {"separation": "no-tension"}},
    "reference kernel": {"kernel": "reference"},
}
MATERIAL = {"density": 1000.0, "youngs_modulus": 1e8, "poissons_ratio": 0.2, "restitution": 0.2, "friction": 0.4}


class NotAvailable(Exception):
    """This build refuses the setting."""


@dataclasses.dataclass
class Model:
    """The smallest model that another program may write."""
    position: np.ndarray
    radius: np.ndarray
    velocity: np.ndarray = None
    angular_velocity: np.ndarray = None
    species: np.ndarray = None  # 0 grain, 1 fixed

    def write(self, path):
        with h5py.File(path, "w") as file:
            file.create_group("granular").attrs.update(kind="model", complete=1)
            for field in dataclasses.fields(self):
                values = getattr(self, field.name)
                if values is not None:
                    file[f"particles/all/{field.name}"] = values


@dataclasses.dataclass
class Run:
    """JSON result, last frame and series of one run."""
    result: dict
    position: np.ndarray
    velocity: np.ndarray
    angular_velocity: np.ndarray
    series: dict

    def same_bits(self, other):
        return all(getattr(self, name).tobytes() == getattr(other, name).tobytes()
                   for name in ("position", "velocity", "angular_velocity"))


def merged(scene, change):
    """The scene with another's keys put over its own."""
    out = dict(scene)
    for key, value in change.items():
        out[key] = merged(out.get(key, {}), value) if isinstance(value, dict) else value
    return out


def rayleigh_time(radius, material):
    shear = material["youngs_modulus"] / (2 * (1 + material["poissons_ratio"]))
    return math.pi * radius * math.sqrt(material["density"] / shear) / (0.1631 * material["poissons_ratio"] + 0.8766)


class Engine:
    """dem-run in a scratch folder."""

    def __init__(self, folder_of_tools, scratch, threads):
        self.program = pathlib.Path(folder_of_tools).resolve() / "dem-run"
        if not self.program.exists():
            sys.exit(f"{self.program}: not found; build it, or say where it is with --bin")
        self.scratch, self.threads = pathlib.Path(scratch), threads

    def version(self):
        return subprocess.run([self.program, "--version"], capture_output=True, text=True).stdout.strip()

    def run(self, model, scene, change, step):
        """One run; a short one is repeated and the shortest time kept, for a few milliseconds measure nothing."""
        scene = merged(merged(scene, {"time": {"step_fraction": step, "allow_unstable": True}, "output": {
            "fields": ["position", "velocity", "angular_velocity"], "float64": True}}), change)
        model.write(self.scratch / "model.h5")
        (self.scratch / "scene.json").write_text(json.dumps(scene))
        best = self._once(change)
        for _ in range(2):
            if best["wall_time"] > 0.3:
                break
            best = min(best, self._once(change), key=lambda result: result["wall_time"])
        with h5py.File(self.scratch / "run.h5", "r") as file:
            group, series = file["particles/all"], file["granular/series"]
            last = {name: group[name]["value"][-1] for name in ("position", "velocity", "angular_velocity")}
            last["position"] = last["position"] + group["position"].attrs.get("origin", np.zeros(3))
            table = {}
            series.visititems(lambda name, item: table.update({name: item[:]})
                              if isinstance(item, h5py.Dataset) else None)
        free = model.radius if model.species is None else model.radius[model.species == 0]
        expected = step * rayleigh_time(free.min(), scene["material"])
        if not math.isclose(best["time_step"], expected, rel_tol=1e-5):
            sys.exit(f"dem-run took a step of {best['time_step']} s, expected {expected} s")
        return Run(best, series=table, **last)

    def _once(self, change):
        done = subprocess.run([self.program, "model.h5", "-c", "scene.json", "-o", "run.h5", "--overwrite", "--format",
                               "json", "-q", "-j", str(self.threads)], cwd=self.scratch, capture_output=True, text=True)
        if done.returncode in (2, 3) and change:
            raise NotAvailable(done.stderr.strip().splitlines()[-1].split("error: ")[-1])
        if done.returncode != 0:
            sys.exit(f"dem-run failed ({done.returncode}):\n{done.stderr}\nscene: {self.scratch / 'scene.json'}")
        return json.loads(done.stdout)


def row(curve, step, errors, runs, **more):
    """A line of a table: what the knob was, what it cost."""
    wall = sum(r.result["wall_time"] for r in runs)
    work = sum(r.result["steps"] * r.result["particle_count"] for r in runs)
    return {"curve": curve, "step_fraction": step, "errors": errors, "wall_time": wall,
            "particle_steps_per_second": work / wall if wall > 0 else 0, "kernel": runs[0].result["kernel"], **more}


def sweep(plan, evaluate):
    """Rows of all curves: `plan` is (curve, change of the scene, steps), evaluate(curve, change, step) a row."""
    rows = []
    for curve, change, steps in plan:
        for step in steps:
            try:
                rows.append(evaluate(curve, change, step))
            except NotAvailable as reason:
                rows.append({"curve": curve, "not_available": str(reason)})
                print(f"  {curve}: not available ({reason})", file=sys.stderr)
                break
            print(f"  {curve}, step {step}: {rows[-1]['wall_time']:.2f} s", file=sys.stderr)
    return rows


def columns(rows, kind):
    return list(dict.fromkeys(name for r in rows for name in r.get(kind, {})))


def pick(rows, curve, step=DEFAULT_STEP):
    return next((r for r in rows if r["curve"] == curve and r.get("step_fraction") == step), None)
