"""Runs scenes, one after the other, on ranks that think they are on different processors: the second on an older one.

    mpirun -n 2 python mixed.py own.yaml common.yaml ...

Each rank prints the exit status and the processor that it compiles for.
"""

import os
import sys

if os.environ.get("PMI_RANK") == "1" or os.environ.get("OMPI_COMM_WORLD_RANK") == "1":
    os.environ |= {"NUMBA_CPU_NAME": "x86-64", "NUMBA_CPU_FEATURES": "+sse,+sse2"}

from periporo.core import cli
from periporo.core.numerics import jit

if __name__ == "__main__":
    for scene in sys.argv[1:]:
        status = cli.main([scene, "--quiet", "--no-plot"])
        sys.stdout.write(f"{scene} {status} {jit.processor()[0]}\n")  # all at once, for both ranks do so
        sys.stdout.flush()
