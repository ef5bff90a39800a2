"""The way of rows to the ranks that write them in parts."""

from collections.abc import Sequence

import numpy as np
from mpi4py import MPI

from periporo.core.ranks.halving import exchange_rows


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
    packed = np.hstack([np.ascontiguousarray(c).view(np.float64).reshape(len(keys), -1) for c in (keys, *columns)])
    if comm.size > 1:
        owner = _numbers(keys, count, parts) * comm.size // parts
        outgoing = {r: packed[owner == r] for r in np.unique(owner).tolist() if r != comm.rank}
        packed = np.concatenate([packed[owner == comm.rank], exchange_rows(comm, outgoing, packed.shape[1])])
        keys = np.ascontiguousarray(packed[:, 0]).view(np.int64)
        order = np.argsort(keys, kind="stable")
        keys, packed = keys[order], packed[order]
    edges = np.searchsorted(_numbers(keys, count, parts), np.arange(parts + 1)).tolist()
    rows = {number: packed[edges[number] : edges[number + 1]] for number in own_parts(comm, parts)}
    return rows, np.diff(edges)


def _numbers(keys, count, parts):
    """The part to which each key belongs."""
    return keys * parts // max(count, 1)
