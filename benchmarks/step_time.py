"""Time per point and step of the parts of the step, one core, warm: `python benchmarks/step_time.py`.

A square (or cube) of points with small random velocities moves freely; for Cam-Clay it is sheared so that every
row of the law flows. Processor time, so that other work on the machine disturbs little; medians of five.
"""

import argparse
import time

import numpy as np
from mpi4py import MPI
from verification_cases.common import DEFAULT

from periporo.core.scene.build import build
from periporo.io.schema.scene import parse_scene

MATERIALS = {
    "elastic": {"model": "elastic", "density": 1760.0, "bulk_modulus": 25e6, "shear_modulus": 15e6},
    "cam_clay": {
        "model": "cam_clay", "grain_density": 2200.0, "porosity": 0.2, "bulk_modulus": 25e6, "shear_modulus": 15e6,
        "critical_state_slope": 1.1, "compression_index": 0.12, "swelling_index": 0.04, "preconsolidation": 1000.0,
    },
}  # fmt: skip


SCHEMES = {
    "default": DEFAULT, "point_state": "point_state", "bond_projected": "bond_projected", "standard": "standard",
}  # fmt: skip
CASES = [
    (2, 40, "elastic", ("default", "point_state", "bond_projected", "standard")),
    (2, 200, "elastic", ("default", "point_state", "bond_projected", "standard")),
    (2, 40, "cam_clay", ("default", "bond_projected")), (2, 200, "cam_clay", ("default", "bond_projected")),
    (3, 20, "elastic", ("default", "point_state", "bond_projected")), (3, 40, "elastic", ("default",)),
    (3, 20, "cam_clay", ("default", "bond_projected")),
]  # fmt: skip


def block(dimension, side, material, horizon=2.2, scheme=SCHEMES["default"]):
    """A started simulation of side**dimension points, spacing 1 m."""
    scene = {
        "dimension": dimension, "spacing": 1.0, "horizon": horizon, "correspondence": scheme,
        "materials": {"soil": MATERIALS[material]},
        "bodies": [{"name": "block", "material": "soil",
                    "shape": {"type": "box", "lower": [0.0] * dimension, "upper": [float(side)] * dimension}}],
        "initial_stress": {"type": "uniform", "components": {"xx": -500.0, "yy": -500.0, "zz": -500.0}},
        "stages": [{"name": "free", "type": "dynamics", "duration": 1.0}],
    }  # fmt: skip
    sim = build(parse_scene(scene), MPI.COMM_SELF)
    sim.start()
    return sim


def shear(sim, rate=0.01):
    """Velocities of simple shear, strong enough to make every bond flow."""
    p = sim.particles
    p.velocity[:] = 0.0
    p.velocity[:, 0] = rate * p.position[:, 1]


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


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--steps", type=int, default=100)
    parser.add_argument("--parts", action="store_true", help="also print the parts of the step")
    arguments = parser.parse_args()
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


if __name__ == "__main__":
    main()
