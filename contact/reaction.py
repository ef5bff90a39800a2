"""What an obstacle bears: force, torque about its reference, power, and their sums over time.

The points' forces of a contact are what their channels gain while it adds its own. Velocity Verlet takes half of a
step's impulse with the forces at its start and half with those at its end; so does the sum over time, which therefore
is in balance with the momentum of the points to rounding.
"""

from dataclasses import dataclass

import numpy as np

from periporo.contact.motion import Motion, Pose, spin_between
from periporo.core.numerics.jit import kernel
from periporo.core.points.particles import Particles


@dataclass(frozen=True)
class Feelers:
    """Where a free obstacle feels others: balls around `places` (n, d) m at first, of `radius` m.

    `stiffness` N/m and `mass` kg of each, by which damping counts. `softness` 1/kg: acceleration of the obstacle's
    surface by a force of 1 N, at most.
    """

    places: np.ndarray
    radius: float
    stiffness: float
    mass: float
    softness: float


_FORCES = ("contact_force", "contact_moment", "friction_force", "friction_moment")


class Reaction:
    """Force (N) on the obstacle `name`, and torque (N m) about a reference that moves with it, `about` (d,) m at first.

    `watch` before a contact adds its forces and `take` after it fill `rows`; `add_up` makes figures of their sum over
    all ranks. Positive power and work (W, J) are what the obstacle gives to the points. Of a `motion`, displacement,
    velocity and spin are told, too, and the kinetic energy of a free one.
    """

    def __init__(self, name: str, about: np.ndarray, motion: Motion | None = None):
        self.name, self.about, self.motion = name, np.asarray(about, float), motion
        d = self.dimension = len(self.about)
        self.loads = np.zeros((2, d + (1 if d == 2 else 3)))  # of the channels contact and friction, on the obstacle
        self.work = np.zeros(2)  # J, through each of them
        self.impulse = np.zeros(d)  # N s
        self.peak = 0.0  # N, largest force since it was last told
        self.power = 0.0
        self.rows = np.zeros((0, self.loads.size))
        self._points = np.empty(0, np.int64)  # rows of the points that these belong to
        self._before, self._step = np.zeros((0, 0)), np.zeros(self.loads.shape[1])
        self._shift = np.zeros(d)

    def watch(self, p: Particles, rows: np.ndarray) -> None:
        """Remember the forces on `rows` before the contact adds its own."""
        self._before = self._forces(p, rows)

    def take(self, p: Particles, rows: np.ndarray, before: Pose | None, after: Pose | None, dt: float) -> None:
        """Fill `rows` with what it added, in a step of `dt` s in which the obstacle moved."""
        gained = self._forces(p, rows) - self._before
        reference = self.about if after is None else after.reference
        self.rows, self._points = np.zeros((len(rows), self.loads.size)), rows
        _add_loads(gained, p.position[rows] - reference, self.rows, self.dimension)
        if before is not None and after is not None:
            speed = (after.shift - before.shift) / dt if dt > 0.0 else np.zeros(self.dimension)
            self._step, self._shift = np.concatenate([speed, spin_between(before, after, dt)]), after.shift

    def add_up(self, sums: np.ndarray, dt: float) -> None:
        """Take the sum of `rows` over all ranks at the end of a step of `dt` s."""
        before, self.loads = self.loads, sums.reshape(self.loads.shape)
        mean = 0.5 * (before + self.loads)
        self.work -= dt * (mean @ self._step)
        self.impulse += dt * mean.sum(axis=0)[: self.dimension]
        total = self.loads.sum(axis=0)
        self.power = -float(total @ self._step)
        self.peak = max(self.peak, float(np.sqrt((total[: self.dimension] ** 2).sum())))

    def vanish(self) -> None:
        """Bear nothing: the obstacle is not there."""
        self.loads[:], self.power = 0.0, 0.0
        self.leave()

    def leave(self) -> None:
        """No point of this rank is near."""
        if len(self.rows):
            self.rows, self._points = self.rows[:0], self._points[:0]

    @property
    def derived(self) -> dict:
        """What may be written of points: the force of each on the obstacle, (owned, d) N."""
        return {f"force_on_{self.name}": (self.dimension, "N", self._on_obstacle)}

    def _on_obstacle(self, p, n):
        forces, d, width = np.zeros((n, self.dimension)), self.dimension, self.loads.shape[1]
        forces[self._points] = self.rows[:, :d] + self.rows[:, width : width + d]
        return forces

    @property
    def units(self) -> dict[str, str]:
        """Units of the histories."""
        axes, turns = [f"_{a}" for a in "xyz"[: self.dimension]], ("",) if self.dimension == 2 else ("_x", "_y", "_z")
        told = [("force", axes, "N"), ("torque", turns, "N m"), ("power", [""], "W"), ("work", [""], "J"),
                ("impulse", axes, "N s"), ("peak_force", [""], "N")]  # fmt: skip
        if self.motion is not None:
            told += [("displacement", axes, "m"), ("velocity", axes, "m/s"), ("spin", turns, "rad/s")]
        if hasattr(self.motion, "kinetic"):
            told += [("kinetic_energy", [""], "J")]
        return {f"{self.name}_{what}{part}": unit for what, parts, unit in told for part in parts}

    def histories(self, sim) -> dict[str, float]:
        """What is told now, by history name; the next peak counts from here."""
        peak, self.peak = self.peak, 0.0
        total = self.loads.sum(axis=0).tolist()
        values: list[float] = [*total, self.power, float(self.work.sum()), *self.impulse.tolist(), peak]
        if self.motion is not None:
            values += [*self._shift.tolist(), *self._step.tolist()]
        kinetic = getattr(self.motion, "kinetic", None)
        if kinetic is not None:
            values.append(kinetic())
        return dict(zip(self.units, values, strict=True))

    def memory(self) -> dict:
        """What a checkpoint keeps."""
        return {
            "loads": self.loads.tolist(), "work": self.work.tolist(), "impulse": self.impulse.tolist(),
            "peak": self.peak, "power": self.power,
        }  # fmt: skip

    def recall(self, memory: dict) -> None:
        """Go on from there."""
        for name in ("loads", "work", "impulse"):
            setattr(self, name, np.array(memory[name]))
        self.peak, self.power = memory["peak"], memory["power"]

    def _forces(self, p, rows):
        return np.concatenate([getattr(p, name)[rows] for name in _FORCES], axis=1)


@kernel
def _add_loads(gained, arm, rows, d):
    """Force and torque on the obstacle, with the arms (n, d) m of the points; a face is its moment's arm farther."""
    width = d + d * d
    count = rows.shape[1] // 2
    for k in range(rows.shape[0]):
        for c in range(2):
            force, moment = c * width, c * width + d
            for a in range(d):
                rows[k, c * count + a] = -gained[k, force + a]
            for t in range(count - d):
                a, b = (t + 1) % 3 if d == 3 else 0, (t + 2) % 3 if d == 3 else 1
                turn = arm[k, a] * gained[k, force + b] - arm[k, b] * gained[k, force + a]
                turn += gained[k, moment + b * d + a] - gained[k, moment + a * d + b]
                rows[k, c * count + d + t] = -turn
