"""Which rows a scheme puts its constitutive laws on: pairs, directed bonds, or points.

Every layout answers the same questions about a block of rows. Ends are given as (index, first, second,
weight): row r lies between the points first[index[r]] and second[index[r]].
"""

import numpy as np

from periporo.core.numerics.jit import kernel
from periporo.core.points.neighbours import Keys
from periporo.core.points.particles import Field

BOTH, FIRST, SECOND = 0, 1, 2  # whose share of a pair's volume a row stands for


class Layout:
    """What a scheme may want besides rows: `linked`, a number for each pair, and point fields of its own."""

    linked = False

    def fields(self, dimension: int, components: int) -> tuple[Field, ...]:
        """The point fields."""
        return ()


class PairRows(Layout):
    """A row for each pair, keyed (lower id, higher id); a pair of two materials has one in either block."""

    def choose(self, block, blocks, pairs, particles) -> int:
        """Find the rows of `block`, and count them."""
        n = len(pairs.first)
        if len(blocks) == 1:
            block.pair, block.side = np.arange(n, dtype=np.uint32), np.zeros(n, np.int8)
            return n
        is_first = particles.material[pairs.first] == block.index
        is_second = particles.material[pairs.second] == block.index
        block.pair = np.flatnonzero(is_first | is_second).astype(np.uint32)
        side = np.where(is_first & is_second, BOTH, np.where(is_first, FIRST, SECOND))
        block.side = side[block.pair].astype(np.int8)
        return len(block.pair)

    def keys(self, block, pairs) -> tuple[Keys, np.ndarray]:
        """Ids (m, 2) in ascending order, and the place in them of each row (n,)."""
        return pairs.keys, block.pair

    def ends(self, block, pairs) -> tuple[np.ndarray, ...]:
        """The ends of the rows, and the influence with which the rows count in the average of an end."""
        return block.pair, pairs.first, pairs.second, pairs.weight

    def holders(self, block, pairs) -> tuple[np.ndarray, ...]:
        """The points whose rows these are, and a weight: a row is active while it is positive."""
        return block.pair, pairs.first, pairs.second, pairs.weight

    def volumes(self, block, pairs, particles, rows) -> np.ndarray:
        """Volume (n,) m^3 that each of the `rows` stands for."""
        side = block.side[rows]
        return _volumes(pairs, particles, block.pair[rows], side != SECOND, side != FIRST)


class LinkRows(Layout):
    """A row for each pair, in their order, so that no list is needed of what is whose."""

    def choose(self, block, blocks, pairs, particles) -> int:
        """Count the rows of `block`."""
        return len(pairs.first)

    def keys(self, block, pairs) -> tuple[Keys, np.ndarray]:
        """Ids (n, 2) in ascending order, and the place in them of each row (n,)."""
        return pairs.keys, _all_rows(block)

    def holders(self, block, pairs) -> tuple[np.ndarray, ...]:
        """The points whose rows these are, and a weight: a row is active while it is positive."""
        return _all_rows(block), pairs.first, pairs.second, pairs.weight

    def volumes(self, block, pairs, particles, rows) -> np.ndarray:
        """Volume (n,) m^3 that each of the `rows` stands for."""
        return _volumes(pairs, particles, rows, True, True)


def _volumes(pairs, particles, pair, of_first, of_second) -> np.ndarray:
    """Volume (n,) m^3 that the first and the second end of each `pair` (n,) give, as far as they count."""
    share, volume = particles.share, particles.volume
    i, j = pairs.first[pair], pairs.second[pair]
    halves = share[i, 0] * share[j, 1] * of_first + share[j, 0] * share[i, 1] * of_second
    return pairs.weight[pair] * volume[i] * volume[j] * halves


