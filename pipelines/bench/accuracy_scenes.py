# SPDX-License-Identifier: GPL-3.0-or-later
"""Scenes of many grains: elastic gas and crystal, a packing settled on a floor, a column that collapses."""
import math

import numpy as np

from accuracy_run import DEFAULT_STEP, KNOBS, MATERIAL, Model, row, sweep

RADIUS = 0.01  # the largest
DIAMETER = 2 * RADIUS
SOIL = {**MATERIAL, "density": 2400.0, "youngs_modulus": 1e7}
SKINS = (0.05, 0.15, 0.4)


# Energy -----------------------------------------------------------------------------------------------------------

def lattice(counts, spacing, basis=((0, 0, 0),)):
    cells = np.stack(np.meshgrid(*[np.arange(n) for n in counts], indexing="ij"), axis=-1).reshape(-1, 1, 3)
    return ((cells + np.array(basis)) * spacing).reshape(-1, 3)


def elastic(engine, steps, quick):
    sphere = math.pi / 6 * DIAMETER**3
    face_centred = ((0, 0, 0), (0.5, 0.5, 0), (0.5, 0, 0.5), (0, 0.5, 0.5))
    gas_cell, crystal_cell = (sphere / 0.3) ** (1 / 3), (4 * sphere / 0.78) ** (1 / 3)
    cases = {"gas": (lattice([8] * 3, gas_cell), 8 * gas_cell, 1.0, 1.0),
             "crystal": (lattice([5] * 3, crystal_cell, face_centred), 5 * crystal_cell, 0.1, 0.5)}

    def evaluate(curve, change, step):
        position, edge, speed, duration = cases[curve.split(",")[0]]
        duration /= 20 if quick else 1
        velocity = np.random.default_rng(3).normal(size=position.shape)
        velocity -= velocity.mean(axis=0)
        velocity *= speed / math.sqrt((velocity**2).sum(axis=1).mean())
        scene = {"gravity": [0, 0, 0], "material": {**MATERIAL, "restitution": 1, "friction": 0},
                 "box": {"lower": [0, 0, 0], "upper": [edge] * 3, "periodic": [True] * 3},
                 "time": {"end": duration}, "output": {"series_interval": duration / 200}}
        run = engine.run(Model(position, np.full(len(position), RADIUS), velocity), scene, change, step)
        time, kinetic = run.series["time"], run.series["kinetic_energy"]
        off = (kinetic + run.series["elastic_energy"]) / kinetic[0]
        off -= off[0]
        drift = np.polyfit(time, off, 1)[0] * duration
        momentum = np.linalg.norm(run.velocity.mean(axis=0)) / speed
        return row(curve, step, {"largest": np.abs(off).max(), "rms": math.sqrt((off**2).mean()), "trend": drift,
                                 "momentum": momentum}, [run])

    plan = [(f"{case}, {knob}", KNOBS[knob], chosen)
            for knob, chosen in (("double", steps), ("mixed", steps[1:]), ("reference kernel", [DEFAULT_STEP]))
            for case in cases]
    rows = sweep(plan, evaluate)
    return {"name": "energy", "title": "Energy of elastic spheres",
            "note": "Restitution 1, no friction, periodic box. Gas: 512 spheres, solid fraction 0.3, rms speed 1 m/s"
                    f", {0.05 if quick else 1:g} s; crystal: 500 spheres, face-centred, compressed to 0.78, 0.1 m/s, "
                    f"{0.025 if quick else 0.5:g} s. Energy error over the kinetic energy at the start; the trend is "
                    "the slope of its best line times the run's duration; momentum is the mean velocity at the end "
                    "over the rms speed.",
            "rows": rows, "plot": "largest", "plot_label": "largest energy error / kinetic energy",
            "defaults": [("largest", None, "none: exact law"), ("trend", None, "none: exact law")],
            "default_curves": [f"{case}, double" for case in cases]}


# Scenes with a statistical spread ---------------------------------------------------------------------------------

def sizes(draw, count):
    return draw.uniform(0.82 * RADIUS, RADIUS, count)


