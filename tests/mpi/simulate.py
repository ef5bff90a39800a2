"""Checks parts of the core (see parts.py), and runs the command line in every folder (see folders.py).

    mpirun -n 3 python simulate.py --no-plot ...     what ranks above 0 print goes to the file rank{r}.txt
"""

import os
import sys

import folders
import parts
from mpi4py import MPI


def redirect_output(rank):
    """Everything that this rank prints, also below Python, goes to a file."""
    target = os.open(f"rank{rank}.txt", os.O_WRONLY | os.O_CREAT)
    os.dup2(target, 1)
    os.dup2(target, 2)


def main(words):
    """The exit status of the command line."""
    if MPI.COMM_WORLD.rank > 0:
        redirect_output(MPI.COMM_WORLD.rank)
    folders.announce("parts")
    parts.main()
    return folders.main(words)


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
