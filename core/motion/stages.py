"""What happens in a run, one after the other: relaxation to equilibrium, and motion in real time."""

from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np

from periporo.core.bonds.bonds import RefusedStep
from periporo.core.motion.construction import Construction
from periporo.core.motion.rebuilds import refuse_breaches
from periporo.core.motion.relaxation import Relaxation, RelaxationError
from periporo.core.numerics.tensors import square_lengths
from periporo.core.points.forces import PRESCRIBED
from periporo.core.points.particles import Field, Particles
from periporo.core.ranks.reductions import any_rank, exact_sum, maximum

CHECK_INTERVAL = 100  # steps between looks at the displacements of a relaxation
_STILL = 1e-3  # spacings: less is no motion
_REMEMBERED = ("end_time", "first_step", "initial_energies", "_peak")


@dataclass
class Stage(ABC):
    """Boundary conditions, contacts and loads that hold during a stage."""

    name: str
    prescribed_motions: list = field(default_factory=list)
    contacts: list = field(default_factory=list)
    loads: list = field(default_factory=list)
    inflows: list = field(default_factory=list)  # of water
    construction: Construction | None = field(default=None, kw_only=True)
    begun_with: Any = field(default=None, kw_only=True, repr=False, compare=False)
    """The `State` in which the present increment or trial began, if it may begin again: what checkpoints hold."""
    sleeps: ClassVar[bool] = False
    """Whether points may sleep, where the scene lets them."""

    def run(self, sim, resumed: bool = False) -> None:
        """Put the stage's conditions in force and go through it, or through the rest of it if `resumed`."""
        sim.prescribed_motions, sim.contacts, sim.loads = self.prescribed_motions, self.contacts, self.loads
        sim.inflows = self.inflows
        if resumed:
            for observer in sim.observers:
                observer.resume_stage(sim, self)
        else:
            if sim.sleep is not None:
                sim.sleep.wake_all(sim)
            if self.construction is not None:
                self.construction.carry_out(sim)
            self._set_out(sim)
            before = sim.stages[max(sim.stage_number - 1, 0)].contacts  # at the start of a run those of the first stage
            ending = [contact for contact in before if contact not in self.contacts]
            for contact in self.contacts:
                if contact not in before:
                    contact.appear(sim.particles, sim.time, ending)
                elif self.construction is not None and hasattr(contact, "receive"):
                    contact.receive(sim.particles, self.construction.ids)
            in_the_way = f"is in its way in stage '{self.name}'; remove what is there before, or place it apart"
            refuse_breaches(sim, in_the_way)
            for motion in self.prescribed_motions:
                motion.begin()
            sim.time_step.expire()
            former = sim.stages[sim.stage_number - 1].loads if sim.stage_number else []
            for load in self.loads:
                if hasattr(load, "begin"):
                    load.begin(sim, former)
            sim.apply_loads(0.0)
            for observer in sim.observers:
                observer.start_stage(sim, self)
            self._begin(sim)
        for guard in sim.guards:
            guard.start_stage(sim, self)
        while not self._advance(sim):
            pass
        for contact in self.contacts:
            if hasattr(contact, "look_behind"):
                contact.look_behind(sim.particles)
        refuse_breaches(sim)
        summary = self._finish(sim)
        for observer in sim.observers:
            observer.finish_stage(sim, self, summary)

    def _advance(self, sim) -> bool:
        """A step under the eyes of the guards, who may take it back if a law refuses it; True if there are no more."""
        try:
            if self._is_over(sim):
                sim.confirm()
                return all(guard.conclude(sim) for guard in sim.guards)
            sim.step()
            for guard in sim.guards:
                guard.check(sim)
        except RefusedStep as refusal:
            if not sim.guards:
                raise
            for guard in sim.guards:
                guard.refused(sim, refusal)
        return False

    def _set_out(self, sim) -> None:  # noqa: B027 - not every stage has something to do
        """Before the observers are told."""

    def _begin(self, sim) -> None:  # noqa: B027
        """After the observers were told."""

    @abstractmethod
    def _is_over(self, sim) -> bool:
        """Asked before every step."""

    @abstractmethod
    def _finish(self, sim) -> str:
        """After the last step; what the observers are told of it."""

    @abstractmethod
    def memory(self) -> dict:
        """What a checkpoint keeps."""

    @abstractmethod
    def recall(self, sim, memory: dict) -> None:
        """Go on from there."""


