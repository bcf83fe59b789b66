# SPDX-License-Identifier: GPL-3.0-or-later
"""Results of the benchmark of sleep as JSON, Markdown and pictures."""
import json
import pathlib
import shutil

from accuracy_report import number, picture, table
from harness import FOREIGN_LIMIT, note
from sleep_slide import BIN, MEASURES

HEADS = {"moved_volume": ("moved volume, m3", ".4g"), "runout_length": ("runout, m", ".1f"),
         "runout_length_95": ("runout of 95 %, m", ".1f"), "center_of_mass_travel": ("travel of the middle, m", ".2f"),
         "travel": ("travel histogram", ".4f")}


def signed(value, digits=2):
    return "" if value is None else f"{value:+.{digits}f}"


def repose_lines(scene):
    lines = []
    for row in scene["rows"]:
        cells = [f"{row['tolerance']:g}"]
        for name in scene["quantities"]:
            q = row[name]
            deviation = "" if q["deviation"] is None else f" ± {q['deviation']:.2f}"
            cells += [f"{q['mean']:.2f}{deviation}"] + ([signed(q["difference"]), signed(q["in_standard_errors"], 1)]
                                                        if row["tolerance"] else ["", ""])
        audit = (row["audit"] or {}).get("sleep_audit") or {}
        audited = audit.get("particles", 0) > 0
        cells += [f"{row['wall_time']:.1f}", f"{row['speed_up_wall_time']:.2f}", f"{row['speed_up_processor_time']:.2f}",
                  f"{row['asleep_fraction']:.2f}", f"{row['asleep_fraction_at_end']:.2f}",
                  number(row["sleep_error"]) if row["tolerance"] else "",
                  number(audit["wrong_fraction"]) if audited else "", number(audit["mean_move"]) if audited else ""]
        lines.append(cells)
    heads = ["tolerance"]
    for name, unit in scene["quantities"].items():
        heads += [f"{name}, {unit}", "difference", "in standard errors"]
    heads += ["run time, s", "speed-up", "of processor time", "asleep, mean", "at the end", "sleep_error", "audit: wrong",
              "audit: mean move, r"]
    return table(heads, lines)


def slide_lines(slide):
    def cells(what, values, run=None, inside=None):
        cost = ["", "", "", "", ""] if run is None else \
            [f"{run['wall_time']:.1f}", *(f"{run[f'speed_up_{k}']:.2f}" if f"speed_up_{k}" in run else ""
                                          for k in ("wall_time", "processor_time")),
             f"{run['asleep_fraction']:.2f}", number(run["sleep_error"]) if run["tolerance"] else ""]
        shown = [format(values[key], HEADS[key][1]) + ("" if inside is None or inside[key] else " (outside)") if key in values
                 else "" for key in HEADS]
        return [what, *shown, *cost]

    lines = [cells("without sleep" + (", perturbed" if k else ""), {name: run[name] for name in MEASURES}, run)
             for k, run in enumerate(slide["references"])]
    lines.append(cells("their spread", slide["spread"]))
    for run in slide["runs"]:
        differences = {name: run["differences"][name] for name in HEADS}
        lines.append(cells(f"difference at {run['tolerance']:g}", differences, run, run["within_spread"]))
    return table(["", *(head for head, _ in HEADS.values()), "run time, s", "speed-up", "of processor time", "asleep, mean",
                  "sleep_error"], lines)


def verdict_of_repose(scene):
    """Which tolerances leave all measures as they are, by two standard errors; and how far the worst is off."""
    unbiased = [f"{row['tolerance']:g}" for row in scene["rows"][1:]
                if all(row[name]["in_standard_errors"] is not None and abs(row[name]["in_standard_errors"]) < 2
                       for name in scene["quantities"])]
    worst = max((row["angle"]["difference"] for row in scene["rows"][1:]), key=abs, default=0)
    return (f"Largest difference of the angle: {worst:+.2f} degrees (standard error "
            f"{scene['rows'][0]['angle']['standard_error'] or 0:.2f}). All within two standard errors of no sleep: "
            f"tolerance {', '.join(unbiased) or 'none'}.")


def verdict_of_slide(slide):
    lines = []
    for run in slide["runs"]:
        outside = [HEADS[name][0].split(",")[0] for name, inside in run["within_spread"].items() if not inside]
        lines.append(f"* tolerance {run['tolerance']:g}: speed-up {run['speed_up_wall_time']:.2f}; "
                     + ("all within the spread" if not outside else "outside the spread: " + ", ".join(outside)))
    return lines


