"""Runs the command line in one folder after the other: ranks take seconds to start, so they start once.

    mpirun -n 3 python folders.py --quiet ...     in every folder below that holds a scene.yaml, or where it stands

Before each, a line `== NAME` goes to standard output and error; `tests/mpi/conftest.py` divides them again.
"""

import contextlib
import sys
from pathlib import Path

from mpi4py import MPI

from periporo.core import cli


def announce(name):
    """What is said from now on belongs to this name."""
    if MPI.COMM_WORLD.rank == 0:
        for stream in (sys.stdout, sys.stderr):
            print(f"== {name}", file=stream, flush=True)


def main(words, within=lambda name: contextlib.nullcontext()):
    """The largest exit status; `within` gives the context to run in by the name of the folder."""
    here = Path.cwd()
    below = sorted(scene.parent for scene in here.glob("*/scene.yaml"))
    statuses = []
    for folder in below or [here]:
        announce(folder.name)
        with contextlib.chdir(folder), within(folder.name):
            statuses.append(cli.main(["scene.yaml", *words]))
    return max(statuses)


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
