# SPDX-License-Identifier: GPL-3.0-or-later
"""The scenes that are timed. A scene is a model file, dem-run's settings and the same particles as arrays; models are
kept in the output folder and made once."""
import gzip
import pathlib

import h5py
import numpy as np

import boxes
from harness import Unavailable, note

ROOT = pathlib.Path(__file__).resolve().parents[2]
SETTLED = ROOT / "data-samples" / "settled-50k" / "settled-50k.csv.gz"
GRAIN, FIXED = 0, 1
MATERIAL = {"density": 1000, "youngs_modulus": 1e8, "poissons_ratio": 0.2, "restitution": 0.2, "friction": 0.4}


def rayleigh_step(radius, material, fraction=0.2):
    shear = material["youngs_modulus"] / (2 * (1 + material["poissons_ratio"]))
    return fraction * np.pi * radius * np.sqrt(material["density"] / shear) / (
        0.1631 * material["poissons_ratio"] + 0.8766)


# Models -----------------------------------------------------------------------------------------------------------

def write_model(path, particles):
    """The smallest model another program may write."""
    half = path.with_suffix(".part")
    with h5py.File(half, "w") as file:
        for name, values in particles.items():
            file[f"particles/all/{name}"] = values
        granular = file.create_group("granular")
        granular.attrs["kind"] = "model"
        granular.attrs["complete"] = 1
    half.rename(path)


def read_particles(path):
    """Columns of a model, or of a trajectory's last frame."""
    particles = {}
    with h5py.File(path, "r") as file:
        group = file["particles/all"]
        for name in ("position", "velocity", "angular_velocity", "radius", "species"):
            if name not in group:
                continue
            item = group[name]
            moving = isinstance(item, h5py.Group)
            particles[name] = item["value"][-1] if moving else item[()]
            if name == "position":
                origin = item.attrs.get("origin", np.zeros(3))
                particles[name] = particles[name].astype(float) + origin
    return particles


def scene(out, name, settings, make):
    """The scene of this name; `make()` gives its particles where the model is not there yet."""
    path = out / f"{name}.model.h5"
    if not path.exists():
        write_model(path, make())
    particles = read_particles(path)
    return {"name": name, "model": path, "settings": settings, "particles": particles,
            "count": len(particles["radius"])}


def warmed(dem, cold, steps, threads):
    """A scene that has run for `steps`: positions, velocities and spins of the last frame. The model format has no
    place for tangential history, so contacts start anew, in a packing that moves as a running one does."""
    def make():
        note(f"  warming {cold['name']}: {steps} steps")
        trajectory = dem.out / f"{cold['name']}.traj.h5"
        dem.once(cold, steps, threads, keep=trajectory)
        last = {**cold["particles"], **read_particles(trajectory)}
        trajectory.unlink()
        trajectory.with_suffix(".xdmf").unlink(missing_ok=True)
        return last
    return scene(dem.out, f"{cold['name']}-warm{steps}", cold["settings"], make)


# The settled packing ----------------------------------------------------------------------------------------------

def read_settled():
    with gzip.open(SETTLED, "rt") as file:
        columns = np.loadtxt(file, delimiter=",", skiprows=1)
    return {"position": columns[:, 0:3].copy(), "radius": columns[:, 3].copy(), "velocity": columns[:, 4:7].copy()}


def settled_settings(width=(0.6, 0.6)):
    return {"gravity": [0, 0, -9.81], "material": dict(MATERIAL),
            "box": {"lower": [0, 0, 0], "upper": [width[0], width[1], 1.2], "periodic": [True, True, False]},
            "walls": [{"name": "floor", "plane": {"point": [0, 0, 0], "normal": [0, 0, 1]}}],
            "time": {"step": 3.385e-5}}


def settled(out):
    return scene(out, "settled-50k", settled_settings(), read_settled)


def copies(out, one, nx, ny):
    """The settled packing nx by ny times in its periodic directions."""
    width = np.array(one["settings"]["box"]["upper"]) * [1, 1, 0]

    def make():
        shifts = [np.array([i, j, 0]) * width for i in range(nx) for j in range(ny)]
        tiled = {name: np.concatenate([values] * len(shifts)) for name, values in one["particles"].items()}
        tiled["position"] = np.concatenate([one["particles"]["position"] + shift for shift in shifts])
        return tiled
    return scene(out, f"{one['name']}-{nx}x{ny}", settled_settings((nx * width[0], ny * width[1])), make)


def lowest(out, one, count):
    """The lowest grains of the settled packing: a thinner layer on the same floor."""
    def make():
        kept = np.sort(np.argsort(one["particles"]["position"][:, 2], kind="stable")[:count])
        return {name: values[kept] for name, values in one["particles"].items()}
    return scene(out, f"{one['name']}-lowest{count}", one["settings"], make)


# A periodic box like the published frictionless ones ---------------------------------------------------------------

