"""Pairs of points within a distance, found on a grid of cells, in the order of their global ids."""

from dataclasses import dataclass

import numpy as np

from periporo.core.numerics.jit import kernel
from periporo.core.points.particles import SHEET

_ID_BITS, _SHEET_BITS = 53, 3  # of the second id of a pair: the point, and for each axis its sheet from the first one's


@dataclass(frozen=True)
class Keys:
    """Ids of the two ends of rows, without a copy: `id` (k,) at the places `first` and `second` (n,).

    keys[rows] are ids (m, 2).
    """

    first: np.ndarray
    second: np.ndarray
    id: np.ndarray

    def __getitem__(self, rows) -> np.ndarray:
        return np.stack([self.id[self.first[rows]], self.id[self.second[rows]]], axis=-1)

    @classmethod
    def of(cls, ids: "np.ndarray | Keys") -> "Keys":
        """The keys `ids` (n, 2), which may be such already."""
        if isinstance(ids, Keys):
            return ids
        first = np.arange(0, ids.size, 2, dtype=np.uint32)
        return cls(first, first + np.uint32(1), ids.ravel())


class Pairs:
    """Undirected pairs with at least one owned and one waking end, sorted by (lower id, higher id).

    `first`, `second` (n,) uint32 rows of the end with the lower and the higher id; `id` (total,) of the points; `keys`;
    `weight` (n,) influence w of the present configuration, 0 from the horizon on; `count` (total,) how many bonds
    of each point are shorter than that. Every loop over pairs adds to both ends in this order, which is the same on
    every rank: sums do not depend on the decomposition.

    Where points have images (`periporo.core.ranks.images`), the higher id of a pair tells them apart, `original` takes
    this off; a pair with a mirror image begins with the end that is none.
    """

    def __init__(self):
        self._clear()
        self.count = np.empty(0, np.int64)

    def _clear(self):
        self.first = self.second = np.empty(0, np.uint32)
        self.id = np.empty(0, np.int64)
        self.keys = Keys(self.first, self.second, self.id)
        self.weight = np.empty(0)

    def find(self, particles, reach: float) -> None:
        """List every pair closer than `reach` m whose points may bond (same `group`), unless both sleep."""
        p = particles
        capacity = max(int(1.2 * len(self.first)), 16 * p.total, 64)
        self._clear()  # what is not needed any more makes room
        asleep = p.asleep != 0 if "asleep" in p.fields else None
        self.first, self.second = find_pairs(p, np.arange(p.total), p.group, reach, capacity, asleep)
        found = len(self.first)
        self.id = p.id
        self.keys = self._with_images(p) if SHEET in p.fields else Keys(self.first, self.second, p.id)
        self.weight, self.count = np.zeros(found), np.zeros(p.total, np.int64)

    def _with_images(self, p) -> Keys:
        """Sort the pairs by ids that number the images; a bond across a seam has the same ids from either side."""
        swapped = p.sheet[self.first, -1] != 0
        first, second = np.where(swapped, self.second, self.first), np.where(swapped, self.first, self.second)
        sheets = (p.sheet[second, :-1] - p.sheet[first, :-1]) & (2**_SHEET_BITS - 1)
        told = p.id[second] + (sheets << (_ID_BITS + _SHEET_BITS * np.arange(p.dimension))).sum(axis=1)
        ids = np.stack([p.id[first], told], axis=1)
        order = np.lexsort((ids[:, 1], ids[:, 0]))
        self.first, self.second = first[order], second[order]
        return Keys.of(ids[order])

    @property
    def ids(self) -> np.ndarray:
        """Ids (n, 2) of the ends."""
        return self.keys[:]

    def per_point(self, total: int) -> np.ndarray:
        """How many listed pairs each of `total` points has, (total,) float64."""
        first, second = (np.bincount(end, minlength=total) for end in (self.first, self.second))
        return (first + second).astype(float)


def original(ids: np.ndarray) -> np.ndarray:
    """Ids of points from the `ids` of pairs, whichever image is meant."""
    return ids & (2**_ID_BITS - 1)


def find_pairs(
    particles, rows: np.ndarray, group: np.ndarray, reach: float, capacity: int = 1024,
    asleep: np.ndarray | None = None,
) -> np.ndarray:  # fmt: skip
    """Ends (2, n) uint32 of all pairs among `rows` closer than `reach` m, of equal `group` and with an owned end.

    The first end has the lower id; pairs stand in the order of (lower id, higher id). `capacity` is a guess of n. Pairs
    of which both ends are `asleep` (total,) are left out.
    """
    p = particles
    asleep = np.zeros(p.total, np.bool_) if asleep is None else asleep
    order = rows[np.argsort(p.id[rows], kind="stable")].astype(np.int32)
    cell, counts = _cells(p.position[order], reach)
    while True:
        room = np.empty(2 * capacity, np.uint32)
        ends = room.reshape(2, capacity)
        found = _find_pairs(order, p.position, group, asleep, p.owned, cell, counts, reach, ends, p.dim)
        if found <= capacity:
            room[found : 2 * found] = ends[1, :found]
            del ends
            room.resize(2 * found, refcheck=False)  # in place: there would not be room for a copy
            return room.reshape(2, found)
        capacity = found


