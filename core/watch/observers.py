"""What looks at a simulation after each step without changing it: results, histories, progress."""

import numpy as np

from periporo.core.numerics.cells import Cells, joined
from periporo.core.numerics.tensors import square_lengths
from periporo.core.points import fields
from periporo.core.ranks.reductions import maximum

_REMEMBERED = ("stage_interval", "stage_start", "number", "last_step", "last_time")
_ALMOST = 1e-9  # intervals
_VIEW = 1.5  # sizes of the scene, around its middle, to which a plane is drawn


class Observer:
    """Called around stages and after each step."""

    def start_stage(self, sim, stage) -> None:
        """A stage begins."""

    def resume_stage(self, sim, stage) -> None:
        """A stage goes on from a checkpoint."""

    def after_step(self, sim) -> None:
        """A step is done."""

    def after_increment(self, sim) -> None:
        """An increment of a quasi-static stage is done: time has gone on."""

    def finish_stage(self, sim, stage, summary: str) -> None:
        """A stage is over; `summary` says how."""

    def memory(self) -> dict:
        """What a checkpoint keeps."""
        return {}

    def recall(self, memory: dict) -> None:
        """Go on from there."""


class ResultObserver(Observer):
    """Writes the points at the start of a dynamics stage, every `interval` s, and at the end of each stage.

    `obstacles` is a function of the simulation that gives the obstacles as cells, if there are any.
    """

    def __init__(self, writer, names, interval: float | None, obstacles=None):
        self.obstacles = obstacles
        self.writer = writer
        self.names = tuple(names)
        self.interval = interval
        self._stage_interval = np.inf
        self._stage_start = 0.0
        self._number = 1  # of the next output of the stage, after 0 at its start
        self._last_step, self._last_time = -1, 0.0  # of an output: an increment may take no step

    def start_stage(self, sim, stage) -> None:
        """Write the start of a dynamics stage."""
        duration = getattr(stage, "duration", None)
        if duration is None:
            self._stage_interval = np.inf
            return
        self._stage_interval = self.interval or duration / 50
        self._stage_start, self._number = sim.time, 1
        self._write(sim)

    def after_step(self, sim) -> None:
        """Write if an output time has been reached; the time step is never cut for it.

        Times of fixed steps are sums, which may end a few units in the last place short of n intervals.
        """
        passed = (sim.time - self._stage_start) / self._stage_interval + _ALMOST
        if passed >= self._number:
            self._write(sim)
            self._number = int(passed) + 1

    after_increment = after_step

    def finish_stage(self, sim, stage, summary) -> None:
        """Write the end of a dynamics stage, or of a scene that only relaxes."""
        if hasattr(stage, "duration") or stage is sim.stages[-1]:
            self._write(sim)

    def memory(self) -> dict:
        """When the next output is due."""
        return {name: getattr(self, f"_{name}") for name in _REMEMBERED}

    def recall(self, memory: dict) -> None:
        """Go on from there."""
        for name in _REMEMBERED:
            setattr(self, f"_{name}", memory[name])

    def _write(self, sim) -> None:
        if self._last_step == sim.step_number and self._last_time == sim.time:
            return
        self._last_step, self._last_time = sim.step_number, sim.time
        p, n = sim.particles, sim.particles.owned
        cells = () if self.obstacles is None else (self.obstacles(sim),)
        self.writer.write(sim.time, sim.step_number, p.id[:n], p.position[:n], fields.values(sim, self.names), *cells)


def present_obstacles(sim) -> Cells:
    """The obstacles that are present, by the number of their contact, as they stand now."""
    p, extent, outlines = sim.particles, sim.extent, {}
    for contact in sim.contacts:
        if hasattr(contact, "outline"):
            outlines[int(contact.name)] = contact.outline(p, sim.time, extent.middle, _VIEW * extent.size)
    return joined(outlines)


