"""Exchange of what the two ends of a pair give it, for schemes with directed rows.

Each owned end fills its side of a pair; the side of a ghost end comes from the rank that owns the ghost. Both
ranks list the pairs they share in the order of ids, so the numbers travel without labels.
"""

import numpy as np
from mpi4py import MPI

from periporo.core.ranks.halo import Halo


class PairExchange:
    """Exchange of an array (pairs, 2, k) over the pairs found last: sides of the first and of the second end."""

    def __init__(self, halo: Halo, particles, pairs):
        self._found = pairs.first
        self._halo = halo
        self._shared = {}  # rank -> pairs shared with it, side of our end
        ghost_side = np.where(pairs.second >= particles.owned, 1, 0)
        ghost = np.where(ghost_side == 1, pairs.second, pairs.first)
        for rank, rows in halo.receives.items():
            shared = np.flatnonzero((ghost >= rows.start) & (ghost < rows.stop))
            if len(shared):
                self._shared[rank] = shared, ghost_side[shared]

    def is_for(self, pairs) -> bool:
        """Whether the pairs are those this exchange was made for."""
        return self._found is pairs.first

    def run(self, sides: np.ndarray) -> None:
        """Fill the sides (pairs, 2, k) of ghost ends from their owners."""
        comm, received, requests, outgoing = self._halo.comm, {}, [], []
        for rank, (shared, ghost_side) in self._shared.items():
            outgoing.append(np.ascontiguousarray(sides[shared, 1 - ghost_side]))
            received[rank] = np.empty_like(outgoing[-1])
            requests += [comm.Irecv(received[rank], rank), comm.Isend(outgoing[-1], rank)]
        MPI.Request.Waitall(requests)
        for rank, (shared, ghost_side) in self._shared.items():
            sides[shared, ghost_side] = received[rank]
        self._halo.bytes_sent += sum(part.nbytes for part in outgoing)
        self._halo.messages_sent += len(outgoing)
