"""How rigid obstacles move: along histories, and about an axis.

A motion is asked for the pose at a time. The velocity that a step saw is the difference of its two poses, so that what
the obstacle sweeps, what friction sees and what its forces work on agree, whatever the steps.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from periporo.core.numerics.histories import Course


@dataclass(frozen=True)
class Pose:
    """Where an obstacle is: turned by `turn` (d, d), if it is, about `about` (d,) m, then shifted by `shift` (d,) m."""

    shift: np.ndarray
    about: np.ndarray
    turn: np.ndarray | None = None

    def entered(self, position: np.ndarray) -> np.ndarray:
        """Positions (n, d) m as the obstacle's surface sees them, which stays where its entry says."""
        moved = position - self.shift
        return moved if self.turn is None else (moved - self.about) @ self.turn + self.about

    def left(self, position: np.ndarray) -> np.ndarray:
        """The other way round: where places (n, d) m of the surface are."""
        turned = position if self.turn is None else (position - self.about) @ self.turn.T + self.about
        return turned + self.shift

    def around(self, lower: np.ndarray, upper: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Corners (d,) m of the box around the surface's own box from `lower` to `upper`; infinite if that is."""
        if self.turn is None or not np.isfinite([lower, upper]).all():
            return lower + self.shift, upper + self.shift
        middle, half = 0.5 * (lower + upper), 0.5 * (upper - lower)
        middle, half = self.left(middle), np.abs(self.turn) @ half
        return middle - half, middle + half

    def directed(self, normal: np.ndarray) -> np.ndarray:
        """Directions (n, d) of the surface as they stand in space."""
        return normal if self.turn is None else normal @ self.turn.T

    def way(self, before: "Pose", radius: float) -> float:
        """Way (m), at most, from another pose to this one of what is within `radius` m of what it turns about."""
        way = float(np.sqrt(((self.shift - before.shift) ** 2).sum()))
        if self.turn is not None and before.turn is not None:
            way += radius * float(np.sqrt(((self.turn - before.turn) ** 2).sum()))
        return way

    @property
    def reference(self) -> np.ndarray:
        """Where the point is that it turns about, (d,) m."""
        return self.about + self.shift


class Motion(Protocol):
    """The motion of an obstacle."""

    def appear(self, time: float) -> None:
        """Begin, where the obstacle's entry says."""

    def advance(self, time: float, dt: float) -> Pose:
        """Go on to `time` s by a step of `dt` s, or stay if it is the time already; where it is then."""

    def pose(self, time: float) -> Pose:
        """Where it is, or will be, at `time` s."""

    def memory(self):
        """What a checkpoint keeps."""

    def recall(self, memory) -> None:
        """Go on from there."""


class Prescribed:
    """A shift along axes by courses of displacement (m), and a rotation by a course of angles (rad).

    Both count from where they are when the obstacle appears. In the plane angles count from x to y, in space as a
    right-handed screw turns about `axis` (3,); the axis goes through `about` (d,) m and is shifted with the obstacle.
    """

    def __init__(self, courses: Mapping[int, Course], about: Sequence[float], angle: Course | None = None, axis=None):
        self._courses, self._angle, self._about = courses, angle, np.asarray(about, float)
        self._axis = None if axis is None else np.asarray(axis, float) / np.sqrt(np.sum(np.square(axis)))
        self._since = 0.0  # s

    def appear(self, time: float) -> None:
        """See `Motion.appear`."""
        self._since = time

    def advance(self, time: float, dt: float) -> Pose:
        """See `Motion.advance`."""
        return self.pose(time)

    def pose(self, time: float) -> Pose:
        """See `Motion.pose`."""
        shift = np.zeros(len(self._about))
        for axis, course in self._courses.items():
            shift[axis] = course.displacement(time) - course.displacement(self._since)
        if self._angle is None:
            return Pose(shift, self._about)
        angle = self._angle.displacement(time) - self._angle.displacement(self._since)
        return Pose(shift, self._about, turned_by(angle, self._axis))

    def memory(self) -> float:
        """What a checkpoint keeps."""
        return self._since

    def recall(self, memory: float) -> None:
        """Go on from there."""
        self._since = memory


def velocity_between(before: Pose, after: Pose, dt: float, position: np.ndarray) -> np.ndarray:
    """Velocity (n, d) m/s of what is at `position` (n, d) m when a step of `dt` s ends; zero if it takes no time."""
    if dt == 0.0 or before is after:
        return np.zeros_like(position)
    if after.turn is None:
        return np.tile((after.shift - before.shift) / dt, (len(position), 1))
    return (position - before.left(after.entered(position))) / dt


def spin_between(before: Pose, after: Pose, dt: float) -> np.ndarray:
    """Angular velocity of a step of `dt` s, rad/s: (1,) in the plane, (3,) in space."""
    count = 1 if len(after.shift) == 2 else 3
    if dt == 0.0 or after.turn is None or before.turn is None:
        return np.zeros(count)
    turn = after.turn @ before.turn.T
    twice = np.array([turn[1, 0] - turn[0, 1]]) if count == 1 else np.array(
        [turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]]
    )  # fmt: skip
    sine = 0.5 * np.sqrt((twice**2).sum())
    cosine = 0.5 * (np.trace(turn) - (0.0 if count == 1 else 1.0))
    return 0.5 * twice * (np.arctan2(sine, cosine) / sine if sine > 0.0 else 1.0) / dt


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
