"""Runs the command line on several ranks for tests, with a fault or a tap where the first word says so.

    mpirun -n 3 python program.py tap config.yaml ...     what rank r > 0 prints goes to the file rank{r}.txt
    mpirun -n 3 python program.py fault config.yaml ...   rank 1 fails in the fifth step
"""

import os
import sys

from mpi4py import MPI

from periporo.core import cli
from periporo.core.fields import StrainMeasures

RANK = MPI.COMM_WORLD.rank


def fail_in_the_fifth_step():
    """Make rank 1 raise where no other rank does."""
    update, calls = StrainMeasures.update, []

    def injected_fault(self, *arguments):
        calls.append(1)
        if RANK == 1 and len(calls) == 5:
            raise ZeroDivisionError("injected fault")
        update(self, *arguments)

    StrainMeasures.update = injected_fault


def redirect_output():
    """Everything that ranks other than 0 print, also below Python, goes to a file."""
    if RANK > 0:
        target = os.open(f"rank{RANK}.txt", os.O_WRONLY | os.O_CREAT)
        os.dup2(target, 1)
        os.dup2(target, 2)


if __name__ == "__main__":
    {"tap": redirect_output, "fault": fail_in_the_fifth_step}[sys.argv[1]]()
    raise SystemExit(cli.main(sys.argv[2:]))
