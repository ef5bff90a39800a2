"""Runs the command line on several ranks in one folder or more (see folders.py), with signals after steps of each.

mpirun -n 2 python interrupted.py SIGTERM@40 --quiet ...                          to the last rank
mpirun -n 2 python interrupted.py mpirun:SIGUSR1@10,mpirun:SIGTERM@20 ...         to mpirun, which passes them on
mpirun -n 2 python interrupted.py everyone:SIGTERM@40 --quiet ...                 to mpirun and to every rank
"""

import os
import signal
import sys
import time
from pathlib import Path
from unittest import mock

import folders
from mpi4py import MPI

from periporo.core.watch.interrupt import Keeper

COMM = MPI.COMM_WORLD


def mpirun():
    """The launcher's process: the parent with Open MPI, its parent with MPICH, which puts a proxy between."""
    process = os.getppid()
    while not Path(f"/proc/{process}/comm").read_text().startswith(("mpirun", "mpiexec")):
        process = int(Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[1])
    return process


def send(target, number):
    """Send a signal from the last rank: to itself, to mpirun or to everyone."""
    last = COMM.rank == COMM.size - 1
    if target != "mpirun" and (last or target == "everyone"):
        os.kill(os.getpid(), number)
    if target and last:
        os.kill(mpirun(), number)


def main(words):
    """The exit status."""
    signals = {}  # step -> to whom, number
    for word in words[0].split(","):
        wish, _, step = word.partition("@")
        target, _, name = wish.rpartition(":")
        signals[int(step)] = target, getattr(signal, name)

    def check_after_signal(self, sim, check=Keeper.check):
        if sim.step_number in signals:
            target, number = signals[sim.step_number]
            send(target, number)
            while target and not self.signals.wishes:
                time.sleep(0.01)
        check(self, sim)

    return folders.main(words[1:], lambda name: mock.patch.object(Keeper, "check", check_after_signal))


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
