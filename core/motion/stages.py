"""What happens in a run, one after the other: relaxation to equilibrium, and motion in real time."""

from abc import ABC, abstractmethod
from dataclasses import dataclass, field

from periporo.core.bonds.bonds import RefusedStep
from periporo.core.motion.relaxation import Relaxation

_REMEMBERED = ("end_time", "first_step", "initial_residual", "_peak")


@dataclass
class Stage(ABC):
    """Boundary conditions, contacts and loads that hold during a stage."""

    name: str
    prescribed_motions: list = field(default_factory=list)
    contacts: list = field(default_factory=list)
    loads: list = field(default_factory=list)
    inflows: list = field(default_factory=list)  # of water

    def run(self, sim, resumed: bool = False) -> None:
        """Put the stage's conditions in force and go through it, or through the rest of it if `resumed`."""
        sim.prescribed_motions, sim.contacts, sim.loads = self.prescribed_motions, self.contacts, self.loads
        sim.inflows = self.inflows
        if resumed:
            for observer in sim.observers:
                observer.resume_stage(sim, self)
        else:
            self._set_out(sim)
            before = sim.stages[max(sim.stage_number - 1, 0)].contacts  # at the start of a run those of the first stage
            for contact in self.contacts:
                if contact not in before:
                    contact.appear(sim.particles, sim.time, before)
            sim.apply_loads(0.0)
            for observer in sim.observers:
                observer.start_stage(sim, self)
            self._begin(sim)
        for guard in sim.guards:
            guard.start_stage(sim, self)
        while not self._advance(sim):
            pass
        summary = self._finish(sim)
        for observer in sim.observers:
            observer.finish_stage(sim, self, summary)

    def _advance(self, sim) -> bool:
        """A step under the eyes of the guards, who may take it back if a law refuses it; True if there are no more."""
        try:
            if self._is_over(sim):
                sim.confirm()
                return True
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
    relaxation: Relaxation = field(init=False, repr=False, compare=False)

    def _begin(self, sim) -> None:
        self.relaxation = Relaxation(self.name, self.tolerance, self.max_steps)
        self.relaxation.begin(sim)

    def _is_over(self, sim) -> bool:
        return self.relaxation.is_over(sim)

    def _finish(self, sim) -> str:
        self.relaxation.end(sim)
        return f"out-of-balance force {self.relaxation.residual:.2e} of the load after {self.relaxation.steps} steps"

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

    duration: float = 0.0
    rest_fraction: float | None = None
    rest_interval: int = 100  # steps between looks at the kinetic energy
    end_time: float = 0.0
    first_step: int = 0
    initial_residual: float = 0.0  # of the energy ledger, J
    _peak: float = 0.0  # of the kinetic energy, J
    _at_rest: bool = False

    def _set_out(self, sim) -> None:
        self.end_time, self.first_step, self._peak = sim.time + self.duration, sim.step_number, 0.0
        self._at_rest = False

    def _begin(self, sim) -> None:
        self.initial_residual = sim.ledger.entries()["energy_residual"]

    def _is_over(self, sim) -> bool:
        if self.rest_fraction is not None and sim.step_number % self.rest_interval == 0:
            kinetic = sim.ledger.kinetic()
            self._peak = max(self._peak, kinetic)
            self._at_rest = sim.step_number > self.first_step and kinetic <= self.rest_fraction * self._peak
        return self._at_rest or sim.time >= self.end_time * (1.0 - 1e-12)

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
