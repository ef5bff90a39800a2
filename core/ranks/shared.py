"""Arrays that all ranks of a node read and none writes: held once per node."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from mpi4py import MPI

_windows: list[MPI.Win] = []  # kept to the end of the process: arrays live in them


def once_per_node(comm: MPI.Comm, make: Callable[[], Sequence[np.ndarray]]) -> list[np.ndarray]:
    """The arrays that `make` returns on one rank of each node, in memory that all ranks of the node share; collective.

    One rank alone keeps what it made.
    """
    node: Any = comm.Split_type(MPI.COMM_TYPE_SHARED)
    try:
        if node.size == 1:
            return list(make())
        arrays = [np.ascontiguousarray(a) for a in make()] if node.rank == 0 else []
        kinds = node.bcast([(a.shape, a.dtype.str) for a in arrays])
        shared = []
        for k, (shape, kind) in enumerate(kinds):
            size = int(np.prod(shape)) * np.dtype(kind).itemsize
            window = MPI.Win.Allocate_shared(size if node.rank == 0 else 0, 1, comm=node)
            _windows.append(window)
            memory: Any = window.Shared_query(0)[0]
            view = np.frombuffer(memory, np.uint8)[:size].view(kind).reshape(shape)
            if node.rank == 0:
                view[...] = arrays[k]
            shared.append(view)
        node.Barrier()
        return shared
    finally:
        node.Free()
