"""Quasi-static relaxation by FIRE (Bitzek et al. 2006) on the simulation's own time step.

Velocities are steered towards the out-of-balance force while they do positive work on it, and stopped when they
do not. `python -m benchmarks relaxation` compares it with viscous and kinetic damping.
"""

import math

import numpy as np

from periporo.core.numerics.tensors import square_lengths
from periporo.core.points.forces import WORK
from periporo.core.ranks.reductions import exact_sum

STEERING, _DECAY, _PATIENCE = 0.1, 0.99, 5
_LOWER, _HOPE = 0.99, 20_000  # of the least residual, which one that still falls comes below in so many steps
_REMEMBERED = ("_time", "_first_step", "_steering", "_downhill", "_least", "_least_at")
_DAMPING = WORK.index("damping")


class RelaxationError(RuntimeError):
    """Equilibrium was not reached."""


class Relaxation:
    """Drives a simulation to equilibrium; `residual` is ||out-of-balance force|| / ||load|| over free components.

    The load is what acts on free components, mostly weight; without any, the reactions of the held ones and what
    contacts press with.
    """

    def __init__(self, name: str, tolerance: float, max_steps: int):
        self.name = name
        self.tolerance = tolerance
        self.max_steps = max_steps
        self.residual = math.inf
        self.steps = 0
        self._steering, self._downhill = STEERING, 0
        self._time, self._first_step = 0.0, 0
        self._least, self._least_at = math.inf, 0  # residual, and in which step

    def run(self, sim) -> None:
        """Step until `residual` is below the tolerance; time does not advance.

        Raises RelaxationError if there is no load to compare with, or not enough steps, or no use in more.
        """
        self.begin(sim)
        while not self.is_over(sim):
            sim.step()
        self.end(sim)

    def begin(self, sim) -> None:
        """Start from rest."""
        self._time, self._first_step = sim.time, sim.step_number
        self._least, self._least_at = math.inf, sim.step_number
        sim.rate_independent = True
        self._set_velocity(sim.particles, np.zeros((sim.particles.owned, sim.particles.dimension)))

    def is_over(self, sim) -> bool:
        """Whether equilibrium is reached; if not, steer the velocities for the next step."""
        sim.reset_clock(self._time)
        self.steps = sim.step_number - self._first_step
        if self._in_equilibrium(sim):
            return True
        if self.steps == self.max_steps:
            raise RelaxationError(
                f"stage '{self.name}': out-of-balance force is {self.residual:.3g} of the load after "
                f"{self.steps} steps, not {self.tolerance:.3g}; raise max_steps or tolerance, or let the "
                "body collapse in a dynamics stage if it cannot stand"
            )
        if self.residual < _LOWER * self._least:
            self._least, self._least_at = self.residual, sim.step_number
        elif sim.step_number - self._least_at >= _HOPE:
            raise RelaxationError(
                f"stage '{self.name}': out-of-balance force was {self._least:.3g} of the load {_HOPE} steps ago, and "
                f"has never been less, nor {self.tolerance:.3g}: what flies, rattles or slides does not come to rest; "
                "raise tolerance, hold what is loose, or let it move in a dynamics stage"
            )
        return False

    def end(self, sim) -> None:
        """End at rest."""
        self._set_velocity(sim.particles, np.zeros((sim.particles.owned, sim.particles.dimension)))
        sim.rate_independent = False

    def memory(self) -> dict:
        """What a checkpoint keeps."""
        return {name: getattr(self, name) for name in _REMEMBERED}

    def recall(self, sim, memory: dict) -> None:
        """Go on from there."""
        for name in _REMEMBERED:
            setattr(self, name, memory[name])
        sim.rate_independent = True

    def _in_equilibrium(self, sim) -> bool:
        """Measure the residual and steer the velocities."""
        force = self._measure(sim)
        if self.residual < self.tolerance:
            return True
        self._steer(sim, force)
        return False

    def _measure(self, sim) -> np.ndarray:
        """Measure the residual; the force (owned, d) N that accelerates points."""
        p, n = sim.particles, sim.particles.owned
        total = sim.forces.total()
        pull = self._free(sim, total)  # with what added inertia takes of it
        if "inertia" in sim.forces.names:
            total -= p.inertia_force[:n]
        force = self._free(sim, total)
        reaction = total - force
        if "contact" in sim.forces.names:
            reaction += self._free(sim, p.contact_force[:n])
        load = self._free(sim, p.external_force[:n])
        squares = [(a * a).ravel() for a in (force, load, reaction)]
        square, weight, support = exact_sum(sim.comm, np.stack(squares, axis=1)).tolist()
        scale = weight if weight > 0.0 else (support if support > 0.0 else self._scale_without_load(square))
        if not scale > 0.0:
            raise RelaxationError(
                f"stage '{self.name}': there is no load, so no scale for equilibrium; set gravity, or strain the body "
                "between boundaries before it relaxes"
            )
        self.residual = math.sqrt(square / scale)
        return pull

    def _scale_without_load(self, square: float) -> float:
        """What takes the place of the square of the load where there is none, for the `square` out of balance, N^2."""
        return 0.0

    def _free(self, sim, values) -> np.ndarray:
        """The part of `values` (owned, d) in motions that are not prescribed."""
        free = values.copy()
        for motion in sim.prescribed_motions:
            motion.hold_zero(sim.particles, free)
        return free

    def _steer(self, sim, force) -> None:
        """Turn the velocities towards the force."""
        p = sim.particles
        velocity, acceleration = self._free(sim, p.velocity[: p.owned]), force / p.mass[:, None]
        products = [(a * b).ravel() for a, b in (
            (force, velocity), (velocity, velocity), (acceleration, acceleration),
        )]  # fmt: skip
        power, speed, pull = exact_sum(sim.comm, np.stack(products, axis=1)).tolist()
        if power > 0.0:
            self._downhill += 1
            if self._downhill > _PATIENCE:
                self._steering *= _DECAY
            along = self._steering * math.sqrt(speed / pull)
            self._set_velocity(p, (1.0 - self._steering) * velocity + along * acceleration)
        else:
            self._steering, self._downhill = STEERING, 0
            self._set_velocity(p, np.zeros_like(velocity))

    def _set_velocity(self, p, velocity) -> None:
        """Impose velocities (owned, d); the energy that this takes away counts as damping."""
        n = p.owned
        change = square_lengths(velocity) - square_lengths(p.velocity[:n])
        p.work[:, _DAMPING] += 0.5 * p.mass * change
        p.velocity[:n] = velocity
