# SPDX-License-Identifier: GPL-3.0-or-later
"""Triaxial tests as units that are done once: specimens, tests, fits; for table4, triaxial-task, calibrate,
bench/triaxial.

A test is kept as NAME_KEY.traj.h5 with NAME_KEY.json, dem-run's result, beside it. The key is a hash of all that
determines the trajectory: the specimen's contents, dem-run's effective settings and its version. One that was stopped
goes on from its checkpoint; one that is running elsewhere is waited for. One that ended before its time has a `failure` in
its result.
"""
import concurrent.futures
import contextlib
import fcntl
import hashlib
import json
import os
import pathlib
import re
import signal
import subprocess
import sys
import threading
import time

import h5py
import numpy as np

from boxes import PUBLISHED, box
from harness import first_line, note, without_paths

PIPELINES = pathlib.Path(__file__).resolve().parents[1]
SCENE = PIPELINES / "scenes" / "triaxial.json"
FRICTION = {"PL": 0.0, "PF": 0.4, "FF": 0.0}  # of the grains while box or heap are made
RADIUS = 0.001     # m, of the specimen's grains; all lengths of a specimen follow from it
FRACTION = 0.64    # solid volume fraction of the boxes
FRAMES = 24        # of a test's shear
UNCONFINED = 0.5   # of the scene's platen velocity, without confining stress: waves in the specimen are slower
NOT_OF_THE_RESULT = ("threads", "format", "progress")
RESIDUAL = (0.11, 0.12)  # axial strain over which the residual stress is the mean, as in triax-fit
HELD = 0.02              # of the stress asked for, that the mean confining stress may be off, as in triax-fit


class Failed(RuntimeError):
    """A program gave up: the text says which and why."""


class Stopped(Exception):
    """On request, with a checkpoint: the same call goes on."""


# Programs, and signals to them -------------------------------------------------------------------------------------

running, stopping, guard = set(), threading.Event(), threading.Lock()


def pass_on(number, _):
    """What ends this script ends its programs; dem-run then writes a checkpoint. USR1 is kept as it is."""
    stopping.set()
    with contextlib.suppress(RuntimeError):
        for child in list(running):
            child.send_signal(number if number == signal.SIGUSR1 else signal.SIGTERM)


def catch_signals():
    for number in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP, signal.SIGUSR1):
        signal.signal(number, pass_on)


def call(command, held=()):
    """Exit code, standard output and error of a program. Signals reach it through pass_on only.

    @param held files whose locks it keeps until it ends, also where this script is killed"""
    with guard:
        if stopping.is_set():
            raise Stopped
        child = subprocess.Popen([str(word) for word in command], stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
                                 stderr=subprocess.PIPE, text=True, start_new_session=True,
                                 pass_fds=held, env=dict(os.environ, OMP_NUM_THREADS="1"))
        running.add(child)
    try:
        out, err = child.communicate()
    finally:
        running.discard(child)
    return child.returncode, out, err


def complaint_of(name, code, err):
    lines = [line for line in err.strip().splitlines() if "error" in line] or [f"exit {code}"]
    return f"{name}, exit {code}: {without_paths(lines[0]).removeprefix(f'{name}: error: ')}"


def checked(command):
    """Standard output of a program that must succeed. @throws Failed"""
    code, out, err = call(command)
    if code and stopping.is_set():
        raise Stopped
    if code:
        raise Failed(complaint_of(pathlib.Path(command[0]).name, code, err))
    return out


@contextlib.contextmanager
def locked(path):
    with open(path, "w") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        yield file


def write_whole(path, text):
    half = path.with_name(f".{path.name}.{os.getpid()}")
    half.write_text(text)
    half.replace(path)


def key_of(facts):
    return hashlib.sha256(json.dumps(facts, sort_keys=True).encode()).hexdigest()[:12]


def contents_key(path):
    """Hash of the datasets of a model, without what tells how the file was made."""
    digest = hashlib.sha256()

    def add(name, item):
        if isinstance(item, h5py.Dataset) and not name.startswith(("granular/provenance", "parameters")):
            digest.update(f"{name} {item.dtype} {item.shape}\n".encode())
            digest.update(np.ascontiguousarray(item[()]).tobytes())

    with h5py.File(path, "r") as file:
        file.visititems(add)
        if "granular/tiling" in file:
            digest.update(repr(float(file["granular/tiling"].attrs["scale"])).encode())
    return digest.hexdigest()[:16]