@dataclass
class RelaxStage(Stage):
    """Quasi-static equilibrium: ends when the out-of-balance force falls below `tolerance` of the load.

    Raises RelaxationError if that takes more than `max_steps`.
    """

    tolerance: float = 1e-4
    max_steps: int = 200_000
    limits: np.ndarray | None = None  # way (m) that a point of each body may go, which is not to flow
    bodies: tuple[str, ...] = ()  # their names
    resets: bool = False  # displacements
    relaxation: Relaxation = field(init=False, repr=False, compare=False)

    @staticmethod
    def attach(p: Particles) -> None:
        """Declare what the points keep."""
        p.add_field(Field("relaxed_from", p.dimension, "m", sent=False, place=True))

    def _begin(self, sim) -> None:
        if self.limits is not None:
            sim.particles.relaxed_from[:] = sim.particles.position[: sim.particles.owned]
        self.relaxation = Relaxation(self.name, self.tolerance, self.max_steps)
        self.relaxation.begin(sim)

    def _is_over(self, sim) -> bool:
        if sim.step_number % CHECK_INTERVAL == 0:
            self._refuse_flow(sim)
        return self.relaxation.is_over(sim)

    def _finish(self, sim) -> str:
        self.relaxation.end(sim)
        summary = f"out-of-balance force {self.relaxation.residual:.2e} of the load after {self.relaxation.steps} steps"
        if self.limits is not None:
            summary += f", largest displacement {self._refuse_flow(sim):.3g} m"
        if self.resets:
            sim.particles.initial_position[:] = sim.particles.position[: sim.particles.owned]
        return summary

    def _refuse_flow(self, sim) -> float:
        """Largest way (m) of a point since the stage began. Raises RelaxationError if one is too long."""
        if self.limits is None:
            return 0.0
        p = sim.particles
        way = np.sqrt(square_lengths(p.position[: p.owned] - p.relaxed_from))
        of_bodies = (way[p.body[: p.owned] == b] for b in range(len(self.bodies)))
        longest = [maximum(sim.comm, float(ways.max(initial=0.0))) for ways in of_bodies]
        for body, of_body, limit in zip(self.bodies, longest, self.limits, strict=True):
            if not of_body <= limit:
                raise RelaxationError(
                    f"stage '{self.name}': a point of body '{body}' has moved by {of_body:.3g} m, more than the "
                    f"{limit:.3g} m that max_displacement allows: it flows and does not settle; let it collapse in a "
                    "dynamics stage, or raise max_displacement"
                )
        return max(longest, default=0.0)

    def memory(self) -> dict:
        """What a checkpoint keeps."""
        return self.relaxation.memory()

    def recall(self, sim, memory: dict) -> None:
        """Go on from there."""
        self.relaxation = Relaxation(self.name, self.tolerance, self.max_steps)
        self.relaxation.recall(sim, memory)


@dataclass
class DynamicsStage(Stage):
    """Motion for `duration` s, or until the kinetic energy has fallen to `rest_fraction` of its peak."""

    sleeps: ClassVar[bool] = True
    duration: float = 0.0
    rest_fraction: float | None = None
    rest_interval: int = 100  # steps between looks at the kinetic energy
    launches: list = field(default_factory=list)  # (body, velocity (d,) m/s) of bodies that were held until now
    end_time: float = 0.0
    first_step: int = 0
    initial_energies: dict[str, float] = field(default_factory=dict)  # of the ledger, J
    _peak: float = 0.0  # of the kinetic energy, J
    _at_rest: bool = False

    def _set_out(self, sim) -> None:
        self.end_time, self.first_step, self._peak = sim.time + self.duration, sim.step_number, 0.0
        self._at_rest = False
        for body, velocity in self.launches:
            _launch(sim.particles, body, velocity)

    def _begin(self, sim) -> None:
        self.initial_energies = sim.ledger.entries()

    def _is_over(self, sim) -> bool:
        if self.rest_fraction is not None and sim.step_number % self.rest_interval == 0:
            kinetic = sim.ledger.kinetic()
            self._peak = max(self._peak, kinetic)
            came_to_rest = kinetic <= self.rest_fraction * self._peak and self._has_moved(sim)
            self._at_rest = came_to_rest and not self._awaits(sim)
        return self._at_rest or sim.time >= self.end_time * (1.0 - 1e-12)

    def _has_moved(self, sim) -> bool:
        """Whether the peak of the kinetic energy is that of a motion: `_STILL` spacings in the time since the start."""
        elapsed = sim.time - (self.end_time - self.duration)
        mass = float(exact_sum(sim.comm, sim.particles.mass)[0])
        return elapsed > 0.0 and self._peak > 0.5 * mass * (_STILL * sim.spacing / elapsed) ** 2

    def _awaits(self, sim) -> bool:
        """Whether something is to come: a history that goes on, an obstacle that will meet what rests; collective."""
        if any(motion.end > sim.time for motion in self.prescribed_motions):
            return True
        mine = any(contact.will_push(sim.particles, sim.time, self.end_time) for contact in self.contacts)
        return any_rank(sim.comm, mine)

    def _finish(self, sim) -> str:
        return f"{'at rest at ' if self._at_rest else ''}t = {sim.time:.4g} s"

    def memory(self) -> dict:
        """What a checkpoint keeps."""
        return {name: getattr(self, name) for name in _REMEMBERED}

    def recall(self, sim, memory: dict) -> None:
        """Go on from there."""
        for name in _REMEMBERED:
            setattr(self, name, memory[name])
        sim.rate_independent = False


def _launch(p: Particles, body: int, velocity: np.ndarray) -> None:
    """Give the points of a body its velocity (d,) m/s; the energy counts as prescribed work."""
    rows = np.flatnonzero(p.body[: p.owned] == body)
    p.work[rows, PRESCRIBED] += 0.5 * p.mass[rows] * ((velocity**2).sum() - square_lengths(p.velocity[rows]))
    p.velocity[rows] = velocity
