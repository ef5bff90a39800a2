"""Runs the command line on several ranks for tests, with a fault or a tap where the first word says so.

mpirun -n 3 python program.py tap config.yaml ...     what rank r > 0 prints goes to the file rank{r}.txt
mpirun -n 3 python program.py fault config.yaml ...   rank 1 fails in the fifth step
mpirun -n 2 python program.py lost config.yaml ...    the result file vanishes in the fifth step
mpirun -n 2 python program.py full config.yaml ...    no file can grow beyond 150 kB
"""

import os
import resource
import signal
import sys

from mpi4py import MPI

from periporo.core import cli
from periporo.core.points.fields import StrainMeasures

RANK = MPI.COMM_WORLD.rank


def in_the_fifth_step(rank, action):
    """Make a rank do something where no other rank does."""
    update, calls = StrainMeasures.update, []

    def spoiled_update(self, *arguments):
        calls.append(1)
        if rank == RANK and len(calls) == 5:
            action()
        update(self, *arguments)

    StrainMeasures.update = spoiled_update


def fail():
    """What a programming error looks like."""
    raise ZeroDivisionError("injected fault")


def redirect_output():
    """Everything that ranks other than 0 print, also below Python, goes to a file."""
    if RANK > 0:
        target = os.open(f"rank{RANK}.txt", os.O_WRONLY | os.O_CREAT)
        os.dup2(target, 1)
        os.dup2(target, 2)


def limit_files():
    """A limit on the size of files stands in for a full disk."""
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (150_000, 150_000))


if __name__ == "__main__":
    {
        "tap": redirect_output,
        "fault": lambda: in_the_fifth_step(1, fail),
        "lost": lambda: in_the_fifth_step(0, lambda: os.unlink("scene.vtkhdf")),
        "full": limit_files,
    }[sys.argv[1]]()
    raise SystemExit(cli.main(sys.argv[2:]))
