"""Free obstacles: rigid bodies that gravity, contact and given forces move.

Velocity Verlet, as for the points: half a kick with the forces at the start of a step, the drift, and half a kick with
those at its end. In space a body keeps its angular momentum; it turns by the spin of the middle of the step, so that
the error is of second order and the energy does not drift.
"""

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from periporo.contact.motion import Pose, turned_by

_HELD_TURN = "rotation"


class Free:
    """The motion of a free body with its centre of mass at `centre` (d,) m.

    `mass` kg, `inertia` (1, 1) or (3, 3) kg m^2 about the centre, in the plane both per metre; `radius` m of the
    farthest place from the centre. `force` maps an axis to a given force (N) on the centre as a function of time (s).
    Components of `held`, axes and "rotation", stay as they are.
    """

    def __init__(
        self, centre: Sequence[float], mass: float, inertia: np.ndarray, radius: float, gravity: np.ndarray, *,
        force: Mapping[int, Callable[[float], float]] | None = None, held: Sequence[int | str] = (),
        velocity: np.ndarray | None = None,
    ):  # fmt: skip
        self.centre, self.mass, self.inertia, self.radius = np.asarray(centre, float), mass, inertia, radius
        d = len(self.centre)
        self._first = np.zeros(d) if velocity is None else np.asarray(velocity, float)
        self._gravity, self._force, self._turns = np.asarray(gravity, float), dict(force or {}), _HELD_TURN not in held
        self._free = np.array([axis not in held for axis in range(d)])
        self._load, self._torque = np.zeros(d), np.zeros(len(inertia))
        self.appear(0.0)

    def appear(self, time: float) -> None:
        """See `Motion.appear`."""
        d = len(self.centre)
        self._time, self._pose = time, Pose(np.zeros(d), self.centre, np.eye(d) if self._turns else None)
        self.velocity, self.momentum = self._first, np.zeros(len(self.inertia))  # m/s; angular, N m s

    def advance(self, time: float, dt: float) -> Pose:
        """See `Motion.advance`."""
        self._kick(0.5 * dt)
        turn = self._pose.turn
        if turn is not None:
            half = _rotation(0.5 * dt * self.spin(turn)) @ turn
            turn = _rotation(dt * self.spin(half)) @ turn
        self._pose = Pose(self._pose.shift + dt * self.velocity, self.centre, turn)
        self._time = time
        return self._pose

    def close(self, load: np.ndarray, torque: np.ndarray, time: float, dt: float) -> None:
        """End a step of `dt` s with the forces (d,) N and the torque (k,) N m about the centre that then act."""
        given = np.array([self._force[a](time) if a in self._force else 0.0 for a in range(len(self.centre))])
        self._load, self._torque = load + given + self.mass * self._gravity, np.asarray(torque, float)
        self._kick(0.5 * dt)

    def pose(self, time: float) -> Pose:
        """See `Motion.pose`; in the future as if nothing acted on it."""
        ahead = time - self._time
        if ahead == 0.0:
            return self._pose
        turn = self._pose.turn
        if turn is not None:
            turn = _rotation(ahead * self.spin(turn)) @ turn
        return Pose(self._pose.shift + ahead * self.velocity, self.centre, turn)

    def spin(self, turn: np.ndarray | None = None) -> np.ndarray:
        """Angular velocity, rad/s: (1,) in the plane, (3,) in space."""
        if not self._turns:
            return np.zeros(len(self.momentum))
        turn = self._pose.turn if turn is None else turn
        if len(self.momentum) == 1 or turn is None:
            return self.momentum / self.inertia[0, 0]
        return turn @ np.linalg.solve(self.inertia, turn.T @ self.momentum)

    def kinetic(self) -> float:
        """Kinetic energy, J."""
        return 0.5 * float(self.mass * self.velocity @ self.velocity + self.momentum @ self.spin())

    def softness(self) -> float:
        """Acceleration of its surface by a force of 1 N, at most, 1/kg: what stiff contacts move."""
        moved = 1.0 / self.mass if self._free.any() else 0.0
        return moved + (self.radius**2 / float(np.linalg.eigvalsh(self.inertia)[0]) if self._turns else 0.0)

    def memory(self) -> dict:
        """What a checkpoint keeps."""
        turn = self._pose.turn
        return {
            "time": self._time, "shift": self._pose.shift.tolist(), "turn": None if turn is None else turn.tolist(),
            "velocity": self.velocity.tolist(), "momentum": self.momentum.tolist(), "load": self._load.tolist(),
            "torque": self._torque.tolist(),
        }  # fmt: skip

    def recall(self, memory: dict) -> None:
        """Go on from there."""
        turn = None if memory["turn"] is None else np.array(memory["turn"])
        self._time, self._pose = memory["time"], Pose(np.array(memory["shift"]), self.centre, turn)
        self.velocity, self.momentum = np.array(memory["velocity"]), np.array(memory["momentum"])
        self._load, self._torque = np.array(memory["load"]), np.array(memory["torque"])

    def _kick(self, time):
        self.velocity = self.velocity + np.where(self._free, time * self._load / self.mass, 0.0)
        if self._turns:
            self.momentum = self.momentum + time * self._torque


def _rotation(vector: np.ndarray) -> np.ndarray:
    """Matrix (d, d) of a rotation by a vector (rad), (1,) in the plane."""
    if len(vector) == 1:
        return turned_by(float(vector[0]), None)
    angle = float(np.sqrt((vector**2).sum()))
    return turned_by(angle, vector / angle) if angle > 0.0 else np.eye(3)
