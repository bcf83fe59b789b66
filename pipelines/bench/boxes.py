# SPDX-License-Identifier: GPL-3.0-or-later
"""PG boxes out of the cache and pgbox-stats' judgement of them, for the tables."""
import json
import math
import pathlib

from harness import Unavailable, note, run, without_paths

CACHE = pathlib.Path(__file__).resolve().parents[1] / "pgbox-cache"

# Chen, Furuichi & Nishiura, Table 2, frictionless boxes: level: radius (m), grains, Z, RSD (%), and the 5 to 95 % band of
# the RSD (%) that counting noise alone makes with as many contacts.
PUBLISHED = {1: (0.01, 152799, 6.116, 1.27, (0.9, 1.8)), 2: (0.03, 5660, 6.271, 6.16, (3.9, 9.7)),
             3: (0.06, 708, 6.322, 16.39, (11, 25)), 4: (0.09, 210, 6.419, 32.01, (20, 43))}
RUN_ON = 1000  # steps of pgbox-stats' check of rest


class NotReached(RuntimeError):
    """pgbox-gen gave up: the text says which measure failed."""


def words(settings):
    """{"sediment.alpha": 0.3} as switches."""
    return [word for key, value in settings.items() for word in ("--" + key.replace("_", "-"), f"{value}")]


def box(folder, target, threads, **settings):
    """A box with these settings, under the name `target`; pgbox-gen's result.
    @throws Unavailable where the configuration is refused, NotReached where the packing did not converge"""
    done, foreign = run([CACHE, folder / "pgbox-gen", *words(settings), "-j", threads, "-q", "--progress", "none",
                         "--format", "json", "-o", target, "--overwrite"])
    complaint = without_paths((done.stderr.strip().splitlines() or [f"exit {done.returncode}"])[-1])
    complaint = complaint.removeprefix("pgbox-gen: error: ")
    if done.returncode == 3:
        raise Unavailable(complaint)
    if done.returncode == 6:
        raise NotReached(complaint)
    if done.returncode:
        raise RuntimeError(f"pgbox-gen, exit {done.returncode}: {complaint}")
    result = json.loads(done.stdout)
    if not result["cached"]:
        note(f"  {target.name.removesuffix('.pgbox.h5')}: {result['wall_time']:.1f} s" +
             (f" (other programs used {foreign:.0%} of the cores)" if foreign > 0.05 else ""))
    return result


def judged(folder, path, threads):
    """pgbox-stats' result, kept beside the box while neither the box nor the program is newer."""
    program, kept = folder / "pgbox-stats", path.with_name(path.name.replace(".pgbox.h5", ".stats.json"))
    if kept.exists() and kept.stat().st_mtime > max(path.lstat().st_mtime, program.stat().st_mtime):
        try:
            return json.loads(kept.read_text())
        except json.JSONDecodeError:
            pass  # of a run that was killed
    done, _ = run([program, path, "--run-on", RUN_ON, "-j", threads, "--format", "json", "-q"])
    if done.returncode not in (0, 6):
        raise RuntimeError(f"pgbox-stats, exit {done.returncode}: {without_paths(done.stderr.strip())}")
    result = json.loads(done.stdout)
    kept.write_text(json.dumps(result, indent=1) + "\n")
    return result


def bell(values):
    """a of the least-squares 1 + a cos(2 theta) through the overlaps by polar angle, each bin weighted by sin(theta): its
    counting noise. Above 0: the peak is at the vertical, a bell."""
    above = below = 0
    for k, value in enumerate(values):
        theta = math.radians(90 / len(values) * (k + 0.5))
        above += math.sin(theta) * math.cos(2 * theta) * (value - 1)
        below += math.sin(theta) * math.cos(2 * theta)**2
    return above / below


def seam(stats):
    """The largest difference between the box's faces across z and its inside, in standard errors, of solid fraction,
    coordination number and overlap."""
    across = stats["seam"]["z"]
    return max(abs(across[key]["z_score"]) for key in ("solid_volume_fraction", "coordination_number",
                                                       "mean_overlap_ratio"))


def figures(made, stats):
    """What the tables show of a box."""
    return {"particle_count": stats["particle_count"], "solid_volume_fraction": stats["solid_volume_fraction"],
            "coordination_number": stats["coordination_number"],
            "coordination_number_no_rattlers": stats["coordination_number_no_rattlers"],
            "relative_standard_deviation": stats["relative_standard_deviation"],
            "counting_noise": stats["counting_noise"], "kurtosis": stats["kurtosis"],
            "bell": bell(stats["overlap_by_polar_angle"]),
            "total_overlap": stats["mean_overlap_ratio"] * stats["mean_radius"] * stats["contact_count"],
            "unbalanced_force": stats["unbalanced_force"], "pressure": stats["pressure"],
            "seam": seam(stats), "uniform": stats["seam"]["uniform"], "crystalline": stats["crystalline"],
            "drift": stats["run_on"]["max_displacement_ratio"], "quasi_static": stats["run_on"]["quasi_static"],
            "wall_time": made["wall_time"]}
