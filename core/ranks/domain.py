"""Who owns what: recursive coordinate bisection of space among the ranks."""

from dataclasses import dataclass

import numpy as np
from mpi4py import MPI

_PARTS, _ROUNDS = 128, 6  # of the search for a plane: to 2^-42 of the box


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
    in every cut and hold only their own points. Weights are whole numbers: their sums are the same on all ranks.
    """
    ranks, d = comm.size, position.shape[1]
    known = np.isfinite(position).all(axis=1)
    position, weight = position[known], weight[known]
    box = np.zeros(len(position), np.int64)
    lower, upper = np.full((ranks, d), -np.inf), np.full((ranks, d), np.inf)
    cuts = []
    open_boxes = [(0, ranks)] if ranks > 1 else []  # (first rank, number of ranks) still to be cut
    while open_boxes:
        planes = _planes(comm, position, weight, box, [(first, (n // 2) / n) for first, n in open_boxes])
        next_boxes = []
        for (first, count), (axis, cut) in zip(open_boxes, planes, strict=True):
            below = count // 2
            target = first + below
            box[(box == first) & (position[:, axis] >= cut)] = target
            lower[target], upper[target] = lower[first], upper[first]
            upper[first, axis] = lower[target, axis] = cut
            cuts.append((first, axis, cut, target))
            next_boxes += [(first, below), (target, count - below)]
        open_boxes = [(first, count) for first, count in next_boxes if count > 1]
    return Domain(lower, upper, tuple(cuts))


def _planes(comm, position, weight, box, wanted) -> list[tuple[int, float]]:
    """Axis and place of the plane through each of the `wanted` (box, fraction of its weight below the plane).

    All boxes at once, since a search asks all ranks a few times.
    """
    d = position.shape[1]
    inside = [box == number for number, _ in wanted]
    extent = np.full((len(wanted), 2 * d), -np.inf)
    for k, rows in enumerate(inside):
        if rows.any():
            extent[k, :d], extent[k, d:] = -position[rows].min(axis=0), position[rows].max(axis=0)
    comm.Allreduce(MPI.IN_PLACE, extent, MPI.MAX)
    extent[np.isinf(extent)] = 0.0  # of a box without points
    lower, upper = -extent[:, :d], extent[:, d:]
    axis = np.argmax(upper - lower, axis=1).tolist()
    along = [position[rows, a] for rows, a in zip(inside, axis, strict=True)]
    weights = [weight[rows] for rows in inside]
    ends = [(lower[k, a], upper[k, a]) for k, a in enumerate(axis)]
    for _ in range(_ROUNDS):
        edges = [np.linspace(*pair, _PARTS + 1) for pair in ends]
        sums = np.array([
            np.bincount(np.searchsorted(e, x, side="right"), w, _PARTS + 2)
            for e, x, w in zip(edges, along, weights, strict=True)
        ], float)  # fmt: skip
        comm.Allreduce(MPI.IN_PLACE, sums, MPI.SUM)
        below = np.cumsum(sums, axis=1)  # each edge; the last column is all
        for k, (_, fraction) in enumerate(wanted):
            part = np.searchsorted(below[k, :-1], fraction * below[k, -1]).clip(1, _PARTS)
            ends[k] = edges[k][part - 1], edges[k][part]
    high = np.array([pair[1] for pair in ends])
    following = np.array([x[x >= h].min(initial=np.inf) for x, h in zip(along, high, strict=True)])
    comm.Allreduce(MPI.IN_PLACE, following, MPI.MIN)
    # between two rows of points: neither moves to and fro across it, and both sides have the fewest ghosts
    cut = np.where(np.isfinite(following), 0.5 * (high + following), high)
    return list(zip(axis, cut.tolist(), strict=True))
