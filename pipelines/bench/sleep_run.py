# SPDX-License-Identifier: GPL-3.0-or-later
"""Runs of the programs for the benchmark of sleep, with what they cost and what other programs used meanwhile."""
import json
import pathlib
import resource
import sys

import h5py
import numpy as np

from accuracy_run import merged
from harness import run, without_paths


class Programs:
    """dem-run and the programs beside it, in a scratch folder."""

    def __init__(self, folder, scratch, threads):
        self.folder, self.scratch, self.threads = pathlib.Path(folder).resolve(), pathlib.Path(scratch), threads
        if not (self.folder / "dem-run").exists():
            sys.exit(f"{self.folder}: no dem-run here; build it, or say where it is with --bin")
        self.busiest = 0.0  # largest share of the cores that others used

    def json(self, tool, *words):
        """A program's JSON result with `processor_time` (s, user and system) and `foreign`."""
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        done, foreign = run([self.folder / tool, *words, "-j", self.threads, "--format", "json", "-q", "--progress", "none"],
                            cwd=self.scratch)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        if done.returncode:
            raise RuntimeError(f"{tool}, exit {done.returncode}: {without_paths(done.stderr.strip())}")
        result = json.loads(done.stdout)
        result["processor_time"] = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
        result["foreign"] = foreign
        self.busiest = max(self.busiest, foreign)
        return result

    def dem_run(self, model, scene, tolerance, audit=False):
        """One run; its result with `trajectory`, the file, which the next run replaces."""
        config, trajectory = self.scratch / "scene.json", self.scratch / "run.traj.h5"
        config.write_text(json.dumps(merged(scene, {"sleep": {"tolerance": tolerance, "audit": audit}})))
        result = self.json("dem-run", model, "-c", config, "-o", trajectory, "--overwrite")
        return {**result, "trajectory": trajectory}


def last_frame(trajectory):
    """Positions (m) at the end of a run, rows by particle."""
    with h5py.File(trajectory, "r") as file:
        position = file["particles/all/position"]
        return position["value"][-1] + position.attrs.get("origin", np.zeros(3))
