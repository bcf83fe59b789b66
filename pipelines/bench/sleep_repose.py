# SPDX-License-Identifier: GPL-3.0-or-later
"""Angles of repose with and without sleep, means over seeds, for the benchmark of sleep."""
import math

import numpy as np

from harness import note
from sleep_run import last_frame


def compare(programs, scene_class, tolerances, seeds, count):
    """Runs for each tolerance and seed, and one more run of the first seed with the audit on. `tolerances` begin with 0."""
    rows = {t: {"tolerance": t, "runs": [], "audit": None} for t in tolerances}
    what = scene_class(count)
    for seed in range(1, seeds + 1):
        (model, scene), path = what.start(seed, programs), programs.scratch / f"{what.name}.model.h5"
        model.write(path)
        free = model.species == 0

        def run(tolerance, audit=False):
            done = programs.dem_run(path, scene, tolerance, audit)
            done.update(what.measure(last_frame(done.pop("trajectory"))[free], model.radius[free]), seed=seed)
            values = ", ".join(f"{name} {done[name]:.2f} {unit}" for name, unit in what.quantities.items())
            note(f"  {what.name}, tolerance {tolerance:g}, seed {seed}{', audit' if audit else ''}: {done['wall_time']:.1f} s, "
                 f"{values}, asleep {done['asleep_fraction']:.2f}")
            return done

        # back and forth, so that a drift of the machine meets all tolerances alike
        for tolerance in tolerances if seed % 2 else tolerances[::-1]:
            rows[tolerance]["runs"].append(run(tolerance))
        if seed == 1:
            for tolerance in tolerances[1:]:
                rows[tolerance]["audit"] = run(tolerance, True)
    return {"name": what.name, "title": what.title, "text": what.text, "quantities": what.quantities, "grains": int(free.sum()),
            "seeds": seeds, "duration": scene["time"]["end"], "rows": summary(list(rows.values()), what.quantities)}


def summary(rows, quantities):
    """Adds to each row means, standard deviations over the seeds and differences to the first row, which never slept. A
    difference is also given in standard errors: of two means over the seeds, from the deviation pooled over all rows."""
    for row in rows:
        runs = row["runs"]
        for name in quantities:
            values = np.array([run[name] for run in runs])
            row[name] = {"mean": float(values.mean()), "deviation": float(values.std(ddof=1)) if len(runs) > 1 else None}
        for name in ("wall_time", "processor_time", "asleep_fraction", "sleep_error"):
            row[name] = float(np.mean([run[name] for run in runs]))
        row["asleep_fraction_at_end"] = float(np.mean([run.get("asleep_fraction_at_end") or 0.0 for run in runs]))
        for name in ("wall_time", "processor_time"):
            without = {run["seed"]: run[name] for run in rows[0]["runs"]}
            row[f"speed_up_{name}"] = float(np.median([without[run["seed"]] / run[name] for run in runs]))
    for name in quantities:
        pooled = [row[name]["deviation"]**2 for row in rows if row[name]["deviation"] is not None]
        error = math.sqrt(2 * np.mean(pooled) / len(rows[0]["runs"])) if pooled else None
        for row in rows:
            row[name]["difference"] = row[name]["mean"] - rows[0][name]["mean"]
            row[name]["standard_error"] = error
            row[name]["in_standard_errors"] = row[name]["difference"] / error if error else None
    return rows
