"""Boundary conditions: prescribed motion, tractions, gravity and mass-proportional damping."""

from abc import ABC, abstractmethod
from collections.abc import Callable

import numpy as np

from periporo.core.numerics import vectors
from periporo.core.numerics.jit import kernel
from periporo.core.points.faces import add_face_force, turn
from periporo.core.points.forces import INTEGRATION, PRESCRIBED, WORK, ForceChannels
from periporo.core.points.particles import Field, Particles
from periporo.core.ranks.reductions import exact_sum


class Motion(ABC):
    """What imposes velocities on points, after both kicks of a step."""

    name = ""
    """Of the boundary condition that it belongs to, if any."""

    end = 0.0
    """When (s) its last history ends; a stage that is to stop at rest waits for it."""

    def foresee(self, p: Particles, time: float, dt: float, velocity: np.ndarray) -> None:
        """Set the components of `velocity` (owned, d) that it will impose; zero, so that no step is cut, unless known.

        A step of `dt` is made shorter where points would go too far.
        """
        velocity[:] = 0.0

    def begin(self) -> None:  # noqa: B027 - not every motion remembers steps
        """A stage begins: no step has been closed in it."""

    @abstractmethod
    def apply(self, p: Particles, time: float, dt: float, closing_step: bool) -> None:
        """Impose the velocity of `time` in a step of `dt`: after the first kick, or the second (`closing_step`)."""

    def hold_zero(self, p: Particles, free: np.ndarray) -> None:
        """Set the components of `free` (owned, d) that it imposes to zero: all, if it does not say which."""
        free[:] = 0.0


class PrescribedMotion(Motion):
    """Velocity components of a set of points as functions of time; their reactions do the work `prescribed`.

    `ids` sorted global ids of the points; `velocities` maps an axis to a function of time and time step (s) in m/s,
    such as `VelocityHistory` and `DisplacementHistory`.

    In each half step a reaction holds up the other forces and moves with the point, and an impulse brings the point
    from one imposed velocity to the next, at the mean of both. So a boundary that starts or stops at once gives or
    takes the kinetic energy of its points exactly, and prescribed components have no error of integration.
    """

    def __init__(self, ids: np.ndarray, velocities: dict[int, Callable[[float, float], float]], name: str = ""):
        self.ids = ids
        self.name = name  # of the boundary condition that it belongs to
        self.velocities = velocities
        self.end = max((getattr(function, "end", 0.0) for function in velocities.values()), default=0.0)
        self._found = None
        self._closed: dict[int, tuple[np.ndarray, float, float]] = {}  # axis -> velocities (n,) before, imposed one, dt

    def foresee(self, p: Particles, time: float, dt: float, velocity: np.ndarray) -> None:
        """Set the components of `velocity` (owned, d) that it will impose."""
        rows = self._rows(p)
        for axis, function in self.velocities.items():
            velocity[rows, axis] = function(time, dt)

    def apply(self, p: Particles, time: float, dt: float, closing_step: bool) -> None:
        """Impose the velocity of `time` in a step of `dt`: after the first kick, or the second (`closing_step`).

        No other motion may prescribe the same component of a point: see `without_overlaps`.
        """
        rows = self._rows(p)
        for axis, function in self.velocities.items():
            kicked, before = p.velocity[rows, axis], p.previous_velocity[rows, axis]
            speed = function(time, dt)
            imposed = np.full(len(rows), speed)
            mass = p.mass[rows]
            half_step = before if closing_step else imposed
            impulse = 0.5 * (imposed - before) * (imposed + before)
            p.work[rows, PRESCRIBED] += mass * ((before - kicked) * half_step + impulse)
            booked = (kicked - before) ** 2 if closing_step else -((imposed - before) ** 2)  # by the kick, or the drift
            p.work[rows, INTEGRATION] -= 0.5 * mass * booked
            p.velocity[rows, axis] = imposed
            if closing_step:
                self._closed[axis] = kicked, speed, dt

    def begin(self) -> None:
        """A stage begins: no step has been closed in it."""
        self._closed = {}

    def reactions(self, p: Particles, forces: ForceChannels) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """What it did to its points at the end of the last step: rows (n,), forces (n, d) N and powers (n,) W.

        Before the first step of a stage, what holds up the other forces.
        """
        rows = self._rows(p)
        force, power = np.zeros((len(rows), p.dimension)), np.zeros(len(rows))
        others = forces.total()[rows]
        for axis in self.velocities:
            if axis in self._closed:
                kicked, speed, dt = self._closed[axis]
                force[:, axis] = p.mass[rows] * (speed - kicked) / (0.5 * dt)
                power += speed * force[:, axis]
            else:
                force[:, axis] = -others[:, axis]
        return rows, force, power

    def hold_zero(self, p: Particles, free: np.ndarray) -> None:
        """Set the prescribed components of `free` (owned, d) to zero."""
        rows = self._rows(p)
        for axis in self.velocities:
            free[rows, axis] = 0.0

    def _rows(self, p):
        """Owned rows of the points; found anew when a rebuild has moved them."""
        if self._found is None or self._found[0] is not p.id:
            self._found = p.id, np.flatnonzero(np.isin(p.id[: p.owned], self.ids, assume_unique=True))
        return self._found[1]