# Specimens ---------------------------------------------------------------------------------------------------------

class Bench:
    """Where programs and results are, and what all tests of a series share.

    @param settings KEY=VALUE words over the scene; @param jobs cores in all"""

    def __init__(self, folder, out, scene=SCENE, settings=(), jobs=1, max_wall=None):
        self.bin, self.out, self.scene = pathlib.Path(folder).resolve(), pathlib.Path(out).resolve(), scene
        self.settings, self.jobs, self.max_wall = list(settings), max(1, jobs), max_wall
        self.out.mkdir(parents=True, exist_ok=True)
        if not (self.bin / "dem-run").exists():
            raise Failed(f"{self.bin.name}: no dem-run there: build it, or name the programs' folder by --bin")
        self.version = first_line([self.bin / "dem-run", "--version"])
        self.known = {}

    def specimen(self, group, level, ratio, seed):
        """The specimen D = ratio x 2 mm across and 2 D high, made where it is not there.
        Returns {name, path, key, group, level, ratio, seed, particle_count, height}. @throws Failed, NotReached"""
        name = f"{group}{level}_ratio{ratio:g}_seed{seed}"
        if name not in self.known:
            with locked(self.out / f".{name}.lock"):
                self.known[name] = {"name": name, "group": group, "level": level, "ratio": ratio, "seed": seed,
                                    "height": 4 * ratio * RADIUS, **self.make(name, group, level, ratio, seed)}
        return self.known[name]

    def make(self, name, group, level, ratio, seed):
        path, kept = self.out / f"{name}.model.h5", self.out / f"{name}.model.json"
        diameter = 2 * ratio * RADIUS
        # Rounded, so that a length is written as a person would.
        region = f"{diameter:.9g},{2 * diameter:.9g}"
        if group == "FF":
            command = [PIPELINES / "free-fall-specimen", "--bin", self.bin, "--radius", RADIUS, "--cylinder", region,
                       "--friction", FRICTION[group], "--seed", seed, "--jobs", self.jobs]
            made_by = {"free_fall": [str(word) for word in command[3:-2]],
                       "version": self.version}
        else:
            source = self.out / f"{group}{level}_seed{seed}.pgbox.h5"
            with locked(self.out / f".{source.name}.lock"):
                box(self.bin, source, self.jobs, box_length=1, radius=PUBLISHED[level][0], friction=FRICTION[group],
                    solid_volume_fraction=FRACTION, route="compress", seed=seed)
            command = [self.bin / "tile-trim", source, "--radius-max", RADIUS, "--cylinder", region,
                       "--surface-rule", "centre", "-q"]
            made_by = {"box": contents_key(source), "trim": [str(word) for word in command[2:]],
                       "version": first_line([self.bin / "tile-trim", "--version"])}
        if path.exists() and kept.exists():
            known = json.loads(kept.read_text())
            if known["made_by"] == made_by:
                return {"path": path, "key": known["key"], "particle_count": known["particle_count"]}
        result = json.loads(checked([*command, "--format", "json", "-o", path, "--overwrite"]))
        known = {"made_by": made_by, "key": contents_key(path), "particle_count": result["particle_count"]}
        write_whole(kept, json.dumps(known, indent=1) + "\n")
        return {"path": path, "key": known["key"], "particle_count": known["particle_count"]}

    # Tests ---------------------------------------------------------------------------------------------------------

    def test(self, specimen, stress, more=(), tag=""):
        """A test that may be done: its name, its files and its command. @param more further KEY=VALUE words"""
        words = [f"triaxial.confining_stress={stress:.9g}", *self.settings, *more]
        command = [self.bin / "dem-run", specimen["path"], "-c", self.scene]
        command += [word for setting in words for word in ("--set", setting)]
        shown = json.loads(checked([*command, "--print-config"]))
        t = shown["triaxial"]
        if stress == 0 and not any(word.startswith("triaxial.platen_velocity=") for word in words):
            t["platen_velocity"] *= UNCONFINED
            words.append(f"triaxial.platen_velocity={t['platen_velocity']:.9g}")
            command += ["--set", words[-1]]
        if not any(word.startswith("output.frame_interval=") for word in words):
            interval = (t["axial_strain"] + t["velocity_ramp"]) * specimen["height"] / t["platen_velocity"] / FRAMES
            words.append(f"output.frame_interval={interval:.6g}")
            shown["output"]["frame_interval"] = float(f"{interval:.6g}")
            command += ["--set", words[-1]]
        settings = {key: value for key, value in shown.items() if key not in NOT_OF_THE_RESULT}
        made_by = {"version": self.version, "specimen": specimen["key"], "settings": settings}
        name = f"{specimen['name']}_{stress / 1e3:g}kPa{tag}_{key_of(made_by)}"
        return {"name": name, "specimen": specimen, "confining_stress": stress, "command": command, "made_by": made_by,
                "trajectory": self.out / f"{name}.traj.h5", "result": self.out / f"{name}.json"}

    def done(self, test):
        """dem-run's result where the test is complete, else nothing."""
        if not test["trajectory"].exists():
            return None
        try:
            return json.loads(test["result"].read_text())
        except (OSError, json.JSONDecodeError):  # ended between the two files: the trajectory is whole all the same
            return {"wall_time": None, "threads": None, "resumed": None, "made_by": test["made_by"]}

    def run(self, test, threads):
        """Does one test. Returns dem-run's result. @throws Failed, Stopped"""
        with locked(self.out / f".{test['name']}.lock") as lock:
            known = self.done(test)
            if known:
                return known
            resumed = test["trajectory"].with_name(f"{test['name']}.ckpt.h5").exists()
            limit = ["--max-wall", self.max_wall] if self.max_wall else []
            began = time.monotonic()
            code, out, err = call([*test["command"], "-j", threads, "--resume", "auto", *limit, "--format", "json", "-q",
                                   "--progress", "none", "-o", test["trajectory"], "--overwrite"], [lock.fileno()])
            if code == 75 or (code and stopping.is_set()):
                note(f"  {test['name']}: stopped after {time.monotonic() - began:.0f} s, the same call goes on")
                raise Stopped
            if code and not (code == 6 and out.strip()):
                raise Failed(f"{test['name']}: {complaint_of('dem-run', code, err)}")
            result = {**json.loads(out), "resumed": resumed, "made_by": test["made_by"]}
            write_whole(test["result"], json.dumps(result, indent=1) + "\n")
            (self.out / f".{test['name']}.lock").unlink(missing_ok=True)
            note(f"  {test['name']}: {result['wall_time']:.1f} s on {threads} "
                 f"thread{'s' if threads > 1 else ''}{', the last part' if resumed else ''}")
            return result

    def run_all(self, tests, share_out=True):
        """Does what is not done. As many tests side by side as there are cores, one thread each; the rest that would
        leave cores idle comes last and, with `share_out`, shares them out. Returns the failures by name, of tests that
        ended before their time as well. @throws Stopped"""
        todo = [test for test in {test["name"]: test for test in tests}.values() if not self.done(test)]
        todo.sort(key=lambda test: (-test["specimen"]["particle_count"], -test["confining_stress"]))
        whole = len(todo) - len(todo) % self.jobs
        failures, stopped = {}, False
        for part in (todo[:whole], todo[whole:]):
            if not part:
                continue
            workers = min(self.jobs, len(part))
            share = self.jobs // workers if share_out else 1
            with concurrent.futures.ThreadPoolExecutor(workers) as pool:
                for test, future in [(test, pool.submit(self.run, test, share)) for test in part]:
                    try:
                        future.result()
                    except Failed as why:
                        failures[test["name"]] = str(why)
                        note(f"  {why}")
                    except Stopped:
                        stopped = True
        if stopped:
            raise Stopped
        for test in tests:
            if failure := (self.done(test) or {}).get("failure"):
                failures[test["name"]] = f"{test['name']}: {failure}"
        return failures

    def fit(self, tests, *more):
        """triax-fit's result for these tests; with `held` false where a confining stress was not held, and `failed` where
        no envelope fits."""
        code, out, err = call([self.bin / "triax-fit", *(test["trajectory"] for test in tests), "--format", "json", "-q",
                               *more])
        if code not in (0, 6) or (code == 6 and not out.strip()):
            return {"failed": complaint_of("triax-fit", code, err)}
        return {**json.loads(out), "held": code == 0}


