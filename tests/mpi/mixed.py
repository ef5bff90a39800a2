"""Runs the command line on ranks that think they are on different processors: the second on an older one.

    mpirun -n 2 python mixed.py scene.yaml ...
"""

import os
import sys

if os.environ.get("PMI_RANK") == "1" or os.environ.get("OMPI_COMM_WORLD_RANK") == "1":
    os.environ |= {"NUMBA_CPU_NAME": "x86-64", "NUMBA_CPU_FEATURES": "+sse,+sse2"}

from periporo.core import cli

if __name__ == "__main__":
    raise SystemExit(cli.main(sys.argv[1:]))
