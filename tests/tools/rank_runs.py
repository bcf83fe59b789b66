# SPDX-License-Identifier: GPL-3.0-or-later
"""Runs of dem-run on several ranks, and the small slide that they run."""
import os
import pathlib
import re
import shutil
import signal
import subprocess
import tempfile
import time

import h5py

from scenes import Scenes
from talus_tools import BIN, HELENS, datasets, words

os.environ.update(OMPI_ALLOW_RUN_AS_ROOT="1", OMPI_ALLOW_RUN_AS_ROOT_CONFIRM="1",
                  OMPI_MCA_mpi_yield_when_idle="1",  # who waits makes room: other tests may run at the same time
                  OMPI_MCA_odls_base_sigkill_timeout="0")  # seconds that the ranks left over have after a kill


def mpirun(ranks):
    """A wrapper that runs a command on so many ranks; one rank is the command itself. Without MPI's own remarks, so
    that standard error holds the program's lines only."""
    return ["mpirun", "--quiet", "--oversubscribe", "-n", str(ranks)] if ranks > 1 else []


def children(pid):
    try:
        return [int(child) for child in pathlib.Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]
    except OSError:
        return []


def heeds(pid, number):
    """Whether a process has a handler for this signal: before, it would just die of it."""
    try:
        for line in pathlib.Path(f"/proc/{pid}/status").read_text().splitlines():
            if line.startswith("SigCgt:"):
                return bool(int(line.split()[1], 16) >> (number - 1) & 1)
    except OSError:
        pass
    return False


class RankRuns(Scenes):
    """Models are made once, in the class's own folder, and copied into each test's."""

    @classmethod
    def setUpClass(cls):
        cls.made = pathlib.Path(tempfile.mkdtemp(prefix="talus-test-"))
        cls.addClassCleanup(shutil.rmtree, cls.made, ignore_errors=True)
        once = cls("prepare")
        once.folder = cls.made
        once.prepare()

    def prepare(self):
        raise NotImplementedError

    def setUp(self):
        super().setUp()
        shutil.copytree(self.made, self.folder, dirs_exist_ok=True)

    def run_tool(self, *arguments, **options):
        """Without what the launcher itself now and then says while it ends: "[warn] ..." or "[host:process] ..."."""
        got = super().run_tool(*arguments, **options)
        got.err = "".join(line for line in got.err.splitlines(keepends=True)
                          if not re.match(r"\[(warn|[\w.-]+:\d+)\] ", line))
        return got

    def make_slope(self, name, *more, radius=2.2):
        """Some 5000 grains on a part of the real slope, the lowest fixed and some to be released."""
        self.ok("pgbox-gen", "--radius", 0.09, "-o", "box.h5", "--overwrite")
        self.ok("tile-trim", "box.h5", "--pre", HELENS / "pre_runout_DEM.asc", "--post", HELENS / "post_runout_DEM.asc",
                "--shift", 8, "--source-area", HELENS / "source_area.geojson", "--domain", "361190,70850,361330,71130",
                "--fixed-thickness", 4, "--radius-max", radius, "-o", name, *more)

    def write_slide(self, step_fraction):
        """A scene in which all that a run can have happens within seconds; `step_fraction` sets how long it takes."""
        self.write("scene.json", {
            "material": {"density": "2.4g/cm3", "friction": 0.2}, "stress_free_start": True,
            "bond": {"bond_pressure": "4kPa", "bond_friction": 2}, "time": {"step_fraction": step_fraction},
            "output": {"frame_interval": "500ms", "series_interval": "100ms"},
            "stages": [{"name": "settle", "until": "rest", "limit": "0.5s", "damping": {"viscous": "2Hz"}},
                       {"name": "slide", "release": True, "release_bonds": "mass", "end": "2s"}]})

    def fraction_for(self, seconds):
        """The step fraction at which the slide takes so long here on one rank, whatever the machine: a run that is to
        be stopped or killed must last for some looks at the clock, which it takes every 0.2 s."""
        self.write_slide(0.05)
        result = self.ok("dem-run", *self.arguments("trial.h5"), "--format", "json").json
        for made in self.folder.glob("trial.*"):
            made.unlink()
        return min(0.05, round(0.05 * result["wall_time"] / seconds, 5))

    def arguments(self, output="run.h5", model="slope.h5"):
        return [model, "-c", "scene.json", "-j", 1, "-q", "-o", output]

    def start(self, ranks, *arguments, launcher=None):
        """A run in the background; returns the process, its standard error open."""
        command = [*(mpirun(ranks) if launcher is None else launcher), BIN / "dem-run", *arguments]
        process = subprocess.Popen(words(*command), cwd=self.folder, stdin=subprocess.DEVNULL,
                                   stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
        self.addCleanup(process.stderr.close)
        self.addCleanup(process.kill)
        return process

    def ranks_of(self, process, ranks, ready=lambda pid: True):
        """The processes of a run once they are all there, each `ready`; fewer where the run ended meanwhile."""
        while True:
            found = [process.pid] if ranks == 1 else children(process.pid)
            if process.poll() is not None or (len(found) == ranks and all(ready(pid) for pid in found)):
                return found
            time.sleep(0.0002)

    def stop_at_once(self, ranks, *arguments):
        """Begins a run and stops it by a signal as soon as it listens, so after its first steps."""
        process = self.start(ranks, *arguments)
        found = self.ranks_of(process, ranks, lambda pid: heeds(pid, signal.SIGUSR1))
        if process.poll() is not None:
            self.fail("ended before it could be stopped: " + process.stderr.read())
        os.kill(found[-1], signal.SIGUSR1)
        return process.wait(120), process.stderr.read()

    def assertWhole(self, *names):
        """Each file is complete and all its checksums are right, or it is not there."""
        for name in names:
            if (self.folder / name).exists():
                with h5py.File(self.folder / name, "r") as file:
                    self.assertEqual(file["granular"].attrs["complete"], 1, name)
                datasets(self.folder / name)
