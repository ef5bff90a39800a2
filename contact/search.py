"""Which points lie near an obstacle: a grid over all points, which the obstacles of a scene share."""

import numpy as np

from periporo.core.numerics.jit import kernel
from periporo.core.points.particles import Particles

_CELLS = 48  # along the longest side of the box around all points


class Search:
    """Owned points by the cells in which they were when the neighbours were found; made anew after a rebuild."""

    def __init__(self) -> None:
        self._ids: np.ndarray | None = None
        self._order = self._keys = self._lost = np.empty(0, np.int64)
        self._filled: np.ndarray | None = None
        self._speed = 0.0
        self._lower, self._cell, self._counts = np.zeros(0), 1.0, np.zeros(0, np.int64)

    def near(self, p: Particles, lower: np.ndarray, upper: np.ndarray) -> np.ndarray:
        """Rows, ascending, of all points in the box from `lower` to `upper` (d,) m, and of some more.

        Those of unknown place (NaN) are always among them.
        """
        if not np.isfinite(lower).any() and not np.isfinite(upper).any():
            return np.arange(p.owned)
        if self._ids is not p.id:
            self._sort(p)
        ends = np.stack([lower, upper]) - self._lower
        first, last = np.clip(np.floor(ends / self._cell), [[0], [-1]], [self._counts, self._counts - 1]).astype(int)
        if (first > last).any():
            return self._lost
        *axes, run = (np.arange(a, b + 1) for a, b in zip(first, last, strict=True))
        rows = np.zeros(1, np.int64)  # of cells along the last axis
        for axis, places in enumerate(axes):
            rows = (rows[:, None] * self._counts[axis] + places).ravel()
        starts = np.searchsorted(self._keys, rows * self._counts[-1] + run[0])
        stops = np.searchsorted(self._keys, rows * self._counts[-1] + run[-1], side="right")
        found = [self._order[a:b] for a, b in zip(starts, stops, strict=True) if b > a]
        return np.sort(np.concatenate([self._lost, *found]))

    def fastest(self, p: Particles, filled: np.ndarray | None) -> float:
        """Largest speed (m/s) of the owned points, looked for once while the same array is `filled`."""
        if filled is None or self._filled is not filled:
            self._filled, self._speed = filled, largest_length(p.velocity[: p.owned])
        return self._speed

    def _sort(self, p):
        self._ids = p.id
        x = p.reference_position[: p.owned]
        known = np.isfinite(x).all(axis=1)
        self._lost, rows = np.flatnonzero(~known), np.flatnonzero(known)
        x = x[rows]
        d = p.dimension
        self._lower = x.min(axis=0) if len(x) else np.zeros(d)
        sides = x.max(axis=0) - self._lower if len(x) else np.zeros(d)
        self._cell = float(sides.max(initial=0.0)) / _CELLS or 1.0
        self._counts = np.floor(sides / self._cell).astype(np.int64) + 1
        keys = np.zeros(len(x), np.int64)
        for axis, count in enumerate(self._counts):
            keys = keys * count + np.floor((x[:, axis] - self._lower[axis]) / self._cell).astype(np.int64)
        order = np.argsort(keys, kind="stable")
        self._order, self._keys = rows[order], keys[order]


def largest_length(vectors):
    """Largest length of vectors (n, d), of those that are known."""
    return float(np.sqrt(_largest_square(vectors)))


@kernel
def _largest_square(vectors):
    largest = 0.0
    for i in range(vectors.shape[0]):
        square = 0.0
        for a in range(vectors.shape[1]):
            square += vectors[i, a] * vectors[i, a]
        if square > largest:
            largest = square
    return largest
