"""What happens in a run, one after the other: relaxation to equilibrium, and motion in real time."""

from dataclasses import dataclass, field

from periporo.core.relaxation import Relaxation


@dataclass
class Stage:
    """Boundary conditions, contacts and loads that hold during a stage."""

    name: str
    prescribed_motions: list = field(default_factory=list)
    contacts: list = field(default_factory=list)
    loads: list = field(default_factory=list)

    def run(self, sim) -> None:
        """Put the stage's conditions in force and go through it."""
        sim.prescribed_motions, sim.contacts, sim.loads = self.prescribed_motions, self.contacts, self.loads
        sim.apply_loads(0.0)
        for observer in sim.observers:
            observer.start_stage(sim, self)
        summary = self._advance(sim)
        for observer in sim.observers:
            observer.finish_stage(sim, self, summary)


@dataclass
class RelaxStage(Stage):
    """Quasi-static equilibrium: ends when the out-of-balance force falls below `tolerance` of the weight.

    Raises RelaxationError if that takes more than `max_steps`.
    """

    tolerance: float = 1e-4
    max_steps: int = 200_000

    def _advance(self, sim) -> str:
        relaxation = Relaxation(self.name, self.tolerance, self.max_steps)
        relaxation.run(sim)
        return f"out-of-balance force {relaxation.residual:.2e} of the weight after {relaxation.steps} steps"


@dataclass
class DynamicsStage(Stage):
    """Motion for `duration` s, or until the kinetic energy has fallen to `rest_fraction` of its peak."""

    duration: float = 0.0
    rest_fraction: float | None = None
    rest_interval: int = 100  # steps between looks at the kinetic energy
    end_time: float = 0.0

    def run(self, sim) -> None:
        """Put the stage's conditions in force and go through it."""
        self.end_time = sim.time + self.duration
        super().run(sim)

    def _advance(self, sim) -> str:
        peak = 0.0
        while sim.time < self.end_time * (1.0 - 1e-12):
            sim.step()
            if self.rest_fraction is not None and sim.step_number % self.rest_interval == 0:
                kinetic = sim.ledger.kinetic()
                peak = max(peak, kinetic)
                if kinetic <= self.rest_fraction * peak:
                    return f"at rest at t = {sim.time:.4g} s"
        return f"t = {sim.time:.4g} s"
