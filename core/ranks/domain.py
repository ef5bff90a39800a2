"""Who owns what: recursive coordinate bisection of space among the ranks."""

from dataclasses import dataclass

import numpy as np
from mpi4py import MPI

from periporo.core.ranks.reductions import minimum

_BISECTIONS = 40


@dataclass(frozen=True)
class Domain:
    """A box of space for each rank, in an order that every rank knows.

    `lower`, `upper` (ranks, d) m; outer faces are infinite. `cuts` lists (box, axis, position, new box) in
    the order in which boxes were cut: points above the cut go to the new box.
    """

    lower: np.ndarray
    upper: np.ndarray
    cuts: tuple[tuple[int, int, float, int], ...]

    def owner(self, position: np.ndarray) -> np.ndarray:
        """Rank that owns each of the positions (n, d), (n,) int."""
        box = np.zeros(len(position), np.int64)
        for source, axis, cut, target in self.cuts:
            box[(box == source) & (position[:, axis] >= cut)] = target
        return box

    def distance(self, rank: int, position: np.ndarray) -> np.ndarray:
        """Distance of the positions (n, d) to the box of `rank`, (n,) m."""
        outside = np.maximum(np.maximum(self.lower[rank] - position, position - self.upper[rank]), 0.0)
        return np.sqrt((outside**2).sum(axis=1))

    def near(self, rank: int, reach: float) -> list[int]:
        """Other ranks whose boxes come within `reach` m of the box of `rank`."""
        gap = np.maximum(np.maximum(self.lower - self.upper[rank], self.lower[rank] - self.upper), 0.0)
        close = (gap**2).sum(axis=1) < reach**2
        return [r for r in np.flatnonzero(close).tolist() if r != rank]


def bisect(comm: MPI.Comm, position: np.ndarray, weight: np.ndarray) -> Domain:
    """Domain that gives each rank about the same sum of `weight` (n,), points at `position` (n, d).

    Each box is cut across its longest side, in proportion to the ranks on either side; all ranks take part
    in every cut and hold only their own points.
    """
    ranks, d = comm.size, position.shape[1]
    box = np.zeros(len(position), np.int64)
    lower, upper = np.full((ranks, d), -np.inf), np.full((ranks, d), np.inf)
    cuts = []
    open_boxes = [(0, ranks)]  # (first rank, number of ranks) still to be cut
    while any(count > 1 for _, count in open_boxes):
        next_boxes = []
        for first, count in open_boxes:
            if count == 1:
                next_boxes.append((first, count))
                continue
            inside = box == first
            below = count // 2
            axis, cut = _cut(comm, position[inside], weight[inside], below / count)
            target = first + below
            box[inside & (position[:, axis] >= cut)] = target
            lower[target], upper[target] = lower[first], upper[first]
            upper[first, axis] = lower[target, axis] = cut
            cuts.append((first, axis, cut, target))
            next_boxes += [(first, below), (target, count - below)]
        open_boxes = next_boxes
    return Domain(lower, upper, tuple(cuts))


def _cut(comm, position, weight, fraction):
    """Axis and position of the plane with `fraction` of the weight below it."""
    d = position.shape[1]
    extent = np.full(2 * d, -np.inf)
    if len(position):
        extent[:d], extent[d:] = -position.min(axis=0), position.max(axis=0)
    comm.Allreduce(MPI.IN_PLACE, extent, MPI.MAX)
    lower, upper = -extent[:d], extent[d:]
    if not np.isfinite(extent).all():  # no point at all in this box
        return 0, 0.0
    axis = int(np.argmax(upper - lower))
    total = comm.allreduce(float(weight.sum()))
    low, high = lower[axis], upper[axis]
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        if comm.allreduce(float(weight[position[:, axis] < middle].sum())) < fraction * total:
            low = middle
        else:
            high = middle
    above = position[:, axis][position[:, axis] >= high]
    following = minimum(comm, float(above.min(initial=np.inf)))
    # between two rows of points: neither moves to and fro across it, and both sides have the fewest ghosts
    return axis, float(0.5 * (high + following) if np.isfinite(following) else high)
