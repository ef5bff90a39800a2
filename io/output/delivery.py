"""The way of rows to the ranks that write them in parts."""

import math
from collections.abc import Sequence

import numpy as np
from mpi4py import MPI

from periporo.core.ranks.halving import divide, levels


def own_parts(comm: MPI.Comm, parts: int) -> range:
    """The numbers of the parts that this rank writes: they are dealt out evenly."""
    return range(-(-comm.rank * parts // comm.size), -(-(comm.rank + 1) * parts // comm.size))


def deliver(
    comm: MPI.Comm, parts: int, count: int, keys: np.ndarray, columns: Sequence[np.ndarray]
) -> tuple[dict[int, np.ndarray], np.ndarray]:
    """The rows of this rank's parts by number, and how many each of all parts (parts,) gets here; collective.

    Part w gets the rows whose sorted `keys` (n,) lie in the w-th of equal ranges below `count`, in their order; equal
    keys are all on one rank. Rows are the key's bits and those of the 8-byte `columns` side by side, as float64.
    """
    columns = [keys, *columns]
    widths = [math.prod(column.shape[1:]) for column in columns]
    packed, start = np.empty((len(keys), sum(widths))), 0
    for column, width in zip(columns, widths, strict=True):
        bits = np.ascontiguousarray(column).view(np.float64)
        packed[:, start : start + width] = bits.reshape(len(keys), width)
        start += width
    for level in levels(comm):
        owner = _numbers(_keys(packed), count, parts) * comm.size // parts
        packed = divide(comm, level, packed, owner >= level.middle)
    keys = _keys(packed)
    if (np.diff(keys) < 0).any():  # rows of other ranks stand behind those of this one
        order = np.argsort(keys, kind="stable")
        keys, packed = keys[order], packed[order]
    edges = np.searchsorted(_numbers(keys, count, parts), np.arange(parts + 1)).tolist()
    rows = {number: packed[edges[number] : edges[number + 1]] for number in own_parts(comm, parts)}
    return rows, np.diff(edges)


def _keys(packed):
    return np.ascontiguousarray(packed[:, 0]).view(np.int64)


def _numbers(keys, count, parts):
    """The part to which each key belongs."""
    return keys * parts // max(count, 1)
