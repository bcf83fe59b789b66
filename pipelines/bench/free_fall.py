# SPDX-License-Identifier: GPL-3.0-or-later
"""The same grains let fall in LAMMPS until they rest: what the packing costs that a PG box takes the place of."""
import math
import re

import numpy as np

from harness import Unavailable, mpirun, run
from lammps import HERTZ, INSTALL, material_arguments
from scenes import MATERIAL, rayleigh_step

FRACTION, SPEED = 0.3, 0.3   # solid fraction of the cloud; random speeds up to this, m/s
REST = 0.02                  # rms speed at rest over sqrt(g r), as pgbox-gen's sediment
LIMIT = 15.0                 # s

SCRIPT = """\
units           si
atom_style      sphere
boundary        p p f
newton          off
comm_modify     mode single vel yes
processors      * * 1
read_data       {data}
pair_style      {law} {arguments}
pair_coeff      * *
neighbor        {skin} bin
neigh_modify    every 1 delay 0 check yes
timestep        {step}
fix             gravity all gravity 9.81 vector 0 0 -1
fix             floor all wall/gran {wall} {arguments} zplane 0 NULL
fix             move all nve/sphere
compute         touching all contact/atom
region          inner block INF INF INF INF 0.2 0.8
compute         z all reduce/region inner ave c_touching
compute         speed all reduce avesq vx vy vz
variable        rms equal sqrt(c_speed[1]+c_speed[2]+c_speed[3])
thermo          10000
thermo_style    custom step time v_rms c_z
thermo_modify   flush yes
run             {fall}
fix             rest all halt 500 v_rms < {limit} error continue message no
run             {most}
run             0
print           "AT REST rms $(v_rms) step $(step) time $(time) Z $(c_z)"
"""


def cloud(count, radius, seed=1):
    """Grains on a cubic lattice of this fraction over a square of 1 m, moved at random within their cells: no two
    touch. Positions and velocities."""
    random = np.random.default_rng(seed)
    across = int(1 / (2 * radius * (math.pi / 6 / FRACTION)**(1 / 3)))
    cell = 1 / across
    layers = math.ceil(count / across**2)
    corners = np.stack(np.meshgrid(range(across), range(across), range(layers), indexing="ij"), -1).reshape(-1, 3)
    corners = corners[np.argsort(corners[:, 2], kind="stable")][:count]
    position = (corners + 0.5) * cell + (random.random((count, 3)) - 0.5) * (cell - 2 * radius)
    direction = random.normal(size=(count, 3))
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    return position, direction * SPEED * random.random((count, 1))**(1 / 3), layers * cell


def fall(program, out, radius, count, friction, ranks):
    """Seconds of LAMMPS' two loops, coordination number between 0.2 and 0.8 m above the floor, and whether it rests.
    @throws Unavailable without LAMMPS"""
    if not program:
        raise Unavailable(INSTALL)
    position, velocity, top = cloud(count, radius)
    name = f"free-fall-r{radius:g}"
    material = {**MATERIAL, "friction": friction}
    with open(out / f"{name}.data", "w") as file:
        file.write(f"{name}\n\n{count} atoms\n1 atom types\n\n0 1 xlo xhi\n0 1 ylo yhi\n{-radius} {top + 1} zlo zhi\n")
        file.write("\nAtoms # sphere\n\n")
        rows = np.arange(1, count + 1)
        np.savetxt(file, np.column_stack([rows, np.ones(count), np.full(count, 2 * radius),
                                          np.full(count, material["density"]), position]),
                   fmt="%d %d " + " ".join(["%.17g"] * 5))
        file.write("\nVelocities\n\n")
        np.savetxt(file, np.column_stack([rows, velocity, np.zeros((count, 3))]), fmt="%d " + " ".join(["%.17g"] * 6))
    step = float(rayleigh_step(radius, material))
    down = math.sqrt(2 * top / 9.81) + 0.2
    (out / f"in.{name}").write_text(SCRIPT.format(
        data=f"{name}.data", law=HERTZ, wall=HERTZ.removeprefix("gran/"),
        arguments=material_arguments(HERTZ, material, None, radius, None), skin=0.1 * radius, step=step,
        fall=math.ceil(down / step), most=math.ceil((LIMIT - down) / step), limit=REST * math.sqrt(9.81 * radius)))
    command = [program, "-in", f"in.{name}", "-log", "none"]
    done, foreign = run((mpirun(ranks) if ranks > 1 else []) + command, cwd=out)
    loops = re.findall(r"Loop time of (\S+) on", done.stdout)
    end = re.search(r"^AT REST rms (\S+) step (\S+) time (\S+) Z (\S+)", done.stdout, re.M)
    if done.returncode or len(loops) != 3 or not end:
        errors = [x for x in (done.stdout + done.stderr).splitlines() if "ERROR" in x]
        raise RuntimeError(f"LAMMPS, exit {done.returncode}: {errors[0] if errors else 'no end of the fall'}")
    return {"particle_count": count, "wall_time": sum(map(float, loops[:2])), "steps": int(end[2]), "time": float(end[3]),
            "coordination_number": float(end[4]), "rests": float(end[1]) < REST * math.sqrt(9.81 * radius),
            "ranks": ranks, "foreign": foreign, "law": HERTZ, "friction": friction}
