"""Runs the command line on several ranks and sends the last one a signal after a step.

    mpirun -n 2 python interrupted.py SIGTERM 40 config.yaml ...
"""

import os
import signal
import sys

from mpi4py import MPI

from periporo.core import cli
from periporo.core.interrupt import Keeper

NAME, STEP = sys.argv[1], int(sys.argv[2])
COMM = MPI.COMM_WORLD


def check_after_signal(self, sim, check=Keeper.check):
    if sim.step_number == STEP and COMM.rank == COMM.size - 1:
        os.kill(os.getpid(), getattr(signal, NAME))
    check(self, sim)


if __name__ == "__main__":
    Keeper.check = check_after_signal
    raise SystemExit(cli.main(sys.argv[3:]))
