# SPDX-License-Identifier: GPL-3.0-or-later
"""What every measurement shares: starting programs, the state of the machine, alternating repeats, the report."""
import json
import os
import pathlib
import platform
import re
import resource
import statistics
import subprocess
import sys

FOREIGN_LIMIT = 0.05  # share of the cores used by other programs above which a row carries a warning
LOAD_LIMIT = 0.3      # load average before the start above which the table does


class Unavailable(Exception):
    """This build or machine cannot run the case: the row says so and the rest goes on."""


def note(text):
    print(text, file=sys.stderr, flush=True)


# Processes --------------------------------------------------------------------------------------------------------

def cpu_ticks():
    """Busy and stolen time of all cores since the machine started, in seconds."""
    try:
        fields = [int(x) for x in open("/proc/stat").readline().split()[1:]]
    except OSError:
        return 0.0
    user, nice, system, _idle, _wait, irq, softirq, steal = fields[:8]
    return (user + nice + system + irq + softirq + steal) / os.sysconf("SC_CLK_TCK")


def run(command, cwd=None):
    """Runs a program to its end. Returns the process and the share of the cores that others used meanwhile."""
    before, clock = resource.getrusage(resource.RUSAGE_CHILDREN), os.times().elapsed
    busy = cpu_ticks()
    environment = dict(os.environ, OMP_NUM_THREADS="1")  # ours takes its threads from -j, LAMMPS from its ranks
    done = subprocess.run([str(word) for word in command], cwd=cwd, env=environment, text=True,
                          stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    elapsed = max(os.times().elapsed - clock, 1e-3)
    own = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    foreign = max(0.0, cpu_ticks() - busy - own) / elapsed / (os.cpu_count() or 1)
    return done, foreign


def first_line(command, pattern=r"\S"):
    try:
        text = subprocess.run(command, text=True, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
                              stderr=subprocess.STDOUT).stdout
    except OSError:
        return None
    return next((line.strip() for line in text.splitlines() if re.search(pattern, line)), None)


def machine():
    facts = {"cores": os.cpu_count(), "load_average_before": list(os.getloadavg()),
             "memory": os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"), "kernel": platform.release()}
    line = first_line(["lscpu"], r"^Model name")
    facts["processor"] = line.split(":", 1)[1].strip() if line else platform.machine()
    return facts


# dem-run ----------------------------------------------------------------------------------------------------------

class DemRun:
    def __init__(self, folder, out):
        self.program, self.out = pathlib.Path(folder).resolve() / "dem-run", out
        self.start_times = {}

    def version(self):
        return first_line([self.program, "--version"])

    def once(self, scene, steps, threads=1, ranks=1, keep=None, overrides=None):
        """One run; the program's own JSON with `foreign`. `keep`: where the trajectory goes, else it is discarded.
        @throws Unavailable where the configuration is refused (exit 3)"""
        settings = merged(scene["settings"], overrides or {})
        # Half a step early: the number of steps does not hang on rounding.
        settings["time"]["end"] = (steps - 0.5) * settings["time"]["step"]
        output = {"fields": ["position", "velocity", "angular_velocity"], "float64": True} if keep else \
                 {"fields": ["position"]}
        settings["output"] = output
        config = self.out / "scene.json"
        config.write_text(json.dumps(settings, indent=1))
        target = keep or self.out / "discarded.traj.h5"
        command = [self.program, scene["model"], "-c", config, "-j", threads, "--format", "json", "-q",
                   "--progress", "none", "--overwrite", "-o", target]
        if ranks > 1:
            command = mpirun(ranks) + command
        done, foreign = run(command)
        if not keep:
            for leftover in (target, target.with_suffix(".xdmf")):
                leftover.unlink(missing_ok=True)
        complaint = (done.stderr.strip().splitlines() or [f"exit {done.returncode}"])[0]
        if done.returncode == 3:
            raise Unavailable(without_paths(complaint))
        if done.returncode != 0:
            raise RuntimeError(f"dem-run, exit {done.returncode}: {without_paths(complaint)}")
        try:
            result = json.loads(done.stdout)
        except json.JSONDecodeError:
            raise Unavailable("dem-run printed no single JSON document") from None
        if result["ranks"] != ranks:
            raise Unavailable(f"asked for {ranks} ranks, dem-run ran {result['ranks']}")
        result["foreign"] = foreign
        return result

    def timed(self, scene, steps, threads=1, ranks=1, overrides=None):
        """Particle-steps per second of the loop alone. dem-run's wall_time holds the first list of pairs and two
        frames as well, which LAMMPS' loop time does not: a run of one step, timed once per case, is taken off."""
        case = (str(scene["model"]), threads, ranks, json.dumps(overrides, sort_keys=True))
        if case not in self.start_times:
            self.start_times[case] = min(self.once(scene, 1, threads, ranks, overrides=overrides)["wall_time"]
                                         for _ in range(2))
        result = self.once(scene, steps, threads, ranks, overrides=overrides)
        loop = result["wall_time"] - self.start_times[case]
        if loop <= 0:
            raise RuntimeError("the run is too short to be timed: take more steps")
        result.update(start_time=self.start_times[case], loop_time=loop,
                      rate=result["particle_count"] * (result["steps"] - 1) / loop)
        return result


def merged(settings, overrides):
    """Settings with the override's keys replaced, section by section."""
    out = {key: dict(value) if isinstance(value, dict) else value for key, value in settings.items()}
    for key, value in overrides.items():
        out[key] = {**out.get(key, {}), **value} if isinstance(value, dict) else value
    return out


def mpirun(ranks):
    command = ["mpirun", "-n", ranks, "--oversubscribe", "--bind-to", "none"]
    return command + (["--allow-run-as-root"] if os.geteuid() == 0 else [])


def without_paths(text):
    return re.sub(r"(/[\w.+-]+)+/", "", text)


# Repeats and rows -------------------------------------------------------------------------------------------------

def alternate(repeats, *cases):
    """Runs the cases one after the other, `repeats` rounds of it, so that a drift of the machine meets all alike.
    Odd rounds go backwards. Returns one list of results per case."""
    results = [[None] * repeats for _ in cases]
    for r in range(repeats):
        order = range(len(cases)) if r % 2 == 0 else reversed(range(len(cases)))
        for k in order:
            results[k][r] = cases[k]()
    return results


def spread(values):
    return {"median": statistics.median(values), "min": min(values), "max": max(values), "values": list(values)}


def ratios(above, below):
    """Ratio of rates within each round."""
    return spread([a["rate"] / b["rate"] for a, b in zip(above, below)])


class Report:
    """Rows of the table and every raw result, written after each row: a stopped run leaves what it had."""

    def __init__(self, out, facts):
        self.out, self.facts, self.rows, self.failed = out, facts, [], False

    def row(self, number, what, ratio=None, target=None, ours=None, theirs=None, remark="", at_most=False, value=None):
        """`ratio`: a spread; `target`: what its median is to reach (at least, or at most); `ours`, `theirs`: results of
        the two sides; `value`: measured number that is no ratio."""
        measured = ratio["median"] if ratio else value
        row = {"number": number, "what": what, "target": target, "at_most": at_most, "measured": measured,
               "ratio": ratio, "ours": ours, "theirs": theirs, "remark": remark}
        results = (ours or []) + (theirs or [])
        row["foreign"] = max((r.get("foreign", 0) for r in results), default=0)
        if row["foreign"] > FOREIGN_LIMIT:
            row["remark"] += f"{'; ' if remark else ''}WARNING: other programs used {row['foreign']:.0%} of the cores"
        self.rows.append(row)
        self.write()
        note("  " + self.line(row))

    def missing(self, number, what, why, target=None):
        self.row(number, what, target=target, remark=f"not available: {why}")

    @staticmethod
    def line(row):
        def speed(results):
            return f"{statistics.median(r['rate'] for r in results) / 1e6:.2f}" if results else ""

        def figure(x):
            return "" if x is None else f"{x:.0f}" if x >= 100 else f"{x:.2f}"

        kernels = sorted({r["kernel"] for r in row["ours"] or [] if "kernel" in r})
        spans = f"{row['ratio']['min']:.2f} to {row['ratio']['max']:.2f}" if row["ratio"] else ""
        target = "" if row["target"] is None else ("at most " if row["at_most"] else "at least ") + f"{row['target']:g}"
        of_target = ""
        if row["target"] and row["measured"] is not None:
            of_target = figure(row["measured"] / row["target"])
        cells = [row["number"], row["what"], speed(row["ours"]), speed(row["theirs"]), figure(row["measured"]), spans,
                 target, of_target, ", ".join(kernels), row["remark"]]
        return "| " + " | ".join(cell.replace("|", "/") for cell in cells) + " |"

    def table(self):
        f = self.facts
        load = f["machine"]["load_average_before"][0]
        lines = ["# Speed", ""]
        lines.append(f"{f['machine']['processor']}, {f['machine']['cores']} cores, "
                     f"{f['machine']['memory'] / 2**30:.0f} GiB; load average before the start {load:.2f}. "
                     f"{f['dem-run']}; {f['lammps'] or 'no LAMMPS on this machine: its columns are empty'}.")
        lines.append(f"{f['repeats']} alternating rounds; ratios are taken within each round, median and range shown."
                     + (" **Quick mode: few steps, one round; the figures mean nothing.**" if f["quick"] else ""))
        if load > LOAD_LIMIT:
            lines += ["", f"**WARNING: the load average was {load:.2f} before the start: other programs were running, "
                          "the figures are not to be trusted.**"]
        lines += ["", "| # | what | million particle-steps/s | of the other side | measured | range | target | measured/target"
                      " | kernel | remark |", "|---|---|---|---|---|---|---|---|---|---|"]
        return "\n".join(lines + [self.line(row) for row in self.rows]) + "\n"

    def write(self):
        (self.out / "speed.json").write_text(json.dumps({**self.facts, "rows": self.rows}, indent=1) + "\n")
        (self.out / "speed.md").write_text(self.table())
