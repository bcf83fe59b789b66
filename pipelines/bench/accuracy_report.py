# SPDX-License-Identifier: GPL-3.0-or-later
"""Results of the accuracy benchmark as JSON, CSV, Markdown and pictures."""
import csv
import json
import shutil
import subprocess
import sys

from accuracy_run import DEFAULT_STEP, columns, pick


def number(value):
    return "" if value is None else f"{value:.3g}"


def table(heads, lines):
    out = ["| " + " | ".join(heads) + " |", "|" + "---|" * len(heads)]
    return out + ["| " + " | ".join(line) + " |" for line in lines]


def measure_table(measure):
    values, errors = columns(measure["rows"], "values"), columns(measure["rows"], "errors")
    label = "difference: " if values else ""
    heads = ["curve", "step", *values, *(label + name for name in errors), "run time, s", "10^6 particle-steps/s"]
    lines = []
    for r in measure["rows"]:
        if "not_available" in r:
            lines.append([r["curve"], "", "not available"] + [""] * (len(heads) - 3))
            continue
        lines.append([r["curve"], f"{r['step_fraction']:g}", *(f"{r['values'].get(n):.4g}" for n in values),
                      *(number(r["errors"].get(n)) for n in errors), number(r["wall_time"]),
                      number(r["particle_steps_per_second"] / 1e6)])
    return table(heads, lines)


def defaults_table(measures):
    """Errors at the default settings beside what chance alone makes of the same number."""
    lines = []
    for m in measures:
        for curve in m.get("default_curves", ["double"]):
            r = pick(m["rows"], curve)
            for name, yardstick, what in m["defaults"]:
                if r is None or name not in r["errors"]:
                    continue
                error = r["errors"][name]
                ratio = number(abs(error) / yardstick) if yardstick else ""
                case = "" if curve == "double" else f" ({curve.split(',')[0]})"
                lines.append([m["title"] + case, name, number(error), number(yardstick), ratio, what])
    return table(["measure", "quantity", "error", "spread", "error / spread", "the spread is"], lines)


def markdown(results):
    text = ["# Run time against error", "",
            f"{results['program']}, {results['threads']} threads; {results['wall_time'] / 60:.1f} min in all"
            + (", few points and small scenes (--quick)." if results["quick"] else "."),
            "Steps are fractions of the Rayleigh time of the smallest grain; the default is "
            f"{DEFAULT_STEP:g}, double precision, the damping of the paper with its tension at separation."]
    for m in results["measures"]:
        text += ["", f"## {m['title']}", "", m["note"], "", *measure_table(m)]
    text += ["", "## What the defaults cost", "",
             f"Step {DEFAULT_STEP:g}, double precision, damping of the paper. An error below about twice the spread "
             "cannot be told from chance.", "", *defaults_table(results["measures"])]
    return "\n".join(text) + "\n"


def picture(measure, path):
    """One curve a knob, each point with its step."""
    curves = {}
    for r in measure["rows"]:
        error = abs(r.get("errors", {}).get(measure["plot"], 0))
        if error > 0:
            curves.setdefault(r["curve"], []).append((r["wall_time"], error, r["step_fraction"]))
    if not curves:
        return
    lines = ["set terminal svg size 720,480 background rgb 'white' font 'sans,13'",
             "set logscale xy", "set format '%g'", "set grid", "set key outside right top",
             "set offsets graph 0.1, graph 0.1, 0, 0",
             "set xlabel 'run time, s'", f"set ylabel '{measure['plot_label']}'"]
    plots = []
    for k, (curve, points) in enumerate(curves.items()):
        lines += [f"$c{k} << EOD", *(f"{t:.6g} {e:.6g} {s:g}" for t, e, s in points), "EOD"]
        plots.append(f"$c{k} using 1:2 with linespoints lc {k + 1} pt {k + 4} title '{curve}'")
        if len(points) > 1:
            plots.append(f"$c{k} using 1:2:3 with labels offset 0,0.8 font ',9' tc lt {k + 1} notitle")
    if measure.get("noise"):
        plots.append(f"{measure['noise']} with lines dt 2 lc rgb 'gray40' title 'chance'")
    lines.append("plot " + ", ".join(plots))
    done = subprocess.run(["gnuplot"], input="\n".join(lines) + "\n", capture_output=True, text=True)
    if done.returncode != 0:
        sys.exit(f"gnuplot failed: {done.stderr}")
    path.write_text(done.stdout)


def write(results, folder):
    """Writes everything; returns the Markdown."""
    (folder / "accuracy.json").write_text(json.dumps(results, indent=1, default=float) + "\n")
    with open(folder / "accuracy.csv", "w", newline="") as file:
        out = csv.writer(file)
        out.writerow(["measure", "curve", "step_fraction", "kind", "quantity", "value", "wall_time",
                      "particle_steps_per_second"])
        for m in results["measures"]:
            for r in m["rows"]:
                for kind in ("values", "errors"):
                    for name, value in r.get(kind, {}).items():
                        out.writerow([m["name"], r["curve"], r["step_fraction"], kind[:-1], name, float(value),
                                      r["wall_time"], r["particle_steps_per_second"]])
    text = markdown(results)
    if shutil.which("gnuplot"):
        for m in results["measures"]:
            picture(m, folder / f"{m['name']}.svg")
    else:
        print("no pictures: gnuplot is not installed", file=sys.stderr)
    (folder / "accuracy.md").write_text(text)
    return text