class HistoryObserver(Observer):
    """Records global figures every `interval` steps: time, energies, extent, speed; and the motion of `probes`."""

    UNITS = {
        "time": "s", "dt": "s", "kinetic_energy": "J", "internal_energy": "J", "external_work": "J",
        "contact_energy": "J", "friction_dissipation": "J", "damping_dissipation": "J", "prescribed_work": "J",
        "integration_term": "J", "plastic_dissipation": "J", "water_work": "J",
        "energy_residual": "J", "max_speed": "m/s", "front": "m", "height": "m",
    }  # fmt: skip

    def __init__(self, writer, interval: int, probes=None):
        self.writer = writer
        self.probes = probes
        self.interval = interval
        self.latest: dict[str, float] = {}
        self._by_increments = False

    def start_stage(self, sim, stage) -> None:
        """Record the start."""
        self.resume_stage(sim, stage)
        self._record(sim)

    def resume_stage(self, sim, stage) -> None:
        """Know whether the stage goes by steps or increments."""
        self._by_increments = getattr(stage, "by_increments", False)

    def after_step(self, sim) -> None:
        """Record if it is time."""
        if sim.step_number % self.interval == 0 and not self._by_increments:
            self._record(sim)

    def after_increment(self, sim) -> None:
        """Record each."""
        self._record(sim)

    def finish_stage(self, sim, stage, summary) -> None:
        """Record the end."""
        self._record(sim)

    def memory(self) -> dict:
        """The latest figures."""
        return {"latest": dict(self.latest)}

    def recall(self, memory: dict) -> None:
        """Go on from there."""
        self.latest = dict(memory["latest"])

    def _record(self, sim) -> None:
        if self.latest.get("step") == sim.step_number and self.latest["time"] == sim.time:
            return
        p, n = sim.particles, sim.particles.owned
        x = p.position[:n]
        half = 0.5 * sim.spacing  # a point stands for a cell
        speed = np.sqrt(square_lengths(p.velocity[:n]).max(initial=0.0))
        highest = maximum(sim.comm, float(sim.extent.height(x).max(initial=-np.inf)))
        self.latest = {
            "step": sim.step_number,
            "time": sim.time,
            "dt": sim.dt,
            **sim.ledger.entries(),
            "max_speed": maximum(sim.comm, speed),
            "front": maximum(sim.comm, float(sim.extent.distance(x).max(initial=0.0))) + half,
            "height": highest + half if highest > -np.inf else np.nan,  # when all points have left
            **({} if self.probes is None else self.probes.entries(p)),
            **{n: v for part in sim.point_processes for n, v in getattr(part, "histories", dict)().items()},
            **{n: v for part in sim.reactions for n, v in part.histories(sim).items()},
        }
        self.writer.append_history(self.latest)


class ProgressObserver(Observer):
    """Feeds the progress display with the latest history entry."""

    def __init__(self, progress, history: HistoryObserver):
        self.progress = progress
        self.history = history
        self._imbalance: dict[str, float] = {}
        self._measured = None  # rebuild at which the imbalance was measured

    def start_stage(self, sim, stage) -> None:
        """Announce the stage."""
        points = sim.comm.allreduce(sim.particles.owned)
        self.progress.start_stage(stage.name, getattr(stage, "end_time", None), points)

    resume_stage = start_stage

    def after_step(self, sim) -> None:
        """Show the state."""
        latest = self.history.latest
        if sim.comm.size > 1 and sim.rebuild_count != self._measured:
            self._measured, self._imbalance = sim.rebuild_count, {"imbalance": _imbalance(sim)}
        self.progress.update(
            sim.time, sim.dt, sim.step_number, kinetic_energy=latest["kinetic_energy"],
            internal_energy=latest["internal_energy"], energy_residual=latest["energy_residual"],
            max_speed=latest["max_speed"], rebuilds=sim.rebuild_count, **self._imbalance,
        )  # fmt: skip

    def finish_stage(self, sim, stage, summary) -> None:
        """Say how it ended."""
        self.progress.finish_stage(summary)


class Callback(Observer):
    """Calls `function(simulation)` on every rank after every `interval`-th step."""

    def __init__(self, interval: int, function):
        if isinstance(interval, bool) or not isinstance(interval, int) or interval < 1:
            raise ValueError(f"a callback comes every 1, 2, 3 ... steps, not {interval!r}; give (steps, function)")
        self.interval = interval
        self.function = function

    def after_step(self, sim) -> None:
        """Call it if it is time."""
        if sim.step_number % self.interval == 0:
            self.function(sim)


def _imbalance(sim) -> float:
    """Pairs of the rank that has most, over the mean of all ranks; 1 if there are none."""
    pairs = float(len(sim.bonds.pairs.first))
    total = sim.comm.allreduce(pairs)
    return maximum(sim.comm, pairs) * sim.comm.size / total if total else 1.0