def without_overlaps(motions: list[PrescribedMotion]) -> list[PrescribedMotion]:
    """Motions of which no two prescribe the same component of a point: where some do, the last one has it."""
    taken: dict[int, np.ndarray] = {}
    separate = []
    for motion in reversed(motions):
        for axis, velocity in motion.velocities.items():
            others = taken.get(axis, np.empty(0, np.int64))
            ids = np.setdiff1d(motion.ids, others, assume_unique=True)
            taken[axis] = np.union1d(others, ids)
            separate.append(PrescribedMotion(ids, {axis: velocity}, motion.name))
    return separate[::-1]


class VelocityHistory:
    """Velocity that is linear between `values` (k,) m/s at `times` (k,) s, for `PrescribedMotion`."""

    def __init__(self, times, values):
        self.times, self.values = times, values

    @property
    def end(self) -> float:
        """Time (s) of its last entry."""
        return float(self.times[-1])

    def __call__(self, time: float, dt: float) -> float:
        return float(np.interp(time, self.times, self.values))


class DisplacementHistory(VelocityHistory):
    """Velocity with which every step ends at the displacement of its time, `values` (k,) m at `times` (k,) s.

    A difference over the step around `time`: the drifts of the steps add up to the displacement, whatever the steps.
    """

    def __call__(self, time: float, dt: float) -> float:
        after, before = np.interp([time + 0.5 * dt, time - 0.5 * dt], self.times, self.values)
        return float((after - before) / dt)


class Gravity:
    """Weight of every point, m g, times a `factor` of the time if there is one."""

    def __init__(self, acceleration: np.ndarray, factor: Callable[[float], float] | None = None):
        self.acceleration, self.factor = np.asarray(acceleration, float), factor

    def add_force(self, p: Particles, time: float, dt: float) -> None:
        """Add to the external force."""
        acceleration = self.acceleration if self.factor is None else self.factor(time) * self.acceleration
        _add_weight(p.owned, p.mass, acceleration, p.external_force, p.dim)


class Traction:
    """A dead load, a `force` (ids, d) N (per metre of a ring's face) on a face of each of the points `ids`, sorted.

    The faces are `lever` (ids, d) m away from their points when the scene begins, and turn with them from then on, in
    the point field `face_<name>`. A `factor` of the time multiplies the force.
    """

    def __init__(
        self, name: str, ids: np.ndarray, force: np.ndarray, lever: np.ndarray,
        factor: Callable[[float], float] | None = None,
    ):  # fmt: skip
        self.name, self.factor = name, factor
        self.ids = ids
        self.force = force
        self.lever = lever
        self.face = f"face_{name}"
        self._found: tuple[np.ndarray, np.ndarray, np.ndarray] | None = None  # ids of the points, rows, their forces

    output = ()

    def attach(self, p: Particles, forces: ForceChannels, processes: list) -> None:
        """Declare the force channel, and the faces of points that are in place, which a process turns from now on.

        A load of the same name, in another stage, has the same faces.
        """
        forces.need("external", on_faces=True)
        if self.face not in p.fields:
            p.add_field(Field(self.face, p.dimension, "m", sent=False))
            rows, _ = self._rows(p)
            getattr(p, self.face)[rows] = self.lever[np.searchsorted(self.ids, p.id[rows])]
            processes.append(self)

    def update(self, p: Particles, bonds, dt: float) -> None:
        """Turn the faces by a step of `dt` s, a process of the points."""
        turn(getattr(p, self.face), p.gradient, dt)

    def add_force(self, p: Particles, time: float, dt: float) -> None:
        """Add to the external force."""
        rows, force = self._rows(p)
        if self.factor is not None:
            force = self.factor(time) * force
        _load_faces(
            rows, force, getattr(p, self.face), p.share, p.widths(), p.external_force, p.external_moment, p.dim
        )

    def _rows(self, p):
        """Owned rows of the points, and their forces; found anew when a rebuild has moved them."""
        if self._found is None or self._found[0] is not p.id:
            rows = np.flatnonzero(np.isin(p.id[: p.owned], self.ids, assume_unique=True))
            self._found = p.id, rows, self.force[np.searchsorted(self.ids, p.id[rows])]
        return self._found[1:]


