"""Equilibrium after a small change: by the elastic answer to what is out of balance, and where it is not all, FIRE.

The elastic answer is found by conjugate gradients (Hestenes & Stiefel 1952) with the operator of the scheme itself and
the inner products of `periporo.core.ranks.reductions`, so that the bits are the same on any number of ranks. Elastic
soil is in equilibrium after one such move; where a law yields, moves go on as long as each takes away most of what is
out of balance, and `Relaxation` does the rest.
"""

import math

import numpy as np

from periporo.core.bonds.bonds import RefusedStep
from periporo.core.motion.relaxation import STEERING, Relaxation, RelaxationError
from periporo.core.motion.timestep import apply_stiffness, held, local_stiffness
from periporo.core.numerics.tensors import square_lengths
from periporo.core.ranks.reductions import exact_sum, inner, maximum

_MOST_ITERATIONS = 2000
_SHARE = 0.3  # of the tolerance, or of
_LEFT = 1e-2  # what is out of balance: what an elastic move may leave of it
_WORTH = 0.8  # a move that leaves more was the last one
_LONGEST = 0.1  # spacings, of a move
_REMEMBERED = ("_elastic", "_moved", "_before", "_largest", "iterations")


class Settling(Relaxation):
    """A relaxation that begins with elastic moves; `largest_way` m may a point go, then RelaxationError is raised.

    RefusedStep is raised where forces are no numbers.
    Points keep `settled_from` (d,) m, where it began. `iterations` counts those of all elastic moves.
    """

    def __init__(self, name: str, tolerance: float, max_steps: int):
        super().__init__(name, tolerance, max_steps)
        self.largest_way = math.inf
        self.iterations = 0
        self._largest = 0.0  # N^2, out of balance
        self._elastic, self._moved, self._before = True, False, math.inf

    def begin(self, sim, again: bool = False) -> None:
        """Start from rest; steps go on to count if it begins `again`."""
        first = self._first_step
        super().begin(sim)
        self._first_step = first if again else self._first_step
        self._steering, self._downhill = STEERING, 0
        self._elastic, self._moved, self._before = True, False, math.inf

    def is_over(self, sim) -> bool:
        """Whether equilibrium is reached; if not, make ready for the next step."""
        if self._moved:  # at rest again: what dampings of contacts made of the move does not count
            self._set_velocity(sim.particles, np.zeros((sim.particles.owned, sim.particles.dimension)))
            sim.find_shapes()  # as after a checkpoint
            sim.apply_loads(0.0)
            self._moved = False
        if (self.steps + 1) % 20 == 0 and self.way(sim) > self.largest_way:
            raise RelaxationError(f"stage '{self.name}': a point has gone {self.way(sim):.3g} m without coming to rest")
        return super().is_over(sim)

    def way(self, sim) -> float:
        """Largest way (m) of a point from where it was `settled_from`; collective."""
        p = sim.particles
        square = square_lengths(p.position[: p.owned] - p.settled_from).max(initial=0.0)
        return maximum(sim.comm, math.sqrt(square))

    def memory(self) -> dict:
        """What a checkpoint keeps."""
        return super().memory() | {name: getattr(self, name) for name in _REMEMBERED}

    def recall(self, sim, memory: dict) -> None:
        """Go on from there."""
        super().recall(sim, memory)
        for name in _REMEMBERED:
            setattr(self, name, memory[name])

    def _measure(self, sim):
        force = super()._measure(sim)
        if math.isnan(self.residual):  # before points that are nowhere count as free of forces
            raise no_numbers(sim, self.name, "forces", sim.forces.total())
        return force

    def _scale_without_load(self, square):
        """The largest that was out of balance since the stage began; any, where nothing is."""
        self._largest = max(self._largest, square)
        return self._largest if self._largest > 0.0 else 1.0

    def _free(self, sim, values):
        in_company = sim.particles.share[: sim.particles.owned, 1:2] > 0.0  # others fall freely
        return super()._free(sim, values) * in_company

    def _steer(self, sim, force):
        if self._elastic and self.residual > _WORTH * self._before:
            self._elastic = False
        if not self._elastic:
            super()._steer(sim, force)
            return
        self._before = self.residual
        if sim.time_step.due(sim.step_number):
            sim.dt = sim.time_step.choose(sim)
        p, left = sim.particles, max(_SHARE * self.tolerance / self.residual, _LEFT)
        move = self._answer(sim, force, left)
        longest = maximum(sim.comm, math.sqrt(square_lengths(move).max(initial=0.0)))
        move *= min(1.0, _LONGEST * sim.spacing / longest) if longest > 0.0 else 1.0
        kick = 0.5 * sim.dt / p.mass[:, None] * sim.forces.total()  # which the step begins with
        self._set_velocity(p, self._free(sim, move / sim.dt - kick))
        self._moved = True

    def _answer(self, sim, force, left: float) -> np.ndarray:
        """Displacement (owned, d) m by which the elastic soil takes up all of a `force` but the part `left`."""
        springs, contacts = local_stiffness(sim, sim.contacts)
        n, d = force.shape
        local = springs[:n, :d] + contacts[:, None]
        softness = 1.0 / np.where(local > 0.0, local, 1.0)
        residual, answer = force.copy(), np.zeros_like(force)
        direction = self._free(sim, softness * residual)
        power, first = exact_sum(sim.comm, _columns((residual, direction), (residual, residual))).tolist()
        with held(sim):
            for _ in range(_MOST_ITERATIONS):
                image = self._free(sim, apply_stiffness(sim, direction))
                resistance = inner(sim.comm, direction, image)
                if not resistance > 0.0:
                    break
                self.iterations += 1
                answer += power / resistance * direction
                residual -= power / resistance * image
                turned, before = self._free(sim, softness * residual), power
                power, square = exact_sum(sim.comm, _columns((residual, turned), (residual, residual))).tolist()
                if square <= left * left * first:
                    break
                direction = turned + power / before * direction
        return answer


def no_numbers(sim, stage: str, what: str, values: np.ndarray) -> RefusedStep:
    """The refusal of a state in which `what`, `values` (owned,) or (owned, d) of the points, are no numbers."""
    p = sim.particles
    fails = ~np.isfinite(values.reshape(p.owned, -1)).all(axis=1)
    reason = f"{what} of points are no numbers any more"
    return RefusedStep(f"stage '{stage}': {reason}", reason, p.id[: p.owned][fails], "nan")


def _columns(*pairs):
    return np.stack([(a * b).ravel() for a, b in pairs], axis=1)