def column_of_grains(draw, count, width, depth, bottom):
    """A loose regular start, periodic over `depth`, as high as it takes."""
    nx, ny = int(width / (1.1 * DIAMETER)), int(depth / (1.1 * DIAMETER))
    layers = math.ceil(count / (nx * ny))
    k = np.arange(nx * ny * layers)[:count]
    position = np.stack([(k % nx + 0.5) * width / nx, (k // nx % ny + 0.5) * depth / ny,
                         bottom + (k // (nx * ny) + 0.5) * 1.1 * DIAMETER], axis=1)
    return Model(position, sizes(draw, count), draw.normal(scale=0.2, size=position.shape))


def spread_of(rows, names):
    """Standard deviation between seeds, pooled over the steps of the default settings."""
    groups = [r for r in rows if r["curve"] == "double" and len(r["by_seed"]) > 1]
    return {name: math.sqrt(np.mean([np.var([s[name] for s in r["by_seed"]], ddof=1) for r in groups]))
            for name in names}


def compare(engine, steps, seeds, models, scene, measure, names):
    """Sweeps of a chaotic scene. Errors are differences of the mean over seeds from that at the smallest step."""
    skins = {}

    def evaluate(curve, change, step):
        chosen = seeds if "skin" not in change else 1
        runs = [engine.run(models[k], scene, change, step) for k in range(chosen)]
        by_seed = [measure(run, models[k]) for k, run in enumerate(runs)]
        values = {name: float(np.mean([s[name] for s in by_seed])) for name in by_seed[0]}
        out = row(curve, step, {}, runs, values=values, by_seed=by_seed)
        if "skin" in change:
            first = skins.setdefault("run", runs[0])
            out["same_bits"] = runs[0].same_bits(first)
        return out

    plan = [("double", {}, steps), ("mixed", KNOBS["mixed"], steps[1:])]
    plan += [(knob, KNOBS[knob], [DEFAULT_STEP]) for knob in ("exact damping", "no-tension", "reference kernel")]
    plan += [(f"skin {skin}", {"skin": skin}, [DEFAULT_STEP]) for skin in SKINS]
    rows = sweep(plan, evaluate)
    done = [r for r in rows if "values" in r]
    reference, spread = done[0], spread_of(done, names)
    for r in done:
        if r is not reference and not r["curve"].startswith("skin"):
            r["errors"] = {name: r["values"][name] - reference["values"][name] for name in names}
    tried = [r for r in done if "same_bits" in r]
    if not tried:
        verdict = "This build has no list skin to choose."
    elif all(r["same_bits"] for r in tried):
        verdict = (f"With list skins of {', '.join(map(str, SKINS))} of the largest radius the last frame has the "
                   "same bits.")
    else:
        verdict = "THE RESULT DEPENDS ON THE LIST SKIN: the last frames differ."
    noise = math.sqrt(2 / seeds)
    deviations = ", ".join(f"{spread[n]:.2g} ({n})" for n in names)
    text = (f"Means over {seeds} seeds; differences are those from the mean at the smallest step. The standard "
            f"deviation between seeds is {deviations}; two means differ by {noise:.2f} of it by chance. What exact "
            "damping and no-tension change is physics, not error. " + verdict)
    return rows, text, [(n, noise * spread[n], f"chance, from {seeds} seeds") for n in names]


def late(run, name):
    """Mean over the last fifth of the run."""
    values = run.series[name]
    return float(values[-max(1, len(values) // 5):].mean())


def settled(engine, steps, quick):
    count, seeds, width, duration = (200, 2, 6 * DIAMETER, 0.4) if quick else (1500, 3, 12 * DIAMETER, 1.0)
    models = [column_of_grains(np.random.default_rng(10 + k), count, width, width, 0) for k in range(seeds)]
    scene = {"material": SOIL, "walls": [{"name": "floor", "plane": {"point": [0, 0, 0], "normal": [0, 0, 1]}}],
             "box": {"lower": [0, 0, -width], "upper": [width, width, 10 * width], "periodic": [True, True, False]},
             "time": {"end": duration}, "output": {"series_interval": duration / 100}}

    def measure(run, model):
        weight = 4 / 3 * math.pi * (model.radius**3).sum() * SOIL["density"] * 9.81
        return {"coordination number": late(run, "coordination_number"),
                "mean height / d": float(run.position[:, 2].mean() / DIAMETER),
                "floor force / weight - 1": abs(late(run, "walls/floor/force_z")) / weight - 1,
                "unbalanced force": run.result["unbalanced_force"], "energy error": run.result["energy_error"]}

    names = ["coordination number", "mean height / d"]
    rows, text, yardstick = compare(engine, steps, seeds, models, scene, measure, names)
    return {"name": "settled", "title": "Packing settled on a floor",
            "note": f"{count} grains, radii 0.82 to 1 of the largest, friction 0.4, fall onto a frictional floor in a "
                    f"periodic column and come to rest; {duration:g} s. {text}",
            "rows": rows, "plot": names[0], "plot_label": "difference of the coordination number",
            "defaults": yardstick, "noise": yardstick[0][1]}


def collapse(engine, steps, quick):
    count, seeds, duration = (250, 2, 0.3) if quick else (2200, 3, 1.0)
    half = (4 if quick else 9) * DIAMETER  # of the column's width
    depth = (3 if quick else 5) * DIAMETER
    draw = np.random.default_rng(20)
    grains = column_of_grains(draw, count, 2 * half, depth, RADIUS)
    grains.position[:, 0] -= half
    floor = lattice([int(12 * half / DIAMETER), int(depth / DIAMETER), 1], DIAMETER)
    floor[:, 0] -= 6 * half - RADIUS
    floor[:, 1] += RADIUS
    floor[:, 2] = draw.uniform(-1.3 * RADIUS, -0.7 * RADIUS, len(floor))

    def with_floor(position, velocity):
        still = np.zeros(floor.shape)
        return Model(np.concatenate([position, floor]), np.concatenate([grains.radius, np.full(len(floor), RADIUS)]),
                     np.concatenate([velocity, still]), species=np.repeat([0, 1], [count, len(floor)]).astype(np.uint8))

    top = 2 * grains.position[:, 2].max()
    scene = {"material": SOIL, "time": {"end": duration}, "output": {"series_interval": duration / 100},
             "box": {"lower": [-8 * half, 0, -3 * RADIUS], "upper": [8 * half, depth, top],
                     "periodic": [False, True, False]},
             "walls": [{"name": "floor", "plane": {"point": [0, 0, -2.5 * RADIUS], "normal": [0, 0, 1]}}]}
    sides = [{"name": name, "plane": {"point": [x, 0, 0], "normal": [-x / half, 0, 0]}, "material": {"friction": 0}}
             for name, x in (("left", -half), ("right", half))]
    column = {**scene, "walls": scene["walls"] + sides, "time": {"end": 0.3 if quick else 0.8},
              "damping": {"viscous": 2}}
    packed = engine.run(with_floor(grains.position, grains.velocity), column, {}, DEFAULT_STEP).position[:count]
    height = np.quantile(packed[:, 2], 0.99) + RADIUS
    # small pushes that chaos makes large: the spread between runs that ought to be alike
    models = [with_floor(packed, np.random.default_rng(30 + k).normal(scale=0.01, size=packed.shape))
              for k in range(seeds)]

    def measure(run, model):
        x, z = run.position[:count, 0], run.position[:count, 2]
        return {"runout / L0": float(np.quantile(np.abs(x), 0.99) / half - 1),
                "mean height / d": float(z.mean() / DIAMETER), "rms speed, m/s": run.result["rms_speed"],
                "energy error": run.result["energy_error"]}

    names = ["runout / L0", "mean height / d"]
    rows, text, yardstick = compare(engine, steps, seeds, models, scene, measure, names)
    return {"name": "collapse", "title": "Collapse of a column",
            "note": f"{count} grains settled between two smooth walls at a half-width L0 of {half / DIAMETER:g} d, "
                    f"{depth / DIAMETER:g} d deep (periodic), height {height / half:.2f} L0, on a floor of fixed "
                    f"grains; the walls go and the column flows for {duration:g} s. Runout: distance within which 99 % "
                    "of the grains lie from the middle, over L0, less 1 (experiments find 1.2 to 2.2 times the height "
                    f"over L0). Seeds are pushes of 1 cm/s. {text}",
            "rows": rows, "plot": names[0], "plot_label": "difference of the runout / L0",
            "defaults": yardstick, "noise": yardstick[0][1]}
