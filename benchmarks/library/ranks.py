"""Benchmarks that start themselves on a number of ranks."""

import os
import subprocess
import sys
from pathlib import Path

from .. import ROOT

_SHARED_CORES = {"MPIR_CVAR_ENABLE_HEAVY_YIELD": "1"}


def start(ranks: int, benchmark: str, *words) -> str:
    """Standard output of a benchmark with these words on a number of ranks; they wait patiently if they share cores."""
    mpirun = Path(sys.executable).with_name("mpirun")
    command = [str(mpirun), "-n", str(ranks), sys.executable, "-m", "benchmarks", benchmark, *map(str, words)]
    patience = _SHARED_CORES if ranks > (os.cpu_count() or 1) else {}
    run = subprocess.run(command, check=True, cwd=ROOT, env=os.environ | patience, stdout=subprocess.PIPE, text=True)
    return run.stdout
