"""Runs the command line on several ranks in one folder or more (see folders.py), with a signal after a step of each.

mpirun -n 2 python interrupted.py SIGTERM 40 --quiet ...            to the last rank
mpirun -n 2 python interrupted.py mpirun:SIGTERM 40 --quiet ...     to mpirun, which passes it on
mpirun -n 2 python interrupted.py everyone:SIGTERM 40 --quiet ...   to mpirun and to every rank
"""

import os
import signal
import sys
import time
from pathlib import Path

import folders
from mpi4py import MPI

from periporo.core.watch.interrupt import Keeper

TO, _, NAME = sys.argv[1].rpartition(":")
STEP = int(sys.argv[2])
COMM = MPI.COMM_WORLD


def mpirun():
    """The launcher's process: the parent with Open MPI, its parent with MPICH, which puts a proxy between."""
    process = os.getppid()
    while not Path(f"/proc/{process}/comm").read_text().startswith(("mpirun", "mpiexec")):
        process = int(Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[1])
    return process


def check_after_signal(self, sim, check=Keeper.check):
    if sim.step_number == STEP:
        number, last = getattr(signal, NAME), COMM.rank == COMM.size - 1
        if TO != "mpirun" and (last or TO == "everyone"):
            os.kill(os.getpid(), number)
        if TO and last:
            os.kill(mpirun(), number)
        while TO and not self.signals.wishes:
            time.sleep(0.01)
    check(self, sim)


if __name__ == "__main__":
    Keeper.check = check_after_signal
    raise SystemExit(folders.run(sys.argv[3:]))
