"""How rigid obstacles move: along histories, and about an axis.

A motion is asked for the pose at a time, counted from when the obstacle appeared, and tells the velocity with which a
step brought it there: the difference of two poses over the step, so that what the obstacle sweeps and what friction
sees agree, whatever the steps.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from periporo.core.numerics.histories import Course


@dataclass(frozen=True)
class Pose:
    """Where an obstacle is: turned by `turn` (d, d) about `about` (d,) m, then shifted by `shift` (d,) m."""

    shift: np.ndarray
    turn: np.ndarray | None = None
    about: np.ndarray | None = None

    def entered(self, position: np.ndarray) -> np.ndarray:
        """Positions (n, d) m as the obstacle's surface sees them, which stays where its entry says."""
        moved = position - self.shift
        return moved if self.turn is None else (moved - self.about) @ self.turn + self.about

    def left(self, position: np.ndarray) -> np.ndarray:
        """The other way round: where places (n, d) m of the surface are."""
        turned = position if self.turn is None else (position - self.about) @ self.turn.T + self.about
        return turned + self.shift

    def directed(self, normal: np.ndarray) -> np.ndarray:
        """Directions (n, d) of the surface as they stand in space."""
        return normal if self.turn is None else normal @ self.turn.T


class Motion(Protocol):
    """The motion of an obstacle."""

    def pose(self, time: float) -> Pose:
        """Where it is at `time` s."""


class Shift:
    """A shift by a constant `velocity` (d,) m/s since the time 0 of the motion."""

    def __init__(self, velocity: np.ndarray):
        self.velocity = np.asarray(velocity, float)

    def pose(self, time: float) -> Pose:
        """See `Motion.pose`."""
        return Pose(time * self.velocity)


class Along:
    """A shift by `courses` for each axis that has one, from where they are at the time `begin` (s) of the run."""

    def __init__(self, courses: dict[int, Course], dimension: int):
        self.courses, self.dimension = courses, dimension
        self.begin = 0.0

    def pose(self, time: float) -> Pose:
        """See `Motion.pose`."""
        shift = np.zeros(self.dimension)
        for axis, course in self.courses.items():
            shift[axis] = course.displacement(time) - course.displacement(self.begin)
        return Pose(shift)


class Rotation:
    """A rotation by an angle (rad), a function of time, about an axis through `about` (d,) m, on top of a motion.

    In the plane the angle counts from x to y, in space as a right-handed screw turns about `axis` (3,). The axis moves
    with the other motion.
    """

    def __init__(self, angle: Callable[[float], float], about: Sequence[float], axis, base: Motion):
        self.angle, self.about, self.base = angle, np.asarray(about, float), base
        self.axis = None if axis is None else np.asarray(axis, float) / np.sqrt(np.sum(np.square(axis)))

    def pose(self, time: float) -> Pose:
        """See `Motion.pose`."""
        return Pose(self.base.pose(time).shift, turned_by(self.angle(time), self.axis), self.about)


def turned_by(angle: float, axis: np.ndarray | None) -> np.ndarray:
    """Matrix (d, d) of a rotation by `angle` rad, about a unit `axis` (3,) or, without, in the plane.

    >>> np.round(turned_by(np.pi / 2, None) @ [1.0, 0.0], 12).tolist()
    [0.0, 1.0]
    >>> np.round(turned_by(np.pi / 2, np.array([0.0, 0.0, 1.0])) @ [1.0, 0.0, 2.0], 12).tolist()
    [0.0, 1.0, 2.0]
    """
    c, s = np.cos(angle), np.sin(angle)
    if axis is None:
        return np.array([[c, -s], [s, c]])
    x, y, z = axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return c * np.eye(3) + s * cross + (1.0 - c) * np.outer(axis, axis)
