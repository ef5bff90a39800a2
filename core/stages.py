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

    def enter(self, sim) -> None:
        """Put the stage's conditions in force; time starts at zero."""
        sim.prescribed_motions, sim.contacts, sim.loads = self.prescribed_motions, self.contacts, self.loads
        sim.reset_clock()


@dataclass
class RelaxStage(Stage):
    """Quasi-static equilibrium: ends when the out-of-balance force falls below `tolerance` of the weight."""

    tolerance: float = 1e-4
    max_steps: int = 200_000

    def run(self, sim) -> None:
        """Step until equilibrium. Raises RelaxationError if it is not reached in `max_steps`."""
        self.enter(sim)
        relaxation = Relaxation(self.name, self.tolerance, self.max_steps)
        relaxation.run(sim)


@dataclass
class DynamicsStage(Stage):
    """Motion for `duration` s, or until the kinetic energy has fallen to a fraction of its peak."""

    duration: float = 0.0
    rest_fraction: float | None = None
    rest_interval: int = 100  # steps between looks at the kinetic energy

    def run(self, sim) -> None:
        """Step to the end of the stage."""
        self.enter(sim)
        for observer in sim.observers:
            observer.start_stage(sim, self)
        peak = 0.0
        while sim.time < self.duration * (1.0 - 1e-12):
            sim.step()
            if self.rest_fraction is not None and sim.step_number % self.rest_interval == 0:
                kinetic = sim.ledger.kinetic()
                peak = max(peak, kinetic)
                if kinetic <= self.rest_fraction * peak:
                    break
        for observer in sim.observers:
            observer.finish_stage(sim, self)
