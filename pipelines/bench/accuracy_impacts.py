# SPDX-License-Identifier: GPL-3.0-or-later
"""Impacts of two spheres, at many phases of the touch within the step: many pairs far apart in one model."""
import math

import numpy as np

from accuracy_run import DEFAULT_STEP, KNOBS, MATERIAL, Model, columns, rayleigh_time, row, sweep

RADIUS = 0.01


def unit(vectors):
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def rms(values):
    return float(np.sqrt(np.mean(np.square(values))))


def hertz_time(speed, radius=RADIUS):
    """Duration of the elastic impact of two equal spheres, s."""
    mass = 4 / 3 * math.pi * radius**3 * MATERIAL["density"] / 2
    stiffness = 4 / 3 * MATERIAL["youngs_modulus"] / (2 * (1 - MATERIAL["poissons_ratio"] ** 2)) * math.sqrt(radius / 2)
    return 2.9432752 * (5 * mass * speed**2 / (4 * stiffness)) ** 0.4 / speed


def restitution(nominal, damping, separation):
    """Closed form of the restitution that the dashpot gives, whatever speed, size and stiffness."""
    log = math.log(nominal)
    alpha = (math.log(2 / nominal - 1) / 2.2 if damping == "paper"
             else -math.sqrt(5) * log / math.sqrt(log**2 + math.pi**2))
    if separation == "tension":
        return math.exp(-math.pi * alpha / math.sqrt(5 - alpha**2))
    zeta = alpha / math.sqrt(5)
    omega = math.sqrt(1 - zeta**2)
    angle = math.atan2(2 * zeta * omega, 2 * zeta**2 - 1)
    return math.exp(-zeta * angle / omega) * abs(math.cos(angle) - zeta / omega * math.sin(angle))