def near(particles, chosen: np.ndarray, radius: float) -> np.ndarray:
    """Which owned points (owned,) are `chosen` (total,), or closer than `radius` m to one that is."""
    p = particles
    cell, counts = _cells(p.position, radius)
    found = np.zeros(p.owned, np.bool_)
    _find_near(p.position, chosen, cell, counts, radius, found, p.dim)
    return found


def _cells(position, reach):
    """Cell indices (n, 3), in the plane the last two, and numbers of cells; NaN positions share one cell."""
    n, d = position.shape
    finite = [np.where(np.isfinite(x), x, 0.0) for x in position.T]  # column by column: much quicker than along rows
    lower = np.array([x.min() for x in finite]) if n else np.zeros(d)
    extent = np.array([x.max() for x in finite]) - lower if n else np.zeros(d)
    # a few points flung far away must not blow up the grid: larger cells find the same pairs
    size = max(reach, float((np.prod(np.maximum(extent, reach)) / (4.0 * max(n, 1))) ** (1.0 / d)))
    cell = np.zeros((n, 3), np.int32)
    for a in range(d):
        cell[:, 3 - d + a] = np.floor((finite[a] - lower[a]) / size)
    return cell, np.array([c.max(initial=0) for c in cell.T]) + 1


@kernel
def _find_pairs(order, position, group, asleep, owned, cell, counts, reach, ends, dim):
    """Fill `ends` (2, capacity); the number of pairs there are, also when there is no room for them."""
    n = order.shape[0]
    heads = np.zeros(counts[0] * counts[1] * counts[2] + 1, np.int32)
    waking = np.zeros_like(heads)  # points in the cells before
    for p in range(n):
        c = (cell[p, 0] * counts[1] + cell[p, 1]) * counts[2] + cell[p, 2] + 1
        heads[c] += 1
        waking[c] += not asleep[order[p]]
    for c in range(heads.shape[0] - 1):
        heads[c + 1] += heads[c]
        waking[c + 1] += waking[c]
    filled = heads.copy()
    members = np.empty(n, np.int32)  # ranks in id order, cell by cell
    place = np.empty((n, len(dim)))  # and where they are
    for p in range(n):
        c = (cell[p, 0] * counts[1] + cell[p, 1]) * counts[2] + cell[p, 2]
        members[filled[c]] = p
        for a in range(len(dim)):
            place[filled[c], a] = position[order[p], a]
        filled[c] += 1
    found = 0
    partners = np.empty(n, np.int32)
    for p in range(n):
        i = order[p]
        m = 0
        for cx in range(max(cell[p, 0] - 1, 0), min(cell[p, 0] + 2, counts[0])):
            for cy in range(max(cell[p, 1] - 1, 0), min(cell[p, 1] + 2, counts[1])):
                row = (cx * counts[1] + cy) * counts[2]  # whose cells follow each other
                lower, upper = row + max(cell[p, 2] - 1, 0), row + min(cell[p, 2] + 2, counts[2])
                if asleep[i] and waking[lower] == waking[upper]:
                    continue
                for k in range(heads[lower], heads[upper]):
                    r2 = 0.0
                    for a in range(len(dim)):
                        r2 += (place[k, a] - position[i, a]) ** 2
                    q = members[k]
                    if q > p and r2 < reach * reach:
                        j = order[q]
                        if (i < owned or j < owned) and group[i] == group[j] and not (asleep[i] and asleep[j]):
                            partners[m] = q
                            m += 1
        for k in range(1, m):  # insertion sort: rows are short
            q = partners[k]
            s = k - 1
            while s >= 0 and partners[s] > q:
                partners[s + 1] = partners[s]
                s -= 1
            partners[s + 1] = q
        for k in range(m):
            if found + k < ends.shape[1]:
                ends[0, found + k] = i
                ends[1, found + k] = order[partners[k]]
        found += m
    return found


@kernel
def _find_near(position, chosen, cell, counts, radius, found, dim):
    heads = np.zeros(counts[0] * counts[1] * counts[2] + 1, np.int32)
    for i in range(chosen.shape[0]):
        if chosen[i]:
            heads[(cell[i, 0] * counts[1] + cell[i, 1]) * counts[2] + cell[i, 2] + 1] += 1
    for c in range(heads.shape[0] - 1):
        heads[c + 1] += heads[c]
    filled = heads.copy()
    members = np.empty(heads[heads.shape[0] - 1], np.int32)
    for i in range(chosen.shape[0]):
        if chosen[i]:
            c = (cell[i, 0] * counts[1] + cell[i, 1]) * counts[2] + cell[i, 2]
            members[filled[c]] = i
            filled[c] += 1
    for i in range(found.shape[0]):
        found[i] = chosen[i]
        for cx in range(max(cell[i, 0] - 1, 0), min(cell[i, 0] + 2, counts[0])):
            for cy in range(max(cell[i, 1] - 1, 0), min(cell[i, 1] + 2, counts[1])):
                row = (cx * counts[1] + cy) * counts[2]  # whose cells follow each other
                begin, end = heads[row + max(cell[i, 2] - 1, 0)], heads[row + min(cell[i, 2] + 2, counts[2])]
                for k in range(begin, end):
                    if found[i]:
                        break
                    square = 0.0
                    for a in range(len(dim)):
                        square += (position[members[k], a] - position[i, a]) ** 2
                    found[i] = square < radius * radius
