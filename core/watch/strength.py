"""The factor of safety: how much weaker the soil may be before it no longer stands.

Cohesion and tan(phi) are divided by a factor (Zienkiewicz et al. 1975), in trials that all begin with the state in
which the stage begins: motion under viscous damping, in which what falls freely would get to the speed g/rate. Soil
that still moves at more than a share of that at the end of a trial has failed. The least factor at which it does is
bracketed, and the bracket halved until it is narrow. The last trial is one that failed, so that the results show how.
Checkpoints are of the beginning of a trial.
"""

from dataclasses import dataclass, field, replace

import numpy as np

from periporo.core.motion.stages import Stage
from periporo.core.numerics.tensors import square_lengths
from periporo.core.points.particles import Field, Particles
from periporo.core.ranks.reductions import maximum
from periporo.core.watch.state import State, capture, install, memory

_WIDER = 1.3  # times the factor at which the soil still stands, while none is known at which it fails
_LOOK = 100  # steps between looks at how far points have gone
_GONE = 1.0  # spacings that a point goes in soil that has failed, if it still moves
_REMEMBERED = ("first_step", "initial_energies", "factor", "stands", "falls", "began", "last")


class StabilityError(RuntimeError):
    """The soil does not stand as it is, or stands however weak it is; raised on all ranks alike."""


@dataclass
class StrengthReductionStage(Stage):
    """Trials of `trial` s each with the viscous damping `rate` 1/s, until the factor is known to `accuracy` of itself.

    `speed` m/s at the end of a trial tells failure; `largest` factor that is tried. `factor` is that of the present
    trial; the soil is known to stand at `stands`, and to fall at `falls`.
    """

    trial: float = 1.0
    speed: float = 1e-3
    accuracy: float = 0.02
    largest: float = 5.0
    first_step: int = 0
    initial_energies: dict[str, float] = field(default_factory=dict)  # of the ledger, J
    factor: float = 1.0
    stands: float = 0.0
    falls: float = np.inf
    began: float = 0.0  # s, the present trial
    last: bool = False  # whether it is shown only
    _start: State | None = field(default=None, repr=False, compare=False)
    _recalled: bool = field(default=False, repr=False, compare=False)
    _laws: list = field(default_factory=list, repr=False, compare=False)

    @property
    def safety(self) -> float:
        """The factor of safety: the middle of the bracket."""
        return 0.5 * (self.stands + self.falls)

    @staticmethod
    def attach(p: Particles) -> None:
        """Declare what the points keep."""
        p.add_field(Field("weakened_from", p.dimension, "m", sent=False, place=True))

    def _begin(self, sim) -> None:
        self.first_step, self.began = sim.step_number, sim.time
        self.initial_energies = sim.ledger.entries()
        self._take_start(sim)
        self._set_off(sim)

    def _take_start(self, sim):
        """Remember with what the trials begin."""
        self._laws = self._laws or [block.material for block in sim.bonds.blocks]  # before any is weakened
        self._start = self.begun_with = capture(sim)

    def _is_over(self, sim) -> bool:
        if self._recalled and self.begun_with is None:  # resumed at the beginning of a trial, or taken back to there
            self._take_start(sim)
            self._set_off(sim)
        elif self._recalled:  # by the watchdog, perhaps to the trial before
            self._weaken(sim)
        failed = self._fails(sim)
        if failed is None:
            return False
        if self.last:
            return True
        if failed:
            self.falls = self.factor
        else:
            self.stands = self.factor
        if self.stands == 0.0:
            raise StabilityError(f"stage '{self.name}': the soil does not stand as it is, with a factor of 1")
        following = self._next(failed)
        if following is None:
            return True
        self._restart(sim, following)
        return False

    def _next(self, failed: bool) -> float | None:
        """The factor of the next trial; None if the results show a failure and the bracket is narrow."""
        if np.isinf(self.falls):
            if self.stands >= self.largest:
                raise StabilityError(
                    f"stage '{self.name}': the soil stands with its strength divided by {self.stands:g}; raise largest "
                    "if a law has strength that matters"
                )
            return min(_WIDER * self.stands, self.largest)
        if self.falls - self.stands > self.accuracy * self.stands:
            return self.safety
        self.last = not failed
        return self.falls if self.last else None

    def _fails(self, sim) -> bool | None:
        """Whether the present trial has failed; None while it is not decided. Collective."""
        over = sim.time >= self.began + self.trial * (1.0 - 1e-12)
        if not over and sim.step_number % _LOOK != 0:
            return None
        p, n = sim.particles, sim.particles.owned
        fast = maximum(sim.comm, float(np.sqrt(square_lengths(p.velocity[:n]).max(initial=0.0)))) > self.speed
        if over:
            return fast
        way = np.sqrt(square_lengths(p.position[:n] - p.weakened_from).max(initial=0.0))
        gone = maximum(sim.comm, float(way)) > _GONE * sim.spacing
        return True if fast and gone and not self.last else None

    def _restart(self, sim, factor: float) -> None:
        """Begin a trial from where the stage began; clocks go on."""
        self.factor, self.began = factor, sim.time
        assert self._start is not None  # since the stage began
        now = memory(sim)
        now["simulation"]["skin"] = self._start.memory["simulation"]["skin"]  # with which its neighbours were found
        begun_with = replace(self._start, memory=now)
        install(sim, begun_with)
        self.begun_with = begun_with
        self._set_off(sim)

    def _set_off(self, sim):
        """Let a trial go."""
        p = sim.particles
        p.weakened_from[:] = p.position[: p.owned]
        self._weaken(sim)
        sim.apply_loads(0.0)

    def _weaken(self, sim):
        """Divide the strength by the factor of the present trial."""
        self._recalled = False
        for block, law in zip(sim.bonds.blocks, self._laws, strict=True):
            block.use(law.weakened(self.factor) if hasattr(law, "weakened") else law)

    def _finish(self, sim) -> str:
        for block, law in zip(sim.bonds.blocks, self._laws, strict=True):
            block.use(law)
        self.begun_with = None
        return f"factor of safety {self.safety:.4g}: stands at {self.stands:.4g}, falls at {self.falls:.4g}"

    def memory(self) -> dict:
        """What is kept with a state."""
        return {name: getattr(self, name) for name in _REMEMBERED}

    def recall(self, sim, memory: dict) -> None:
        """Go on from there."""
        for name in _REMEMBERED:
            setattr(self, name, memory[name])
        self._recalled = True
        sim.rate_independent = False