def periodic_box(out, folder, radius, times, threads):
    """A frictionless periodic box of 1 m as pgbox-gen makes it (coordination number 6.25, solid fraction 0.64), `times`
    copies along each direction fitted together; no gravity, friction 0.4 in the run."""
    box = out / f"pl-like-r{radius:g}.pgbox.h5"
    name = f"pl-like-r{radius:g}-{times}x{times}x{times}"

    def make():
        if not box.exists():
            note(f"  packing a periodic box of radius {radius:g}")
            boxes.box(folder, box, threads, route="compress", radius=radius, seed=1)
        packed = read_particles(box)
        corners = np.stack(np.meshgrid(*3 * [np.arange(times)], indexing="ij"), -1).reshape(-1, 3)
        return {"position": (corners[:, None, :] + packed["position"][None]).reshape(-1, 3),
                "radius": np.tile(packed["radius"], len(corners))}

    made = scene(out, name, None, make)
    made["settings"] = {
        "gravity": [0, 0, 0], "material": dict(MATERIAL),
        "box": {"lower": [0, 0, 0], "upper": 3 * [times], "periodic": [True, True, True]},
        "time": {"step": float(rayleigh_step(made["particles"]["radius"].min(), MATERIAL))}}
    return made


# Chutes -----------------------------------------------------------------------------------------------------------

BASE, FLOWING = 2000, 30000
CHUTE_ANGLE = 25.0


def tilted(gravity, degrees):
    angle = np.radians(degrees)
    return [float(gravity * np.sin(angle)), 0.0, float(-gravity * np.cos(angle))]


def bagnold_speed(depth, height, diameter, gravity, degrees):
    """Steady speed at `depth` below the surface of a flow of this height, mu(I) rheology of glass beads (mu_s 0.38,
    mu_2 0.64, I_0 0.28) at solid fraction 0.57: a start that soon flows steadily."""
    slope = np.tan(np.radians(degrees))
    inertial = 0.28 * (slope - 0.38) / (0.64 - slope)
    scale = inertial / diameter * np.sqrt(0.57 * gravity * np.cos(np.radians(degrees)))
    return 2 / 3 * scale * (height**1.5 - np.clip(depth, 0, height)**1.5)


def chute_start(out, one):
    """A slab of the settled packing, away from the layers that the floor makes: its lowest 2,000 grains are fixed and are
    the rough base, the 30,000 above them start with the speed of a steady flow."""
    radius, degrees = 0.01, CHUTE_ANGLE

    def make():
        position = one["particles"]["position"]
        upwards = np.argsort(position[:, 2], kind="stable")
        upwards = upwards[position[upwards, 2] > 0.1][:BASE + FLOWING]
        place = position[upwards].copy()
        base_top = place[BASE, 2]
        place[:, 2] -= base_top
        height = place[:, 2].max()
        velocity = np.zeros_like(place)
        velocity[:, 0] = bagnold_speed(height - place[:, 2], height, 2 * radius, 9.81, degrees)
        velocity += np.random.default_rng(1).normal(0, 0.05, velocity.shape)
        velocity[:BASE] = 0
        species = np.where(np.arange(len(place)) < BASE, FIXED, GRAIN).astype(np.uint8)
        return {"position": place, "radius": np.full(len(place), radius), "velocity": velocity, "species": species}

    settings = {"gravity": tilted(9.81, degrees), "material": dict(MATERIAL),
                "box": {"lower": [0, 0, -0.1], "upper": [0.6, 0.6, 1.2], "periodic": [True, True, False]},
                "time": {"step": 3.385e-5}}
    return scene(out, "chute-start", settings, make)


def linear_chute_start(out, flowing):
    """The public LAMMPS chute benchmark's kind of scene: 32,000 grains of diameter and mass 1, gravity 1 at 26 degrees,
    linear springs. Its own start is not in Debian: the flow above in units of diameter and gravity stands in for it."""
    def make():
        diameter, gravity = 0.02, 9.81
        scaled = {name: values.copy() for name, values in flowing["particles"].items()}
        scaled["position"] /= diameter
        scaled["radius"] /= diameter
        scaled["velocity"] /= np.sqrt(gravity * diameter)
        if "angular_velocity" in scaled:
            scaled["angular_velocity"] *= np.sqrt(diameter / gravity)
        return scaled

    settings = {"gravity": tilted(1, 26.0),
                "material": {**MATERIAL, "friction": 0.5, "density": 6 / np.pi},  # mass 1
                "contact": {"law": "linear", "normal_stiffness": 2000, "tangential_stiffness": 2000 * 2 / 7,
                            "normal_damping": 50, "tangential_damping": 0},
                "box": {"lower": [0, 0, -5], "upper": [30, 30, 60], "periodic": [True, True, False]},
                "time": {"step": 1e-4}}
    return scene(out, "linear-chute-start-" + flowing["name"], settings, make)


def mean_speed(one):
    """Mean velocity down the slope of the grains that move."""
    particles = one["particles"]
    return float(particles["velocity"][particles["species"] == GRAIN, 0].mean())
