"""Who owns what: recursive coordinate bisection of space among the ranks.

Each rank knows the cuts that made its own box, and the boxes near it; what else it asks is handed from level to level
(`periporo.core.ranks.halving`).
"""

import numpy as np
from mpi4py import MPI

from periporo.core.ranks.halving import combine, divide, exchange_rows, hand_over, levels
from periporo.core.ranks.reductions import any_rank

_PARTS, _ROUNDS = 128, 6  # of the search for a plane: to 2^-42 of the box


class Domain:
    """A box of space for each rank of `comm`; points on a cut belong above it.

    `cuts` lists axis and place (m) of the cut of each level, `box` (2, d) m the lower and the upper corner of what they
    leave for this rank; outer faces are infinite.
    """

    def __init__(self, comm: MPI.Comm, dimension: int, cuts: list[tuple[int, float]]):
        self.comm = comm
        self.cuts = cuts
        self.box = _everywhere(dimension)
        for level, cut in zip(levels(comm), cuts, strict=True):
            self.box = _halves(self.box, *cut)[level.upper]
        self._within = 0.0  # m
        self._boxes: dict[int, np.ndarray] = {}

    def owns(self, position: np.ndarray) -> np.ndarray:
        """Which of the positions (n, d) belong to this rank, (n,) bool; unknown places belong to the first rank."""
        mine = np.ones(len(position), bool)
        for level, (axis, place) in zip(levels(self.comm), self.cuts, strict=True):
            mine &= (position[:, axis] >= place) == level.upper
        return mine

    def owner(self, position: np.ndarray) -> np.ndarray:
        """Rank that owns each of the positions (n, d), (n,) int; collective."""
        owner = np.where(self.owns(position), self.comm.rank, -1)
        for rank, (lower, upper) in self._boxes.items():
            owner[((lower <= position) & (position < upper)).all(axis=1)] = rank
        far = np.flatnonzero(owner < 0)
        if any_rank(self.comm, len(far) > 0):
            owner[far] = self._asked(position[far])
        return owner

    def _asked(self, position):
        """Owners of positions (n, d) anywhere: each is handed to its owner, who answers; collective."""
        number = np.arange(float(len(position)))
        held = np.column_stack([np.full(len(position), float(self.comm.rank)), number, position])
        for level, (axis, place) in zip(levels(self.comm), self.cuts, strict=True):
            held = divide(self.comm, level, held, held[:, 2 + axis] >= place)
        ranks = np.full(len(held), float(self.comm.rank))
        answers = np.column_stack([held[:, 1], ranks])
        asking = {int(r): answers[held[:, 0] == r] for r in np.unique(held[:, 0])}
        found = exchange_rows(self.comm, asking, 2).astype(np.int64)
        owner = np.empty(len(position), np.int64)
        owner[found[:, 0]] = found[:, 1]
        return owner

    def near(self, reach: float) -> dict[int, np.ndarray]:
        """Other ranks whose boxes come within `reach` m of this one's, in order, with their boxes (2, d); collective.
        """
        if reach > self._within:
            self._within, self._boxes = reach, self._found_within(reach)
        return {rank: box for rank, box in self._boxes.items() if _gap(box[None], self.box)[0] < reach**2}

    def _found_within(self, reach):
        """As `near`: boxes are handed to the halves that they come near to."""
        d, region = self.box.shape[1], _everywhere(self.box.shape[1])
        held = np.concatenate([[float(self.comm.rank)], self.box.ravel()])[None]
        for level, cut in zip(levels(self.comm), self.cuts, strict=True):
            halves = _halves(region, *cut)
            region, beyond = halves[level.upper], halves[not level.upper]
            boxes = held[:, 1:].reshape(-1, 2, d)
            arrived = hand_over(self.comm, level, held[_gap(boxes, beyond) < reach**2])
            held = np.concatenate([held[_gap(boxes, region) < reach**2], arrived])
        held = held[np.argsort(held[:, 0])]
        return {int(row[0]): row[1:].reshape(2, d) for row in held if row[0] != self.comm.rank}


def distance(box: np.ndarray, position: np.ndarray) -> np.ndarray:
    """Distance of the positions (n, d) to a `box` (2, d), (n,) m."""
    outside = np.maximum(np.maximum(box[0] - position, position - box[1]), 0.0)
    return np.sqrt((outside**2).sum(axis=1))


def _everywhere(dimension):
    return np.stack([np.full(dimension, -np.inf), np.full(dimension, np.inf)])


def _halves(box, axis, place):
    """The parts of a box below and above a cut."""
    lower, upper = box.copy(), box.copy()
    lower[1, axis] = upper[0, axis] = place
    return lower, upper


def _gap(boxes, box):
    """Square of the gap between each of the `boxes` (n, 2, d) and a `box` (2, d), (n,) m^2: the same from either."""
    gap = np.maximum(np.maximum(boxes[:, 0] - box[1], box[0] - boxes[:, 1]), 0.0)
    return (gap**2).sum(axis=1)


def bisect(comm: MPI.Comm, position: np.ndarray, weight: np.ndarray, whole: tuple[int, ...] = ()) -> Domain:
    """Domain that gives each rank about the same sum of `weight` (n,), points at `position` (n, d).

    Each box is cut across its longest side, but for axes that stay `whole`, in proportion to the ranks on either side,
    by the ranks among which it is divided. Weights are whole numbers: their sums are the same on all ranks.
    """
    known = np.isfinite(position).all(axis=1)
    held, cuts = np.column_stack([position[known], weight[known]]), []
    for level in levels(comm):
        axis, place = _plane(comm, level, held[:, :-1], held[:, -1], whole)
        held = divide(comm, level, held, held[:, axis] >= place)
        cuts.append((axis, place))
    return Domain(comm, position.shape[1], cuts)


def _plane(comm, level, position, weight, whole) -> tuple[int, float]:
    """Axis and place of the plane below which the lower half of the group gets its part of the weight."""
    d = position.shape[1]
    ends = np.concatenate([-position.min(axis=0, initial=np.inf), position.max(axis=0, initial=-np.inf)])
    ends = combine(comm, level, ends, np.maximum)
    ends[np.isinf(ends)] = 0.0  # of a group without points
    sides = ends[d:] + ends[:d]
    sides[list(whole)] = -np.inf
    axis = int(np.argmax(sides))
    along, low, high = position[:, axis], -ends[axis], ends[d + axis]
    part = (level.middle - level.first) / (level.last - level.first)
    for _ in range(_ROUNDS):
        edges = np.linspace(low, high, _PARTS + 1)
        sums = np.bincount(np.searchsorted(edges, along, side="right"), weight, _PARTS + 2).astype(float)
        below = np.cumsum(combine(comm, level, sums, np.add))  # each edge; the last is all
        k = int(np.searchsorted(below[:-1], part * below[-1]).clip(1, _PARTS))
        low, high = edges[k - 1], edges[k]
    following = combine(comm, level, np.array([along[along >= high].min(initial=np.inf)]), np.minimum)[0]
    # between two rows of points: neither moves to and fro across it, and both sides have the fewest ghosts
    return axis, float(0.5 * (high + following) if np.isfinite(following) else high)
