"""The ranks halved again and again: how any rank is reached in a few messages, however many there are.

Ranks that follow each other are a group. It is halved until each rank is alone; at every level a rank sends to one
partner in the other half of its group, so that what is handed from level to level has reached any of P ranks after
log2 P messages. No rank keeps, sends or goes through anything that is as long as the number of ranks.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from mpi4py import MPI

_TAG = 71


@dataclass(frozen=True)
class Level:
    """The group `first` to `last` - 1 that `rank` belongs to at one level; its upper half begins with `middle`."""

    rank: int
    first: int
    middle: int
    last: int

    @property
    def upper(self) -> bool:
        """Whether the rank is in the upper half."""
        return self.rank >= self.middle

    @property
    def partner(self) -> int:
        """The rank of the other half that this one sends to."""
        if self.upper:
            return self.first + (self.rank - self.middle) % (self.middle - self.first)
        return self.middle + (self.rank - self.first) % (self.last - self.middle)

    @property
    def sources(self) -> range:
        """The ranks of the other half that send to this one; the halves differ by one rank at most."""
        below = self.middle - self.first
        if self.upper:
            return range(self.first + self.rank - self.middle, self.middle, self.last - self.middle)
        return range(self.middle + self.rank - self.first, self.last, below)


def levels(comm: MPI.Comm) -> list[Level]:
    """The levels from all ranks down to this one alone."""
    found, first, last = [], 0, comm.size
    while last - first > 1:
        level = Level(comm.rank, first, first + (last - first) // 2, last)
        first, last = (level.middle, last) if level.upper else (first, level.middle)
        found.append(level)
    return found


def hand_over(comm: MPI.Comm, level: Level, rows: np.ndarray) -> np.ndarray:
    """Send float64 `rows` (n, width) to the partner; those that came to this rank, in the order of their senders."""
    sending = comm.Isend(np.ascontiguousarray(rows), level.partner, _TAG)
    status, arrived = MPI.Status(), []
    for source in level.sources:
        comm.Probe(source, _TAG, status)
        part = np.empty((status.Get_count(MPI.DOUBLE) // rows.shape[1], rows.shape[1]))
        comm.Recv(part, source, _TAG)
        arrived.append(part)
    sending.Wait()
    return np.concatenate([rows[:0], *arrived])


def divide(comm: MPI.Comm, level: Level, rows: np.ndarray, above: np.ndarray) -> np.ndarray:
    """Have the `rows` (n, width) of a group in the halves where they belong, the upper one if `above` (n,)."""
    leaves = above != level.upper
    return np.concatenate([rows[~leaves], hand_over(comm, level, rows[leaves])])


def combine(comm: MPI.Comm, level: Level, values: np.ndarray, operation: Callable) -> np.ndarray:
    """Sum or extremes (`operation` is np.add, np.maximum or np.minimum) of `values` over the ranks of a group.

    Up and down a tree whose root is the first rank. Communicators of groups would be what this is for, but making one
    asks all ranks and keeps a list of them.
    """
    place, count, step = level.rank - level.first, level.last - level.first, 1
    values, other = values.copy(), np.empty_like(values)
    while step < count and not place & step:
        if place + step < count:
            comm.Recv(other, level.rank + step, _TAG)
            operation(values, other, out=values)
        step *= 2
    if place:
        comm.Send(values, level.rank - step, _TAG)
        comm.Recv(values, level.rank - step, _TAG)
    while step > 1:
        step //= 2
        if place + step < count:
            comm.Send(values, level.rank + step, _TAG)
    return values


def exchange_rows(comm: MPI.Comm, outgoing: dict[int, np.ndarray], width: int) -> np.ndarray:
    """Send float64 rows (n, width) to other ranks; the rows received, in the order of their ranks.

    Collective. `outgoing` maps a rank to its rows; ranks without rows may be missing.
    """
    ends = [np.tile([float(rank), float(comm.rank)], (len(rows), 1)) for rank, rows in outgoing.items()]
    addressed = [np.hstack(pair) for pair in zip(ends, outgoing.values(), strict=True)]
    held = np.concatenate([np.empty((0, 2 + width)), *addressed])
    for level in levels(comm):
        held = divide(comm, level, held, held[:, 0] >= level.middle)
    return np.ascontiguousarray(held[np.argsort(held[:, 1], kind="stable"), 2:])