def pairs(normal, radii, velocity, spins, lead, duration):
    """Pairs that touch along `normal` after `lead` seconds; row 2k and 2k+1 are pair k. The sites are so far apart
    that no pair can reach another: speeds only fall."""
    at_touch = np.stack([-normal * radii[0], normal * radii[1]], axis=1)
    offset = at_touch - velocity * lead[:, None, None]
    reach = np.linalg.norm(offset, axis=2) + np.linalg.norm(velocity, axis=2) * duration + max(radii)
    side = math.ceil(len(normal) ** (1 / 3))
    k = np.arange(len(normal))
    sites = np.stack([k % side, k // side % side, k // side**2], axis=1) * 2.5 * reach.max()
    return Model(position=(sites[:, None, :] + offset).reshape(-1, 3), radius=np.tile(radii, len(normal)),
                 velocity=velocity.reshape(-1, 3), angular_velocity=spins.reshape(-1, 3))


def leads(phases, groups, dt):
    """Times to touch: every group of pairs touches at all phases of the step."""
    return np.repeat((2 + (np.arange(phases) + 0.5) / phases)[:, None], groups, axis=1).ravel() * dt


def collide(engine, model, scene, change, step):
    run = engine.run(model, scene, change, step)
    if run.result["contacts_per_particle"] > 0:
        raise SystemExit("impacts are not over at the end of the run: give them more time")
    return run


def head_on(engine, steps, quick):
    phases = 16 if quick else 128
    speeds = np.array([0.01, 0.03, 0.1, 0.3, 1.0, 3.0])
    speed = np.tile(speeds, phases)
    normal = unit(np.random.default_rng(1).normal(size=(len(speed), 3)))

    def evaluate(curve, change, step):
        runs, errors, by_speed = [], {}, {}
        dt = step * rayleigh_time(RADIUS, MATERIAL)
        duration = 3 * dt + 4 * hertz_time(speeds[0])
        velocity = np.stack([normal, -normal], axis=1) * speed[:, None, None] / 2
        model = pairs(normal, (RADIUS, RADIUS), velocity, np.zeros_like(velocity), leads(phases, len(speeds), dt),
                      duration)
        contact = {"damping": "paper", "separation": "tension", **change.get("contact", {})}
        everything = []
        for nominal in (0.2, 0.5, 0.9):
            scene = {"gravity": [0, 0, 0], "material": {**MATERIAL, "restitution": nominal, "friction": 0},
                     "time": {"end": duration}}
            runs.append(collide(engine, model, scene, change, step))
            relative = runs[-1].velocity[1::2] - runs[-1].velocity[::2]
            error = ((relative * normal).sum(axis=1) / speed
                     - restitution(nominal, **contact)).reshape(phases, len(speeds))
            everything.append(error)
            errors[f"mean, e = {nominal}"] = error.mean()
            errors[f"rms, e = {nominal}"] = rms(error)
            by_speed[str(nominal)] = {str(v): rms(error[:, k]) for k, v in enumerate(speeds)}
        errors["rms"] = rms(np.array(everything))
        errors["largest"] = np.abs(everything).max()
        return row(curve, step, errors, runs, rms_by_restitution_and_speed=by_speed)

    rows = sweep([(curve, change, steps) for curve, change in KNOBS.items()], evaluate)
    return {"name": "restitution", "title": "Restitution of a head-on impact",
            "note": f"Two spheres meet at {speeds[0]:g} to {speeds[-1]:g} m/s, at {phases} phases of the step each. "
                    "Absolute error of the coefficient of restitution against its closed form, over all speeds and "
                    "phases. Run times are those of the three nominal restitutions together.",
            "rows": rows, "plot": "rms", "plot_label": "rms error of the restitution",
            "defaults": [("rms", None, "none: exact solution"), ("largest", None, "none: exact solution")]}


STICK, SLIP = "both, rms, sticking at touch", "both, rms, slipping at touch"


def oblique(engine, steps, quick):
    phases, speed, radii = (8 if quick else 64), 1.0, (RADIUS, 0.8 * RADIUS)
    finest, reference_phases = (0.0025, 4) if quick else (0.000625, 8)
    kinds = [(angle, spin) for angle in (10, 30, 50, 70) for spin in (0, 1, 2)]
    draw = np.random.default_rng(2)
    normal = unit(draw.normal(size=(len(kinds), 3)))
    along = unit(np.cross(normal, draw.normal(size=normal.shape)))
    angle = np.radians([kind[0] for kind in kinds])[:, None]
    towards = speed * (np.cos(angle) * normal + np.sin(angle) * along)
    velocity = np.stack([towards, -towards], axis=1) / 2
    # without spin, rolling backwards about the third axis, spinning about all three
    size = speed / RADIUS
    spins = size * np.stack([np.stack([0 * n, 0 * n] if kind[1] == 0 else
                                      [-0.5 * np.cross(n, t), 0.3 * np.cross(n, t)] if kind[1] == 1 else
                                      [0.3 * n + 0.4 * t, -0.5 * n + 0.3 * np.cross(n, t)])
                             for kind, n, t in zip(kinds, normal, along)])

    # Dashpots rule the first instant of touch: the contact slips from there where theirs exceeds the slider's force.
    turning = np.cross(radii[0] * spins[:, 0] + radii[1] * spins[:, 1], normal)
    surface = towards - np.cos(angle) * speed * normal + turning
    ratio = math.sqrt(3 * (1 - MATERIAL["poissons_ratio"]) / (2 - MATERIAL["poissons_ratio"]))
    slips = ratio * np.linalg.norm(surface, axis=1) > MATERIAL["friction"] * speed * np.cos(angle[:, 0])

    def outcome(change, step, phases):
        """Velocities and spins (as surface speeds) after the impact, by phase and kind, over the speed of impact."""
        dt = step * rayleigh_time(radii[1], MATERIAL)
        duration = 3 * dt + 2.5 * hertz_time(speed * math.cos(math.radians(70)))
        many = lambda values: np.tile(values, (phases, 1, 1))
        model = pairs(np.tile(normal, (phases, 1)), radii, many(velocity), many(spins),
                      leads(phases, len(kinds), dt), duration)
        scene = {"gravity": [0, 0, 0], "material": {**MATERIAL, "restitution": 0.5}, "time": {"end": duration}}
        run = collide(engine, model, scene, change, step)
        surface = run.angular_velocity * model.radius[:, None]
        shape = (phases, len(kinds), 2, 3)
        return run, run.velocity.reshape(shape) / speed, surface.reshape(shape) / speed

    references = {}

    def reference(change):
        """The same physics at a very small step; its spread over phases is what it is worth."""
        physics = {"contact": change["contact"]} if "contact" in change else {}
        key = str(physics)
        if key not in references:
            _, v, w = outcome(physics, finest, reference_phases)
            v0, w0 = v.mean(axis=0), w.mean(axis=0)
            references[key] = v0, w0, math.sqrt(3) * rms([v - v0, w - w0])
        return references[key]

    specialised = {}

    def evaluate(curve, change, step):
        run, v, w = outcome(change, step, phases)
        v0, w0, known = reference(change)
        ev, ew = np.linalg.norm(v - v0, axis=-1), np.linalg.norm(w - w0, axis=-1)
        errors = {"velocity, rms": rms(ev), "velocity, largest": ev.max(),
                  "spin, rms": rms(ew), "spin, largest": ew.max(),
                  STICK: rms([ev[:, ~slips], ew[:, ~slips]]), SLIP: rms([ev[:, slips], ew[:, slips]])}
        if curve == "double":
            specialised[step] = v, w
        elif step in specialised and "contact" not in change:
            errors["difference from double"] = max(np.abs(v - specialised[step][0]).max(),
                                                   np.abs(w - specialised[step][1]).max())
        return row(curve, step, errors, [run], reference_known_to=known)

    rows = sweep([(curve, change, steps) for curve, change in KNOBS.items()], evaluate)
    orders = []
    for curve in KNOBS:
        fine = [r for r in rows if r["curve"] == curve and r.get("step_fraction", 1) <= DEFAULT_STEP]
        if len(fine) > 1:
            x = np.log([r["step_fraction"] for r in fine])
            slopes = [np.polyfit(x, np.log([r["errors"][k] for r in fine]), 1)[0] for k in (STICK, SLIP)]
            orders.append(f"{curve} {slopes[0]:.2f} and {slopes[1]:.2f}")
    known = max((r["reference_known_to"] for r in rows if "errors" in r), default=0)
    return {"name": "oblique", "title": "Oblique impact with friction and spin",
            "note": f"{len(kinds)} impacts at {speed:g} m/s, 10 to 70 degrees from head-on, with and without spin, "
                    f"friction 0.4, nominal restitution 0.5, at {phases} phases of the step each, against the same "
                    f"at a step of {finest:g} (mean over {reference_phases} phases, about which they scatter by "
                    f"{known:.1e}). Velocities and surface speeds of spin over the speed of impact. In "
                    f"{slips.sum()} impacts the contact slips from the first touch. Observed order of convergence "
                    f"up to the default step, sticking and slipping at touch: {'; '.join(orders) or 'too few points'}.",
            "rows": rows, "plot": SLIP,
            "plot_label": "rms error of velocities and spins, slipping at touch",
            "defaults": [(name, None, "none: converged solution")
                         for name in columns(rows, "errors") if name != "difference from double"]}