# Curves ------------------------------------------------------------------------------------------------------------

def series(path):
    """The columns of a test; shear_begins in s."""
    with h5py.File(path, "r") as file:
        group = file["granular/series"]
        columns = {name: group[f"triaxial/{name}"][()] for name in group["triaxial"]}
        columns |= {"time": group["time"][()], "bond_count": group["bond_count"][()]}
        columns["shear_begins"] = next((float(stage.attrs["time"]) for stage in file["granular/stages"].values()
                                        if stage.attrs["name"] == b"shear"), 0.0)
        return columns


def figures(path):
    """Peak, residual and what a test kept; stresses in Pa. The same definitions as triax-fit's without smoothing."""
    s = series(path)
    strain, q = s["axial_strain"], s["deviatoric_stress"]
    shear = strain > 0
    if not shear.any():
        raise Failed(f"{path.name}: no row with an axial strain above 0: give output.series_interval a smaller value")
    peak = np.flatnonzero(shear)[np.argmax(q[shear])]
    last = (strain >= RESIDUAL[0] - 1e-12) & (strain <= RESIDUAL[1] + 1e-12)
    asked, achieved = float(np.mean(s["confining_stress_target"][shear])), float(np.mean(s["confining_stress"][shear]))
    allowed = HELD * (asked if asked > 0 else float(q[peak]))
    return {"confining_stress": achieved, "peak_deviatoric_stress": float(q[peak]), "peak_strain": float(strain[peak]),
            "residual_deviatoric_stress": float(np.mean(q[last])) if strain[-1] >= RESIDUAL[1] - 1e-3 else None,
            "consolidated_in": s["shear_begins"], "volumetric_strain_at_end": float(s["volumetric_strain"][-1]),
            "bonds_left": float(s["bond_count"][-1] / max(1, s["bond_count"][0])),
            "held": bool(abs(achieved - asked) <= allowed)}


