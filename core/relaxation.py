"""Quasi-static relaxation by FIRE (Bitzek et al. 2006) on the simulation's own time step.

Velocities are steered towards the out-of-balance force while they do positive work on it, and stopped when they
do not. `benchmarks/relaxation.py` compares it with viscous and kinetic damping.
"""

import math

import numpy as np

from periporo.core.energy import WORK
from periporo.core.reductions import exact_sum

_STEERING, _DECAY, _PATIENCE = 0.1, 0.99, 5
_DAMPING = WORK.index("damping")


class RelaxationError(RuntimeError):
    """Equilibrium was not reached."""


class Relaxation:
    """Drives a simulation to equilibrium; `residual` is ||out-of-balance force|| / ||weight|| over free components."""

    def __init__(self, name: str, tolerance: float, max_steps: int):
        self.name = name
        self.tolerance = tolerance
        self.max_steps = max_steps
        self.residual = math.inf
        self.steps = 0
        self._steering, self._downhill = _STEERING, 0

    def run(self, sim) -> None:
        """Step until `residual` is below the tolerance; time does not advance.

        Raises RelaxationError if there is no weight to compare with, or not enough steps.
        """
        p, time = sim.particles, sim.time
        sim.rate_independent = True
        self._set_velocity(p, np.zeros((p.owned, p.dimension)))
        while not self._in_equilibrium(sim):
            if self.steps == self.max_steps:
                raise RelaxationError(
                    f"stage '{self.name}': out-of-balance force is {self.residual:.3g} of the weight after "
                    f"{self.steps} steps, not {self.tolerance:.3g}; raise max_steps or tolerance, or let the "
                    "body collapse in a dynamics stage if it cannot stand"
                )
            sim.step()
            sim.reset_clock(time)
            self.steps += 1
        self._set_velocity(p, np.zeros((p.owned, p.dimension)))
        sim.rate_independent = False

    def _in_equilibrium(self, sim) -> bool:
        """Measure the residual and steer the velocities."""
        p, n = sim.particles, sim.particles.owned
        free = np.ones((n, p.dimension))
        for motion in sim.prescribed_motions:
            motion.hold_zero(p, free)
        force, velocity = sim.forces.total() * free, p.velocity[:n] * free
        acceleration = force / p.mass[:, None]
        load = p.external_force[:n] * free
        products = [(a * b).sum(axis=1) for a, b in (
            (force, force), (load, load), (force, velocity), (velocity, velocity), (acceleration, acceleration)
        )]  # fmt: skip
        square, weight, power, speed, pull = exact_sum(sim.comm, np.stack(products, axis=1)).tolist()
        if not weight > 0.0:
            raise RelaxationError(f"stage '{self.name}': there is no load, so no scale for equilibrium; set gravity")
        self.residual = math.sqrt(square / weight)
        if power > 0.0:
            self._downhill += 1
            if self._downhill > _PATIENCE:
                self._steering *= _DECAY
            along = self._steering * math.sqrt(speed / pull)
            self._set_velocity(p, (1.0 - self._steering) * velocity + along * acceleration)
        else:
            self._steering, self._downhill = _STEERING, 0
            self._set_velocity(p, np.zeros_like(velocity))
        return self.residual < self.tolerance

    def _set_velocity(self, p, velocity) -> None:
        """Impose velocities (owned, d); the energy that this takes away counts as damping."""
        n = p.owned
        change = (velocity**2).sum(axis=1) - (p.velocity[:n] ** 2).sum(axis=1)
        p.work[:, _DAMPING] += 0.5 * p.mass * change
        p.velocity[:n] = velocity
