"""The simulation: its parts, and the only time loop in the program."""

from collections.abc import Callable, Iterable
from typing import Any, ClassVar

import numpy as np
from mpi4py import MPI

from periporo.core.bonds.bonds import Bonds, RefusedStep
from periporo.core.loads.boundary import ViscousDamping
from periporo.core.motion.added_inertia import AddedInertia
from periporo.core.motion.energy import Ledger
from periporo.core.motion.integrator import drift, second_kick
from periporo.core.motion.pace import kick_within
from periporo.core.motion.rebuilds import THINNEST, neighbours_are_stale, rebuild
from periporo.core.motion.sleep import Sleep
from periporo.core.motion.stages import Stage
from periporo.core.motion.timestep import StableTimeStep
from periporo.core.points.departures import Departures
from periporo.core.points.extent import Extent
from periporo.core.points.forces import ForceChannels
from periporo.core.points.material import Material
from periporo.core.points.particles import Particles
from periporo.core.ranks.domain import Domain
from periporo.core.ranks.halo import Halo
from periporo.core.ranks.reductions import any_rank
from periporo.core.watch.observers import Callback
from periporo.core.watch.timing import Timing
from periporo.errors import InputError, Problem

_MARGIN = 1.0 + 1e-9  # of the ghosts' reach, so that both ranks of a pair list it whatever the rounding
_REMEMBERED = (
    "time", "_carry", "dt", "step_number", "stage_number", "skin", "farthest", "rebuild_count", "rebuilt_at",
    "fastest",
)  # fmt: skip