class DirectedRows(Layout):
    """A row for each bond of each owned point, keyed (its id, the neighbour's id), in that order.

    `block.side` tells which end of the row's pair holds it, FIRST or SECOND; the rows of owned point i are
    start[i] ... start[i + 1]. The scheme sets `integrity` (n,), 0 for a row without state, `fraction` (n,) of
    the point's volume that the row stands for, and each row's own `shape_inverse` and `gradient`.
    """

    def choose(self, block, blocks, pairs, particles) -> int:
        """Find the rows of `block`, and count them."""
        p = particles
        own = p.material[: p.owned] == block.index
        block.start, block.pair, block.first, block.second = _directed_rows(pairs.first, pairs.second, own, p.owned)
        block.side = np.where(pairs.first[block.pair] == block.first, FIRST, SECOND).astype(np.int8)
        n, d = len(block.pair), p.dimension
        block.integrity, block.fraction = np.zeros(n), np.zeros(n)
        block.shape_inverse, block.gradient = np.zeros((n, d * (d + 1) // 2)), np.zeros((n, d * d))
        return n

    def keys(self, block, pairs) -> tuple[Keys, np.ndarray]:
        """Ids (n, 2) in ascending order, and the place in them of each row (n,)."""
        return Keys(block.first, block.second, pairs.id), _all_rows(block)

    def ends(self, block, pairs) -> tuple[np.ndarray, ...]:
        """The ends of the rows, and the influence with which the rows count in the average of their point."""
        return _all_rows(block), block.first, block.second, pairs.weight[block.pair]

    def holders(self, block, pairs) -> tuple[np.ndarray, ...]:
        """The points whose rows these are, and a weight: a row is active while it is positive."""
        return _all_rows(block), block.first, block.first, block.integrity

    def volumes(self, block, pairs, particles, rows) -> np.ndarray:
        """Volume (n,) m^3 that each of the `rows` stands for."""
        return particles.volume[block.first[rows]] * block.fraction[rows]


class PointRows(Layout):
    """A row for each owned point that is awake, keyed (id, id)."""

    def choose(self, block, blocks, pairs, particles) -> int:
        """Find the rows of `block`, and count them."""
        p = particles
        block.first = block.second = np.flatnonzero(p.material[: p.awake] == block.index).astype(np.uint32)
        block.pair, block.side = block.first, np.zeros(len(block.first), np.int8)
        block.integrity = np.ones(len(block.first))
        return len(block.first)

    def keys(self, block, pairs) -> tuple[Keys, np.ndarray]:
        """Ids (n, 2) in ascending order, and the place in them of each row (n,)."""
        return Keys(block.first, block.second, pairs.id), _all_rows(block)

    def ends(self, block, pairs) -> tuple[np.ndarray, ...]:
        """The point of each row, twice, and 1: a point's average is its row."""
        return _all_rows(block), block.first, block.first, block.integrity

    holders = ends

    def volumes(self, block, pairs, particles, rows) -> np.ndarray:
        """Volume (n,) m^3 that each of the `rows` stands for."""
        i = block.first[rows]
        return particles.volume[i] * particles.share[i, 2]


def _all_rows(block):
    return np.arange(len(block.stress), dtype=np.uint32)


@kernel
def _directed_rows(first, second, own, owned):
    """Start of each owned point's rows, and pair, point and neighbour of each row.

    Pairs stand in the order of (lower id, higher id), so going through them meets the neighbours of a point in
    ascending order.
    """
    start = np.zeros(owned + 1, np.int64)
    for b in range(first.shape[0]):
        i, j = first[b], second[b]
        if i < owned and own[i]:
            start[i + 1] += 1
        if j < owned and own[j]:
            start[j + 1] += 1
    for i in range(owned):
        start[i + 1] += start[i]
    filled = start.copy()
    rows = start[owned]
    pair, point, neighbour = np.empty(rows, np.uint32), np.empty(rows, np.uint32), np.empty(rows, np.uint32)
    for b in range(first.shape[0]):
        for i, j in ((first[b], second[b]), (second[b], first[b])):
            if i < owned and own[i]:
                r = filled[i]
                pair[r], point[r], neighbour[r] = b, i, j
                filled[i] += 1
    return start, pair, point, neighbour
