"""Steps to equilibrium by FIRE, viscous and kinetic damping.

    python -m benchmarks relaxation [--spacing 2.5e-3]

The column of configs/column_collapse.yaml settles under its weight between rollers until the out-of-balance force
is 1e-4 of the weight: as it is, from a geostatic stress, and as an elastic column that starts without stress.
Viscous damping multiplies velocities by exp(-2 zeta omega dt), omega = pi c_p / (2 H) the first frequency of the
column; kinetic damping stops all points when their kinetic energy has passed a peak (Cundall 1976).
"""

import importlib.resources
import time

import numpy as np
from mpi4py import MPI

from periporo.core.motion.relaxation import Relaxation
from periporo.core.scene.build import build
from periporo.io.input.load import parse_scene
from periporo.io.input.yaml_source import read_yaml

from . import option_parser

TOLERANCE, MOST = 1e-4, 5000
ELASTIC = {"model": "elastic", "density": 1760.0, "bulk_modulus": 25e6, "shear_modulus": 15e6}
FREQUENCY = np.pi / 2.0 * np.sqrt(45e6 / 1760.0) / 0.1


def simulation(spacing, elastic):
    """The column, at the start of its first stage."""
    scene = read_yaml(importlib.resources.files("periporo.configs") / "column_collapse.yaml").data
    scene |= {"spacing": spacing}
    if elastic:
        scene |= {"materials": {"soil": ELASTIC}, "initial_stress": None}
    sim = build(parse_scene({k: v for k, v in scene.items() if v is not None}), MPI.COMM_SELF)
    sim.start()
    stage = sim.stages[0]
    sim.prescribed_motions, sim.contacts, sim.loads = stage.prescribed_motions, stage.contacts, stage.loads
    sim.apply_loads(0.0)
    return sim


def residual(sim):
    """Out-of-balance force over weight, of the components that are free."""
    p, n = sim.particles, sim.particles.owned
    free = np.ones((n, p.dimension))
    for motion in sim.prescribed_motions:
        motion.hold_zero(p, free)
    return np.linalg.norm(sim.forces.total() * free) / np.linalg.norm(p.external_force[:n] * free)


def by_fire(sim):
    """Steps of the program's own relaxation."""
    relaxation = Relaxation("settle", TOLERANCE, MOST)
    relaxation.run(sim)
    return relaxation.steps


def viscous(ratio):
    """Damping of the first vibration by `ratio` of critical."""

    def steps(sim):
        return _braked(sim, lambda: np.exp(-2.0 * ratio * FREQUENCY * sim.dt))

    return steps


def kinetic(safety):
    """Kinetic damping with another share of the stability limit: near it, the fastest vibration makes all peaks."""

    def steps(sim):
        sim.time_step.safety = safety
        return _stopped_at_peaks(sim)

    return steps


def _stopped_at_peaks(sim):
    before = [0.0]

    def factor():
        energy = sim.ledger.kinetic()
        past = energy < before[0]
        before[0] = 0.0 if past else energy
        return 0.0 if past else 1.0

    return _braked(sim, factor)


def _braked(sim, factor):
    """Steps until equilibrium when velocities are multiplied by factor() after each step; MOST if not reached."""
    sim.rate_independent = True
    for step in range(MOST):
        if residual(sim) < TOLERANCE:
            return step
        sim.step()
        sim.reset_clock()
        sim.particles.velocity[: sim.particles.owned] *= factor()
    return MOST


METHODS = {
    "FIRE": by_fire,
    "kinetic": kinetic(0.8),
    "kinetic, half the step": kinetic(0.4),
    "kinetic, quarter step": kinetic(0.2),
    "viscous, 0.25 critical": viscous(0.25),
    "viscous, 0.5 critical": viscous(0.5),
    "viscous, critical": viscous(1.0),
    "viscous, 2 x critical": viscous(2.0),
}


def main(words=None):
    """Print a table."""
    parser = option_parser(__name__, __doc__)
    parser.add_argument("--spacing", type=float, default=2.5e-3, help="m between points")
    spacing = parser.parse_args(words).spacing
    for elastic, title in ((False, "Cam-Clay, geostatic start"), (True, "elastic, unstressed start")):
        print(f"{title}: steps to {TOLERANCE:g}")
        for name, method in METHODS.items():
            sim = simulation(spacing, elastic)
            began = time.perf_counter()
            steps = method(sim)
            reached = f"{steps}" if steps < MOST else f"not within {MOST}"
            print(f"  {name:24} {reached:>16}  {time.perf_counter() - began:8.1f} s", flush=True)
