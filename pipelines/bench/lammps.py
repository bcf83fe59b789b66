# SPDX-License-Identifier: GPL-3.0-or-later
"""The same scenes in LAMMPS: data files, input scripts, and the figures of its log."""
import re
import shutil

import numpy as np

from harness import Unavailable, first_line, mpirun, note, run

INSTALL = "LAMMPS is not installed (Debian: apt-get install lammps): no comparison"
HERTZ, GRANULAR, LINEAR = "gran/hertz/history", "granular", "gran/hooke/history"

SCRIPT = """\
units           {units}
atom_style      sphere
boundary        {boundary}
newton          off
comm_modify     mode single vel yes
processors      * * 1
read_data       {data}
pair_style      {pair_style}
{pair_coeff}
neighbor        {skin} bin
neigh_modify    every 1 delay 0 check yes
{groups}
timestep        {step}
fix             gravity all gravity {magnitude} vector {direction}
{hold}
{wall}
fix             move {mobile} nve/sphere
thermo          1000000
run             {warm}
run             {steps}
"""

DAMPING_PROBE = """\
units si
atom_style sphere
newton off
comm_modify vel yes
region b block 0 1 0 1 0 1
create_box 1 b
create_atoms 1 single 0.5 0.5 0.5
set type 1 diameter 0.02 density 1000
pair_style granular
pair_coeff * * hertz/material 1e8 0.2 0.2 tangential mindlin NULL 1.0 0.4 damping coeff_restitution
fix 1 all nve/sphere
run 0
"""


def material_arguments(law, material, contact, radius, damping):
    """Arguments of a pair or wall style that give this material."""
    if law == LINEAR:
        return f"{contact['normal_stiffness']:g} NULL {contact['normal_damping']:g} NULL {material['friction']:g} 0"
    if law == GRANULAR:
        return (f"hertz/material {material['youngs_modulus']:g} {material['restitution']:g} "
                f"{material['poissons_ratio']:g} tangential mindlin NULL 1.0 {material['friction']:g} damping {damping}")
    nu = material["poissons_ratio"]
    normal = 2 * material["youngs_modulus"] / (3 * (1 - nu**2))
    tangential = normal * 3 * (1 - nu) / (2 - nu)
    # Its damping has another dependence on the overlap than ours: 1.35e7 at r = 1 cm is near restitution 0.2 at a
    # settled packing's overlaps; it goes with 1/r^2 at equal overlap over radius.
    gamma = 1.35e7 * (0.01 / radius)**2
    return f"{normal:.6g} {tangential:.6g} {gamma:.6g} {gamma / 2:.6g} {material['friction']:g} 1"


