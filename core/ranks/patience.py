"""Waiting that leaves the processor to others, for what one rank does while the others have nothing to do."""

import time

from mpi4py import MPI

_SHORTEST, _LONGEST = 1e-4, 2e-2  # s between two looks


def wait_for_all(comm: MPI.Comm) -> None:
    """A barrier whose ranks sleep until the last has come.

    MPI's own looks all the time, and where more ranks run than there are cores, those that look keep from working what
    they wait for: 256 ranks on two cores took 128 times as long for what rank 0 alone has to do.
    """
    if comm.size == 1:
        return
    request, pause = comm.Ibarrier(), _SHORTEST
    while not request.Test():
        time.sleep(pause)
        pause = min(2.0 * pause, _LONGEST)