def markdown(results):
    f = results["machine"]
    text = ["# Sleep: tolerance against error and run time", "",
            f"{results['program']}; {f['processor']}, {f['cores']} cores, {results['threads']} threads; load average before the "
            f"start {f['load_average_before'][0]:.2f}; {results['wall_time'] / 60:.1f} min in all"
            + (", few runs and small scenes (--quick)." if results["quick"] else ".")]
    if results["foreign"] > FOREIGN_LIMIT:
        text += ["", f"**Other programs used up to {results['foreign']:.0%} of the cores meanwhile: run times are too long by that, "
                     "and speed-ups scatter. That of processor time is the steadier one (with several threads it holds what "
                     "they waited for each other); pictures show processor time.**"]
    for scene in results["repose"]:
        text += ["", f"## {scene['title']}", "",
                 f"{scene['grains']:,} grains {scene['text']}, {scene['duration']:.1f} s; means over {scene['seeds']} seeds ± their "
                 "standard deviation. Standard error: of the difference of two such means, deviations pooled over all rows. "
                 "Audited: one more run of the first seed.", "", *repose_lines(scene), "", verdict_of_repose(scene)]
    for slide in results["slides"]:
        text += ["", f"## Slide, {slide['name']}, R = {slide['radius']:g} m", "",
                 f"{slide['grains']:,} grains, {slide['mobile']:,} of them mobile, {slide['released']:,} released; runs without sleep "
                 "differ by 1e-12 of the positions. Spread: largest less smallest; travel histogram: grains in other "
                 f"bins of {BIN:g} m, over those released. A further run without sleep would be outside by chance in "
                 f"{slide['outside_by_chance']:.0%} of the cases, for each measure.", "", *slide_lines(slide), "",
                 *verdict_of_slide(slide)]
    return "\n".join(text) + "\n"


def repose_curves(scene, clock):
    """Differences over their standard error, and the estimates, against run time by that clock."""
    differences, estimates = [], []
    for row in scene["rows"][1:]:
        common = {"step_fraction": row["tolerance"], "wall_time": row[clock]}
        for name in scene["quantities"]:
            if row[name]["standard_error"]:
                differences.append({"curve": name, "errors": {"e": row[name]["in_standard_errors"]}, **common})
        audit = (row["audit"] or {}).get("sleep_audit") or {}
        for curve, value in (("sleep error", row["sleep_error"]), ("audit: wrong fraction", audit.get("wrong_fraction", 0)),
                             ("audit: mean move / r", audit.get("mean_move", 0)), ("angle, relative",
                              row["angle"]["difference"] / scene["rows"][0]["angle"]["mean"])):
            estimates.append({"curve": curve, "errors": {"e": value}, **common})
    return {scene["name"]: {"rows": differences, "plot": "e", "noise": 1,
                     "plot_label": "difference to no sleep / its standard error by chance"},
            f"{scene['name']}_estimates": {"rows": estimates, "plot": "e",
                                           "plot_label": "error estimates and error; labels: tolerance"}}


def slide_curves(slide, clock):
    rows = [{"curve": HEADS[name][0].split(",")[0], "step_fraction": run["tolerance"], "wall_time": run[clock],
             "errors": {"e": run["differences"][name] / slide["spread"][name] if slide["spread"][name] else 0}}
            for run in slide["runs"] for name in HEADS]
    return {f"slide_{slide['name']}": {"rows": rows, "plot": "e", "noise": 1,
                                       "plot_label": "difference to no sleep / spread by rounding"}}


def write(results, folder: pathlib.Path):
    """Writes everything; returns the Markdown."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "sleep.json").write_text(json.dumps(results, indent=1, default=str) + "\n")
    text = markdown(results)
    (folder / "sleep.md").write_text(text)
    # where others use the cores the processor's time tells more
    clock = "processor_time" if results["foreign"] > FOREIGN_LIMIT else "wall_time"
    curves = {}
    for scene in results["repose"]:
        curves |= repose_curves(scene, clock)
    for slide in results["slides"]:
        curves |= slide_curves(slide, clock)
    if shutil.which("gnuplot"):
        for name, measure in curves.items():
            picture(measure, folder / f"{name}.svg")
    else:
        note("no pictures: gnuplot is not installed")
    return text
