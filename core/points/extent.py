"""Where the bodies of a scene stand at the start, from which their motion is measured."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np


@dataclass(frozen=True)
class Extent:
    """The box around all bodies, from `lower` to `upper` (d,) m, and the unit vector `up` (d,) against gravity.

    Without gravity the last axis points up.
    """

    lower: np.ndarray
    upper: np.ndarray
    up: np.ndarray

    @property
    def middle(self) -> np.ndarray:
        """Centre (d,) m of the box."""
        return 0.5 * (self.lower + self.upper)

    @property
    def size(self) -> float:
        """Largest side of the box, m."""
        return float((self.upper - self.lower).max())

    @cached_property
    def base(self) -> float:
        """Level of the lowest corner along `up`, m."""
        return float(np.where(self.up > 0.0, self.lower, self.upper) @ self.up)

    @cached_property
    def _across(self) -> list[np.ndarray]:
        """Unit vectors across `up`: the axes, if gravity is along one."""
        axes = np.eye(len(self.up))
        vertical = int(np.argmax(np.abs(self.up)))
        if np.count_nonzero(self.up) == 1:
            return [axis for k, axis in enumerate(axes) if k != vertical]
        others = np.delete(axes, vertical, axis=0)
        return list(np.linalg.qr(np.column_stack([self.up, *others]))[0].T[1:])

    def height(self, position: np.ndarray) -> np.ndarray:
        """Height (n,) m of positions (n, d) above the lowest place of the bodies at the start."""
        return _along(position, self.up) - self.base

    def distance(self, position: np.ndarray) -> np.ndarray:
        """Distance (n,) m from the vertical axis through the middle of the bodies at the start.

        Along that of the axes across gravity on which it is largest.
        """
        largest = np.zeros(len(position))
        for direction in self._across:
            start = float(self.middle @ direction)
            np.maximum(largest, np.abs(_along(position, direction) - start), out=largest)
        return largest


def _along(position, direction):
    """Component (n,) along a unit vector; not by BLAS, whose last bit depends on n."""
    axes = np.flatnonzero(direction)
    if len(axes) == 1:
        return position[:, axes[0]] * direction[axes[0]]
    return (position * direction).sum(axis=1)