class Simulation:
    """A scene in motion on the ranks of `comm`.

    `from_scene` builds it; `start` finds bonds and forces of the initial state, `step` advances it, `run` does both
    through all stages. What a scene does not have is an empty list here.

    - `particles`: the points, one array for each field: rows up to `particles.owned` are this rank's, the rest are
      copies of other ranks' points; `position` (n, d) m, `velocity` (n, d) m/s, `mass` (n,) kg, `id` (n,) and so on
    - `ledger`: energies of the whole scene, J: `ledger.kinetic()`, `ledger.entries()`
    - `time` s, `dt` s, `step_number`, `rebuild_count`, `comm`, `spacing` m

    >>> soil = {"model": "elastic", "density": 1800, "bulk_modulus": 25e6, "shear_modulus": 15e6}
    >>> box = {"type": "box", "lower": [0, 0], "upper": [0.1, 0.05]}
    >>> simulation = Simulation.from_scene({
    ...     "dimension": 2, "spacing": 0.01, "gravity": [0, -9.81], "materials": {"soil": soil},
    ...     "bodies": [{"name": "block", "material": "soil", "shape": box}],
    ...     "stages": [{"name": "fall", "type": "dynamics", "duration": 1e-3}],
    ... })
    >>> simulation.run()
    >>> fall = simulation.particles.velocity[: simulation.particles.owned, 1]
    >>> bool(abs(fall + 9.81 * simulation.time).max() < 1e-12)
    True
    """

    reader: ClassVar[Callable[..., "Simulation"] | None] = None
    """What makes the simulation of a scene on the ranks of a communicator; `periporo.core.scene.source` sets it."""

    def __init__(
        self, comm: MPI.Comm, particles: Particles, materials: Iterable[Material], scheme: Any, *, spacing: float,
        skin: float, time_step: StableTimeStep,
    ):  # fmt: skip
        self.comm = comm
        self.particles = particles
        self.materials = list(materials)
        self.scheme = scheme
        self.spacing = spacing
        self.largest_skin = skin
        self.skin = THINNEST * skin
        self.time_step = time_step
        self.halo = Halo(comm)
        self.bonds = Bonds(particles, self.materials, scheme.rows)
        self.forces = ForceChannels(particles)
        self.forces.need("internal")
        self.domain: Domain | None = None
        self._ledger: Ledger | None = None
        self.timing = Timing()
        self.prescribed_motions: list = []
        self.point_processes: list = []
        self.contacts: list = []
        self.loads: list = []
        self.inflows: list = []  # of water, at boundaries
        self.observers: list = []
        self.reactions: list = []  # what obstacles and boundaries bear, with `histories(simulation)`
        self.stages: list[Stage] = []
        self.preparations: list[Callable[[Simulation], None]] = []  # once at the start
        self.refusals_of_step: list[Callable[[Simulation], None]] = []  # at its end, when the first step is known
        self.guards: list = []  # what may write a checkpoint, stop the run, or take it back: `periporo.core.watch`
        self.departures: Departures | None = None  # points that leave the scene
        self.sleep: Sleep | None = None  # of points at rest
        self.added_inertia: AddedInertia | None = None  # of neighbours that accelerate against each other
        self.origin = np.zeros(particles.dimension)  # that positions are counted from, m
        self.reaches: list[Callable[[dict[str, np.ndarray]], float]] = []  # m, farther than bonds; of the owned fields
        self.farthest = 0.0  # m, within which points act on each other until the next rebuild
        self.extent: Extent | None = None  # of the bodies at the start
        self.stage_number = 0
        self.time, self.dt, self.step_number, self.rebuild_count = 0.0, 0.0, 0, 0
        self.rate_independent = False  # quasi-static: viscous laws are given all the time in the world
        self.ahead = 0.0  # s, of the clock: when loads hold for which a quasi-static stage looks for equilibrium
        self.rebuilt_at = 0  # step
        self._carry = 0.0  # of the compensated sum of time steps
        self.moved = 0.0  # m, of this rank's points since the neighbours were found, at most
        self.way = 0.0  # m, longest of this rank in a step
        self.fastest = np.inf  # m/s, point in the step before
        self.refusals: list = []  # of the last step, on this rank
        self._failed = 0  # updates of laws on this rank

    @classmethod
    def from_scene(cls, scene: Any, comm: MPI.Comm | None = None) -> "Simulation":
        """The simulation of a scene: a YAML file, a dictionary or a `SceneInput`; on all ranks, or those of `comm`.

        It runs in memory, without files, watchdog or progress, which `periporo.run` adds. Raises InputError.
        """
        if cls.reader is None:
            raise RuntimeError("nothing is here that reads scenes: get the class by `from periporo import Simulation`")
        return cls.reader(scene, MPI.COMM_WORLD if comm is None else comm)

    def call_every(self, interval: int, function: Callable[["Simulation"], object]) -> None:
        """Call `function(simulation)` on every rank after every `interval`-th step."""
        self.observers.append(Callback(interval, function))

    @property
    def ledger(self) -> Ledger:
        """Energies since the start."""
        if self._ledger is None:
            raise RuntimeError("there are no energies before the start: call `start`, or `run`")
        return self._ledger

    @ledger.setter
    def ledger(self, ledger: Ledger) -> None:
        self._ledger = ledger

    @property
    def reach(self) -> float:
        """Distance within which pairs are listed, m."""
        return self.scheme.horizon + self.skin

    @property
    def ghost_reach(self) -> float:
        """Distance within which a rank needs the points of others, m."""
        return self.farthest * _MARGIN

    def confirm(self) -> None:
        """Raise RefusedStep, on all ranks alike, if a law refused the last step; collective."""
        refusals, self.refusals = self.refusals, []
        if not any_rank(self.comm, bool(refusals)):
            return
        texts = self.comm.allgather([f"{r.law}: {r.reason}" for r in refusals])
        reasons = list(dict.fromkeys(text for of_rank in texts for text in of_rank))
        points = np.unique(np.concatenate([np.empty(0, np.int64), *(r.points for r in refusals)]))
        raise RefusedStep(f"step {self.step_number}: refused by {'; '.join(reasons)}", reasons[0], points)

    def evaluate_forces(self) -> None:
        """Strain, stress and forces of the present configuration, reached in `dt` with the present velocity."""
        p, b, dt, timing = self.particles, self.bonds, self.dt, self.timing
        self.halo.update(p, "position", "velocity")
        timing.lap("exchange")
        material_dt = np.inf if self.rate_independent else dt
        b.time, b.origin = self.reached(dt), self.origin
        self.scheme.deform(p, b, self.halo, dt, material_dt)
        b.tell(p)
        timing.lap("strain")
        for block in b.blocks:
            block.advance(material_dt)
        self.refusals = b.refusals()
        count, failed = b.failures(p.owned)
        self._failed += count
        if self.departures is not None:
            self.departures.condemn(p.id[failed])
        timing.lap("material")
        self.scheme.regularise(p, b, self.halo)
        timing.lap("regularity")
        for process in self.point_processes:
            process.update(p, b, dt)
        timing.lap("point processes")
        self.apply_loads(dt)

    def find_shapes(self) -> None:
        """Influence, shape tensors and shares of the present positions; no time passes."""
        kept = [(b.stress.copy(), b.state.copy()) for b in self.bonds.blocks]
        self.scheme.deform(self.particles, self.bonds, self.halo, 0.0, 0.0)
        for block, (stress, state) in zip(self.bonds.blocks, kept, strict=True):
            block.stress[:], block.state[:] = stress, state

    def reached(self, dt: float) -> float:
        """Time (s) at the end of a step of `dt`; relaxation holds it, and obstacles."""
        return self.time + (self.ahead if self.rate_independent else dt)

    def apply_loads(self, dt: float) -> None:
        """Forces of contacts and loads at the end of a step of `dt`, and the internal force, which bears them."""
        p, forces, timing = self.particles, self.forces, self.timing
        end = self.reached(dt)
        forces.book_moments(0.5 * dt)  # of the loads with which the step began
        forces.clear()
        for contact in self.contacts:
            contact.add_force(p, end, dt)
        timing.lap("contact")
        dampings = [load for load in self.loads if isinstance(load, ViscousDamping)]
        for load in self.loads:
            if load not in dampings:
                load.add_force(p, end, dt)
        timing.lap("loads")
        forces.book_moments(0.5 * dt)
        self.scheme.internal_force(p, self.bonds, self.halo, p.internal_force, forces.moment())
        timing.lap("internal force")
        for damping in dampings:  # which need all other forces
            damping.add_force(p, end, dt)
        timing.lap("loads")
        if self.added_inertia is not None:
            self.added_inertia.add_force(self)
            timing.lap("added inertia")

    def step(self) -> None:
        """Advance from t to t + dt: velocity Verlet, updated Lagrangian."""
        p, forces, timing = self.particles, self.forces, self.timing
        timing.start()
        if self.time_step.due(self.step_number):
            self.dt = self.time_step.choose(self)
            timing.lap("time step")
        chosen = self.dt
        self.dt = dt = kick_within(self, chosen)  # v at t + dt/2
        for motion in self.prescribed_motions:
            motion.apply(p, self.time + dt / 2, dt, closing_step=False)
        self.scheme.rearrange(p, self.prescribed_motions, self.contacts)
        self.moved, self.way = drift(p, forces, dt)  # x at t + dt
        if self.halo.images is not None:
            self.halo.images.settle(p.position[: p.owned])
        timing.lap("integration")
        if neighbours_are_stale(self):
            self.confirm()
            rebuild(self)
        timing.lap("rebuild")
        self.evaluate_forces()
        second_kick(p, forces, dt)  # v at t + dt
        for motion in self.prescribed_motions:
            motion.apply(p, self.time + dt, dt, closing_step=True)
        timing.lap("integration")
        self._advance_clock(dt)
        for observer in self.observers:  # output, energy, watchdog, progress
            observer.after_step(self)
        self.dt = chosen
        timing.lap("observers")

    def _advance_clock(self, dt: float) -> None:
        """Add `dt` to the time by a compensated sum (Kahan 1965)."""
        increment = dt - self._carry
        total = self.time + increment
        self._carry = (total - self.time) - increment
        self.time = total
        self.step_number += 1

    def reset_clock(self, time: float = 0.0) -> None:
        """Set the time, at the start of a stage."""
        self.time, self._carry = time, 0.0

    def start(self) -> None:
        """Bonds and forces of the initial configuration; compiles every kernel on the way."""
        rebuild(self)
        self.dt, self.rate_independent = 0.0, True
        self.evaluate_forces()
        self._confirm_start()
        for prepare in self.preparations:
            prepare(self)
        for contact in self.contacts:
            contact.appear(self.particles, self.time, None)
        self.apply_loads(0.0)
        self.rate_independent = False
        self.bonds.initial_stress = None  # from now on, a row without a past is a point that lands
        self.ledger = Ledger(self.comm, self.particles, None, self.departures, self.sleep, self.reactions)
        self.dt = self.time_step.choose(self)
        for refuse in self.refusals_of_step:
            refuse(self)

    def _confirm_start(self) -> None:
        """Raise InputError, on all ranks alike, if a law cannot begin with the stress or the strength of its rows."""
        try:
            self.confirm()
        except RefusedStep as refusal:
            raise InputError("scene", [Problem(("materials",), f"no start for {refusal.reason}")]) from None

    def run(self, resumed: bool = False) -> None:
        """Go through all stages; from the middle of one, if the state was put back from a checkpoint."""
        if self._ledger is None:
            self.start()
        for number in range(self.stage_number, len(self.stages)):
            self.stage_number = number
            self.stages[number].run(self, resumed)
            resumed = False

    def failed_updates(self) -> int:
        """How often an update of a row has failed so far, over all ranks; collective."""
        return self.comm.allreduce(self._failed)

    def memory(self) -> dict[str, Any]:
        """What a checkpoint keeps of clocks and counters; the same on all ranks; collective."""
        clocks = {name: getattr(self, name) for name in _REMEMBERED}
        if self.departures is not None:
            left = self.departures.memory()
            left["condemned"] = sorted(sum(self.comm.allgather(left["condemned"]), []))
            clocks["departures"] = left
        if self.sleep is not None:
            clocks["sleep"] = self.sleep.memory()
        return clocks | {"initial_kinetic": self.ledger.initial_kinetic, "failed_updates": self.failed_updates()}

    def recall(self, memory: dict[str, Any]) -> None:
        """Set the clocks and counters back."""
        for name in _REMEMBERED:
            setattr(self, name, memory[name])
        if self.departures is not None:
            self.departures.recall(memory["departures"])
        if self.sleep is not None:
            self.sleep.recall(memory["sleep"])
        self.refusals, self._failed = [], memory["failed_updates"] if self.comm.rank == 0 else 0
