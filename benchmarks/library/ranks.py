"""Benchmarks that start themselves on a number of ranks."""

import os
import subprocess
import sys
from pathlib import Path

from .. import ROOT

_SHARED_CORES = {"MPIR_CVAR_ENABLE_HEAVY_YIELD": "1"}


def command(ranks: int, *words) -> tuple[list[str], dict[str, str]]:
    """What starts Python with these words on a number of ranks, and variables: they wait patiently if cores are few."""
    mpirun = Path(sys.executable).with_name("mpirun")
    patience = _SHARED_CORES if ranks > (os.cpu_count() or 1) else {}
    return [str(mpirun), "-n", str(ranks), sys.executable, *map(str, words)], patience


def start(ranks: int, benchmark: str, *words) -> str:
    """Standard output of a benchmark with these words on a number of ranks."""
    line, patience = command(ranks, "-m", "benchmarks", benchmark, *words)
    run = subprocess.run(line, check=True, cwd=ROOT, env=os.environ | patience, stdout=subprocess.PIPE, text=True)
    return run.stdout