# Options that all scripts share ------------------------------------------------------------------------------------

def words_of(kind):
    """"1, 2 3" as numbers or words, for argparse."""
    def convert(text):
        return [kind(word) for word in text.replace(",", " ").split()]
    convert.__name__ = f"list of {kind.__name__}"
    return convert


UNITS = {"": 1, "m": 1, "cm": 1e-2, "mm": 1e-3, "Pa": 1, "kPa": 1e3, "MPa": 1e6, "GPa": 1e9, "deg": 1, "rad": 180 / np.pi}


def quantity(*units):
    """A number with one of these units or none, as dem-run takes them, in the first of them times its SI value."""
    def convert(text):
        found = re.fullmatch(r"\s*([-+.0-9eE]+)\s*([A-Za-z]*)\s*", text)
        if not found or (found[2] and found[2] not in units):
            raise ValueError(text)
        return float(found[1]) * UNITS[found[2]]
    convert.__name__ = "number with " + " or ".join(units)
    return convert


def common_options(parser, out):
    parser.add_argument("--bin", type=pathlib.Path, default="build/release/bin", help="folder of the programs")
    parser.add_argument("--out", type=pathlib.Path, default=out, help="folder of the results")
    parser.add_argument("--scene", type=pathlib.Path, default=SCENE, help="of dem-run")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE",
                        help="over the scene, as dem-run's; may be given several times")
    parser.add_argument("--jobs", type=int, default=len(os.sched_getaffinity(0)), help="cores in all")
    parser.add_argument("--max-wall", help="of each test, as 3h50m: it then stops with a checkpoint")


def main_of(name, body):
    """Runs a script's body and ends with its exit code, 75 where it was stopped."""
    catch_signals()
    try:
        sys.exit(body())
    except Stopped:
        note(f"{name}: stopped; the same call goes on where it was")
        sys.exit(75)
    except (Failed, OSError) as why:
        print(f"{name}: error: {why}", file=sys.stderr)
        sys.exit(1)
