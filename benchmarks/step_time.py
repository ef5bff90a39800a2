"""Time per point and step of the parts of the step, one core, warm.

    python -m benchmarks step_time

A square (or cube) of points with small random velocities moves freely; for Cam-Clay it is sheared so that every
row of the law flows. Processor time, so that other work on the machine disturbs little; medians of five.
"""

import time

import numpy as np

from . import option_parser
from .library.blocks import SCHEMES, block, shear

CASES = [
    (2, 40, "elastic", ("default", "point_state", "bond_projected", "standard")),
    (2, 200, "elastic", ("default", "point_state", "bond_projected", "standard")),
    (2, 40, "cam_clay", ("default", "bond_projected")), (2, 200, "cam_clay", ("default", "bond_projected")),
    (3, 20, "elastic", ("default", "point_state", "bond_projected")), (3, 40, "elastic", ("default",)),
    (3, 20, "cam_clay", ("default", "bond_projected")),
]  # fmt: skip


def measure(sim, steps, prepare):
    """Median seconds per point and step of the whole step, and the shares of its parts."""
    figures = []
    for _ in range(5):
        sim.timing.reset()
        began = time.process_time()
        for _ in range(steps):
            prepare(sim)
            sim.step()
        figures.append((time.process_time() - began) / steps / sim.particles.owned)
    parts = {k: v / steps / sim.particles.owned for k, v in sim.timing.seconds.items()}
    return float(np.median(figures)), parts


def main(words=None):
    parser = option_parser(__name__, __doc__)
    parser.add_argument("--steps", type=int, default=100)
    parser.add_argument("--parts", action="store_true", help="also print the parts of the step")
    arguments = parser.parse_args(words)
    print(f"{'case':>12s} {'scheme':>16s} {'points':>8s} {'us per point and step':>22s}")
    for dimension, side, material, scheme in [(*c[:3], scheme) for c in CASES for scheme in c[3]]:
        sim = block(dimension, side, material, scheme=SCHEMES[scheme])
        prepare = shear if material == "cam_clay" else (lambda sim: None)
        measure(sim, 3, prepare)
        steps = max(5, int(arguments.steps * 1600 / sim.particles.owned))
        seconds, parts = measure(sim, steps, prepare)
        print(f"{dimension}D {material:>9s} {scheme:>16s} {sim.particles.owned:8d} {seconds * 1e6:22.3f}", flush=True)
        if arguments.parts:
            print("".join(f"{'':26s}{k:16s} {v * 1e6:8.3f}\n" for k, v in parts.items()))
