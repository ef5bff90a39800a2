"""Hours and days in which the soil stays in equilibrium while water flows.

Time goes on in increments. In each one water flows, in pores that give way as elastic soil would under a constant total
stress, and then the soil finds its equilibrium under the pressures; what its pores do beyond that is corrected until
both agree (the fixed-stress split: Kim, Tchelepi & Juanes 2011). Increments are as long as the rates of pressure change
little from one to the next. Where no equilibrium is found, an increment is begun again from where it began with a
shorter one; where that is as short as can be, the stage is over, and the next one goes on. It does not from what is no
number: that is refused, like a step that a law cannot follow.
"""

import math
from dataclasses import dataclass, field
from typing import Any, ClassVar

from periporo.core.bonds.bonds import RefusedStep
from periporo.core.motion.relaxation import RelaxationError
from periporo.core.motion.settling import Settling, no_numbers
from periporo.core.motion.stages import Stage
from periporo.core.points.particles import Field, Particles

_AGREED = 0.2  # of the accuracy: to what flow and equilibrium have to agree
_TURNS, _MOST_TURNS = 6, 30  # of the two in an increment: after these the accuracy itself will do, and most
_REFUSED = 3.0  # accuracies, at which an increment is tried again with a shorter one
_GROWTH, _DECLINE, _CAREFUL = 1.5, 0.25, 0.9
_SHARP = 1e-3  # of the stage so far: how well its end is known at least
_WAY, _LARGEST_WAY = 0.25, 1.0  # spacings in an increment: to which it is made shorter, and which is no equilibrium
_REMEMBERED = ("end_time", "length", "increments", "repeated", "lost", "_begun", "_turns", "_shortest", "_over")


