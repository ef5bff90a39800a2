"""A rigid surface in its place: one that stands, or one that a motion carries from step to step."""

import numpy as np

from periporo.contact.motion import Motion, Pose
from periporo.contact.surfaces import Surface
from periporo.core.points.particles import Particles

_LOOKS = 100  # along the way of an obstacle


class Obstacle:
    """A rigid `surface`, where its entry says when it appears, and from there on where its `motion` carries it.

    `pose` is where it is at the end of the last step, `pose_before` where it was at its start; None if it stands.
    """

    def __init__(self, surface: Surface, reach: float, motion: Motion | None = None):
        """`reach` m is how far from its surface it touches points."""
        self.surface, self.reach, self.motion = surface, reach, motion
        self._time: float | None = None  # s, of the pose
        self.pose: Pose | None = None
        self.pose_before: Pose | None = None

    def stand(self, time: float) -> None:
        """Be where the entry says at `time` s, and move from there on."""
        if self.motion is not None:
            self.motion.appear(time)
            self._time = time
            self.pose = self.pose_before = self.motion.pose(time)

    def advance(self, time: float, dt: float) -> None:
        """Move to its place at the end of the step; while relaxation holds the time, it stands still."""
        if self.motion is not None:
            self.pose_before = self.pose
            if time != self._time:
                self._time, self.pose = time, self.motion.advance(time, dt)

    def pose_at(self, time: float) -> Pose | None:
        """Where it is, or will be, at `time` s."""
        return None if self.motion is None else self.motion.pose(time)

    def gap(self, position: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Gap (n,) m of positions (n, d) to the obstacle where it is now, and normal (n, d) of its surface."""
        return self.gap_at(position, self.pose)

    def gap_at(self, position: np.ndarray, pose: Pose | None) -> tuple[np.ndarray, np.ndarray]:
        """The same of the obstacle in another pose."""
        if pose is None:
            return self.surface.gap(position)
        gap, normal = self.surface.gap(pose.entered(position))
        return gap, pose.directed(normal)

    def outline(self, p: Particles, time: float, middle: np.ndarray, size: float):
        """How the obstacle is drawn at this time, see `Surface.outline`."""
        pose = self.pose_at(time)
        if pose is None:
            return self.surface.outline(middle, size)
        points, cells = self.surface.outline(pose.entered(middle[None])[0], size)
        return pose.left(points), cells

    def will_push(self, p: Particles, time: float, until: float) -> bool:
        """Whether the obstacle moves, and meets a point of this rank where it is now before the time `until`."""
        if self.motion is None:
            return False
        x = p.position[: p.owned]
        gaps = (self.gap_at(x, self.motion.pose(t))[0] for t in np.linspace(time, until, _LOOKS))
        return any(gap.min(initial=np.inf) < self.reach for gap in gaps)

    def memory(self) -> dict:
        """What a checkpoint keeps."""
        return {"time": self._time} | ({} if self.motion is None else {"motion": self.motion.memory()})

    def recall(self, memory: dict) -> None:
        """Go on from there."""
        self._time = memory["time"]
        if self.motion is not None:
            self.motion.recall(memory["motion"])
            self.pose = self.pose_before = None if self._time is None else self.motion.pose(self._time)