class ViscousDamping:
    """Damping -rate m v, integrated exactly over a step in which the other forces are constant, whatever the rate.

    Velocities half a step before and after the force obey v+ = v- e^(-x) + a dt (1 - e^(-x))/x, x = rate dt, with the
    acceleration a of all other forces: free motion decays as exp(-rate t), and a load is followed at a/rate. `upcoming`
    is a function that gives the next step, s: at the start of a stage its first half is ahead. With a `base`, v is
    relative to the velocity v_b (d,) m/s that it gives: rate m v_b is external, for it gives energy where soil lags
    behind.
    """

    def __init__(
        self, rate: float, upcoming: Callable[[], float] = lambda: 0.0,
        base: Callable[[Particles], np.ndarray] | None = None,
    ):  # fmt: skip
        self.rate, self.upcoming, self.base = rate, upcoming, base

    def add_force(self, p: Particles, time: float, dt: float) -> None:
        """Set the damping force; the last of the loads, for it needs the others."""
        step = dt if dt > 0.0 else 0.5 * self.upcoming()
        x = self.rate * step
        decay, lag = (-np.expm1(-x) / step, 1.0 + np.expm1(-x) / x) if x > 1e-6 else (self.rate, 0.5 * x)
        others = tuple(getattr(p, f"{n}_force") for n in WORK if n != "damping" and f"{n}_force" in p.fields)
        if self.base is not None:
            p.external_force[: p.owned] += self.rate * p.mass[: p.owned, None] * self.base(p)
        _damp(p.owned, p.mass, p.velocity, others, decay, lag, p.damping_force, p.dim)


class MeanVelocity:
    """Mean velocity (d,) m/s of the points `ids` (sorted) of all ranks; collective."""

    def __init__(self, comm, ids: np.ndarray):
        self.comm, self.ids = comm, ids

    def __call__(self, p: Particles) -> np.ndarray:
        velocity = p.velocity[: p.owned][np.isin(p.id[: p.owned], self.ids, assume_unique=True)]
        *sums, count = exact_sum(self.comm, np.column_stack([velocity, np.ones(len(velocity))]))
        return np.array(sums) / max(count, 1.0)


@kernel
def _load_faces(rows, force, face, share, width, external, moment, dim):
    lever, load = np.zeros(len(dim)), np.zeros(len(dim))
    for k in range(rows.shape[0]):
        i = rows[k]
        for a in range(len(dim)):
            lever[a] = share[i, 1] * face[i, a]
            load[a] = force[k, a] * (width[i] + 2.0 * np.pi * face[i, 0]) if width.shape[0] > 0 else force[k, a]
        add_face_force(external, moment, i, load, lever)


@kernel
def _add_weight(owned, mass, acceleration, force, dim):
    for i in range(owned):
        for a in range(len(dim)):
            force[i, a] += mass[i] * acceleration[a]


@kernel
def _damp(owned, mass, velocity, others, decay, lag, damping, dim):
    for i in range(owned):
        total = vectors.zero(dim)
        for force in others:
            total += vectors.row(force, i, dim)
        vectors.put(damping, i, vectors.row(velocity, i, dim) * (-decay * mass[i]) - total * lag)