@dataclass
class QuasiStaticStage(Stage):
    """Flow in equilibrium for `duration` s, or until equilibrium is lost (`lost` says how, else it is empty).

    Each increment may err by `accuracy` of the largest pressure (root mean square over the points); the force out of
    balance falls to `tolerance` of the load, in at most `max_steps` of an increment. `water` offers `start`, `flow`,
    `disagreement`, `correct`, `accept` and `stop` (`periporo.core.water.increments`), `states` offers `capture` and
    `install` (`periporo.core.watch.state`). `repeated` counts increments that were begun again.
    """

    duration: float = 0.0
    accuracy: float = 0.02
    tolerance: float = 1e-4
    max_steps: int = 10_000
    water: Any = field(default=None, repr=False, compare=False)
    states: Any = field(default=None, repr=False, compare=False)
    end_time: float = 0.0
    length: float = 0.0  # s, of the next increment, or of the present one
    increments: int = 0
    repeated: int = 0
    lost: str = ""
    settling: Settling = field(init=False, repr=False, compare=False)
    by_increments: ClassVar[bool] = True  # observers look after them, not after steps

    @staticmethod
    def attach(p: Particles) -> None:
        """Declare what the points keep."""
        p.add_field(Field("settled_from", p.dimension, "m", sent=False, place=True))

    def _set_out(self, sim) -> None:
        self.end_time = sim.time + self.duration
        self.increments, self.repeated, self.lost, self._over = 0, 0, "", False

    def _begin(self, sim) -> None:
        self.settling = Settling(self.name, self.tolerance, self.max_steps)
        sim.rate_independent = True
        sim.dt = sim.time_step.choose(sim)
        self.water.start()
        self._begun = sim.time
        self._enter(sim, 0.0)  # what was loaded at once answers before water flows

    def _is_over(self, sim) -> bool:
        while not self._over:
            if self.begun_with is None:
                self.begun_with = self.states.capture(sim)
            try:
                if self.length == 0.0 and self.water.disagreement() > _AGREED * self.accuracy:
                    self._answer_at_once(sim)
                if not self.settling.is_over(sim):
                    return False
            except (RelaxationError, RefusedStep) as reason:
                self._lose(sim, reason)
                continue
            disagreement = self.water.disagreement()
            if math.isnan(disagreement):
                self._lose(sim, no_numbers(sim, self.name, "pressures", sim.particles.pore_pressure))
            elif disagreement <= (_AGREED if self._turns < _TURNS else 1.0) * self.accuracy:
                self._accept(sim)
            elif self._turns == _MOST_TURNS:
                message = f"flow and equilibrium differ by {disagreement:.3g} of the pressure; raise accuracy"
                self._lose(sim, RelaxationError(f"stage '{self.name}': {message}"))
            else:
                self._turns += 1
                self.water.correct()
                self.water.flow(self.length)
                self._settle(sim, again=True)
        return True

    def _lose(self, sim, reason: RelaxationError | RefusedStep) -> None:
        """There is no equilibrium at the end of the increment: begin it again, shorter, or end the stage.

        Raises a RefusedStep that is the `reason` where the increment cannot be shorter.
        """
        gone = self._begun - (self.end_time - self.duration)
        shortest = max(self._shortest, _SHARP * gone)
        if not self.length > shortest:
            if isinstance(reason, RefusedStep):
                raise reason
            self.lost, self._over = str(reason).partition(": ")[2], True
            return
        length, repeated, reduction = self.length, self.repeated, sim.time_step.reduction
        self.states.install(sim, self.begun_with)
        sim.dt *= reduction / sim.time_step.reduction  # what the watchdog has found out holds
        sim.time_step.reduction = reduction
        self._enter(sim, max(_DECLINE * length, shortest))
        self.repeated = repeated + 1

    def _answer_at_once(self, sim) -> None:
        """Let the water answer to each move towards undrained equilibrium: its soil alone would go far astray."""
        self.water.correct(evenly=True)
        self.water.flow(0.0)
        self._settle(sim, again=True)

    def _accept(self, sim) -> None:
        """The present increment is done; begin the next one, if there is one."""
        way, error = self.settling.way(sim), self.water.accept()
        self._begun += self.length
        sim.ahead = 0.0
        sim.reset_clock(self._begun)
        if self.length > 0.0:
            self.increments += 1
            wanted = _CAREFUL * math.sqrt(self.accuracy / error) if error > 0.0 else _GROWTH
            slower = _WAY * sim.spacing / way if way > 0.0 else _GROWTH
            resolved = max(self.length * max(wanted, _DECLINE), self.water.shortest_time())
            self.length = min(resolved, _GROWTH * self.length, max(slower, _DECLINE) * self.length)
        else:
            self.length = self.water.shortest_time()
        for motion in sim.prescribed_motions:
            motion.begin()  # it bears what the forces now are, as after a checkpoint
        for observer in sim.observers:
            observer.after_increment(sim)
        left = self.end_time - self._begun
        if left <= 1e-12 * self.duration:
            self._over = True
            return
        self._enter(sim, left if left <= 1.001 * self.length else min(self.length, 0.5 * left))

    def _enter(self, sim, length: float) -> None:
        """Begin an increment of at most `length` s."""
        p = sim.particles
        p.settled_from[:] = p.position[: p.owned]
        self.settling.largest_way = math.inf if length == 0.0 else _LARGEST_WAY * sim.spacing
        self._shortest = self.water.shortest_time()
        while self.water.flow(length) > _REFUSED * self.accuracy and length > self._shortest:
            length = max(_DECLINE * length, self._shortest)
        self.length, self._turns = length, 0
        sim.ahead = length
        self._settle(sim)
        self.begun_with = None

    def _settle(self, sim, again: bool = False) -> None:
        """Look for equilibrium under the present pressures."""
        self.settling.begin(sim, again)
        sim.find_shapes()  # as after a checkpoint
        sim.apply_loads(0.0)

    def _finish(self, sim) -> str:
        self.settling.end(sim)
        self.water.stop()
        self.begun_with = None
        sim.ahead = 0.0
        ending = f"equilibrium is lost at t = {sim.time:.6g} s: {self.lost}" if self.lost else f"t = {sim.time:.6g} s"
        again = f", {self.repeated} more begun again with shorter ones" if self.repeated else ""
        return f"{ending}, {self.increments} increments{again}"

    def memory(self) -> dict:
        """What a checkpoint keeps."""
        kept = {name: getattr(self, name) for name in _REMEMBERED}
        return kept | {"settling": self.settling.memory(), "water": self.water.memory()}

    def recall(self, sim, memory: dict) -> None:
        """Go on from there."""
        for name in _REMEMBERED:
            setattr(self, name, memory[name])
        self.settling = Settling(self.name, self.tolerance, self.max_steps)
        self.settling.recall(sim, memory["settling"])
        self.settling.largest_way = math.inf if self.length == 0.0 else _LARGEST_WAY * sim.spacing
        sim.ahead = self.length
        self.water.recall(memory["water"])