class Lammps:
    def __init__(self, out):
        self.program, self.out = shutil.which("lmp"), out
        self.damping, self.skins = None, {}

    def version(self):
        return first_line([self.program, "-h"], "LAMMPS|Large-scale") if self.program else None

    def restitution_damping(self):
        """Version 29 Sep 2021 has no `damping coeff_restitution`; `tsuji` is its nearest: the damping number from the
        restitution by a fit, the rest of the law the same."""
        if self.damping is None:
            probe = self.out / "in.probe"
            probe.write_text(DAMPING_PROBE)
            done, _ = run([self.program, "-in", probe.name, "-log", "none"], cwd=self.out)
            self.damping = "tsuji" if done.returncode else "coeff_restitution"
        return self.damping

    def data_file(self, scene):
        path = self.out / f"{scene['name']}.data"
        if path.exists():
            return path
        particles, box = scene["particles"], scene["settings"]["box"]
        n = scene["count"]
        fixed = particles.get("species", np.zeros(n)) == 1
        rows = np.column_stack([np.arange(1, n + 1), 1 + fixed, 2 * particles["radius"],
                                np.full(n, scene["settings"]["material"]["density"]), particles["position"]])
        none = np.zeros((n, 3))
        speeds = np.column_stack([np.arange(1, n + 1), particles.get("velocity", none),
                                  particles.get("angular_velocity", none)])
        half = path.with_suffix(".part")
        with open(half, "w") as file:
            file.write(f"{scene['name']}\n\n{n} atoms\n2 atom types\n\n")
            for axis, low, high in zip("xyz", box["lower"], box["upper"]):
                file.write(f"{low:.17g} {high:.17g} {axis}lo {axis}hi\n")
            file.write("\nAtoms # sphere\n\n")
            np.savetxt(file, rows, fmt="%d %d " + " ".join(["%.17g"] * 5))
            file.write("\nVelocities\n\n")
            np.savetxt(file, speeds, fmt="%d " + " ".join(["%.17g"] * 6))
        half.rename(path)
        return path

    def script(self, scene, law, skin, warm, steps):
        settings, particles = scene["settings"], scene["particles"]
        damping = self.restitution_damping() if law == GRANULAR else None
        arguments = material_arguments(law, settings["material"], settings.get("contact"),
                                       float(particles["radius"].mean()), damping)
        groups, hold, mobile = "", "", "all"
        if "species" in particles:
            groups = "group base type 2\ngroup active subtract all base\nneigh_modify exclude group base base"
            hold, mobile = "fix hold base freeze", "active"
        wall = ""
        if "walls" in settings:
            style = {HERTZ: "hertz/history", GRANULAR: "granular", LINEAR: "hooke/history"}[law]
            wall = f"fix floor {mobile} wall/gran {style} {arguments} zplane 0 NULL"
        gravity = np.array(settings["gravity"], dtype=float)
        magnitude = float(np.linalg.norm(gravity))
        direction = gravity / magnitude if magnitude else np.array([0, 0, -1])
        return SCRIPT.format(
            units="lj" if law == LINEAR else "si", data=self.data_file(scene).name, skin=skin, warm=warm, steps=steps,
            boundary=" ".join("p" if periodic else "f" for periodic in settings["box"]["periodic"]),
            pair_style=law if law == GRANULAR else f"{law} {arguments}",
            pair_coeff=f"pair_coeff * * {arguments}" if law == GRANULAR else "pair_coeff * *",
            groups=groups, step=repr(settings["time"]["step"]), wall=wall, hold=hold, mobile=mobile,
            magnitude=repr(magnitude), direction=" ".join(f"{x:.17g}" for x in direction))

    def timed(self, scene, law, skin, warm, steps, ranks=1):
        """Rate of the second run's loop, after `warm` steps that are not timed."""
        if not self.program:
            raise Unavailable(INSTALL)
        script = self.out / "in.lammps"
        script.write_text(self.script(scene, law, skin, warm, steps))
        command = [self.program, "-in", script.name, "-log", "none"]
        done, foreign = run((mpirun(ranks) if ranks > 1 else []) + command, cwd=self.out)
        loops = re.findall(r"Loop time of (\S+) on (\d+) procs for (\d+) steps with (\d+) atoms", done.stdout)
        if done.returncode or len(loops) != 2:
            errors = [x for x in (done.stdout + done.stderr).splitlines() if "ERROR" in x]
            raise RuntimeError(f"LAMMPS, exit {done.returncode}: {errors[0] if errors else 'no loop time'}")
        seconds, procs, ran, atoms = float(loops[-1][0]), *(int(x) for x in loops[-1][1:])
        if (procs, ran, atoms) != (ranks, steps, scene["count"]):
            raise RuntimeError(f"LAMMPS ran {ran} steps of {atoms} atoms on {procs} ranks, expected {steps} of "
                               f"{scene['count']} on {ranks}")
        builds = re.findall(r"Neighbor list builds = (\d+)", done.stdout)
        dangerous = re.findall(r"Dangerous builds = (\d+)", done.stdout)
        memory = re.findall(r"Per MPI rank memory allocation .* = \S+ \| (\S+) \|", done.stdout)
        return {"rate": atoms * ran / seconds, "loop_time": seconds, "steps": ran, "particle_count": atoms,
                "ranks": ranks, "law": law, "skin": skin, "foreign": foreign, "damping": self.damping,
                "list_rebuilds": int(builds[-1]) if builds else None,
                "dangerous_rebuilds": int(dangerous[-1]) if dangerous else None,
                "bytes_per_particle": float(memory[-1]) * 2**20 * ranks / atoms if memory else None}

    def best_skin(self, scene, law, skins, warm, steps):
        """The fastest of these skins, one short run each."""
        if not self.program:
            raise Unavailable(INSTALL)
        key = (scene["name"], law)
        if key not in self.skins:
            rates = {skin: self.timed(scene, law, skin, warm, steps)["rate"] for skin in skins}
            self.skins[key] = max(rates, key=rates.get)
            note(f"  LAMMPS {law} on {scene['name']}: " + ", ".join(f"skin {s:g}: {r / 1e6:.2f} M/s"
                                                                    for s, r in rates.items()))
        return self.skins[key]
