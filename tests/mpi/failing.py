"""Runs the command line in folders that are named by what goes wrong there (see folders.py).

    mpirun -n 2 python failing.py --quiet ...

lost: the result file vanishes in the fifth step; full...: no file can grow beyond 150 kB; fault: rank 1 fails in the
fifth step; of others, the scene or the folder are at fault.
"""

import contextlib
import os
import resource
import signal
import sys
from unittest import mock

import folders
from mpi4py import MPI

from periporo.core.points.fields import StrainMeasures


@contextlib.contextmanager
def in_the_fifth_step(rank, action):
    """Make a rank do something where no other rank does."""
    update, calls = StrainMeasures.update, []

    def spoiled_update(self, *arguments):
        calls.append(1)
        if rank == MPI.COMM_WORLD.rank and len(calls) == 5:
            action()
        update(self, *arguments)

    with mock.patch.object(StrainMeasures, "update", spoiled_update):
        yield


@contextlib.contextmanager
def limited_files():
    """A limit on the size of files stands in for a full disk."""
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    _, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (150_000, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (hard, hard))


def fail():
    """What a programming error looks like."""
    raise ZeroDivisionError("injected fault")


def misfortune(name):
    """What happens in the folder of this name."""
    if name == "lost":
        return in_the_fifth_step(0, lambda: os.unlink("scene.vtkhdf"))
    if name == "fault":
        return in_the_fifth_step(1, fail)
    return limited_files() if name.startswith("full") else contextlib.nullcontext()


if __name__ == "__main__":
    raise SystemExit(folders.main(sys.argv[1:], misfortune))
