"""What became slower or faster between two commits: a dozen kernels and five short scenes, measured in turns.

    python -m benchmarks regress e5fa1bd            # the files as they are, against a commit
    python -m benchmarks regress e5fa1bd main       # one commit against another
    python -m benchmarks regress e5fa1bd main --append      # and keep the ratios in benchmarks/speed.csv
    python -m benchmarks regress --table            # what is kept there

Both versions are laid out in a temporary folder, with caches of their own, and compile at the same time. Then a process
of each measures every kernel and scene in turns, A B, B A, ..., and new processes go on, because the place of code and
arrays in memory is part of the time of a process. Processor time counts, so that other work on the machine disturbs
little. The ratio B/A of each turn is one sample; printed are their median and quartiles. Slower or faster is what
differs by more than 3 % in its median and, in the same direction, in three quarters of the turns. Exit status 1 if
something is slower. Two to four minutes on two free cores.
"""

import resource
import sys
import tempfile
import time
from contextlib import ExitStack
from pathlib import Path

import numpy as np

from . import option_parser
from .library import speed_table
from .library.versions import CHECKOUT, Process, VersionError, lay_out, name_of
from .library.workload import KERNELS, NAMES, SCENES

THRESHOLD = 0.03


def compile_both(folders) -> None:
    """Have both versions compile all that is measured, at the same time."""
    with ExitStack() as stack:
        pair = [stack.enter_context(Process(folder)) for folder in folders]
        for name in NAMES:
            for process in pair:
                process.ask(name)
        for process in pair:
            for _ in NAMES:
                process.seconds()


def measure(folders, processes: int, turns: int) -> dict[str, np.ndarray]:
    """Samples (n, 2) s of A and B by measurement; what one of them lacks is left out."""
    samples = {}
    for _ in range(processes):
        with ExitStack() as stack:
            pair = [stack.enter_context(Process(folder)) for folder in folders]
            for process in pair:
                for name in NAMES:  # loads the kernels
                    process.measure(name)
            for turn in range(turns):
                for name in NAMES:
                    order = (0, 1) if turn % 2 == 0 else (1, 0)
                    found = {k: pair[k].measure(name) for k in order}
                    for what in found[0].keys() & found[1].keys():
                        samples.setdefault(what, []).append((found[0][what], found[1][what]))
    return {what: np.array(pairs) for what, pairs in sorted(samples.items(), key=lambda item: place(item[0]))}


def place(what: str) -> tuple:
    """Where a measurement stands in the table: that of its scene, then that of its part."""
    name, _, part = what.partition(": ")
    return NAMES.index(name), KERNELS[name][1].index(part) if part else 0


def verdict(ratios: np.ndarray) -> str:
    """slower, faster, or nothing, from the ratios (n,) of B over A."""
    low, middle, high = np.quantile(ratios, (0.25, 0.5, 0.75))
    if middle > 1.0 + THRESHOLD and low > 1.0:
        return "slower"
    return "faster" if middle < 1.0 - THRESHOLD and high < 1.0 else ""


def main(words=None):
    """Measure and compare; 1 if something is slower."""
    parser = option_parser(__name__, __doc__)
    parser.add_argument("before", nargs="?", metavar="A", help="a commit")
    parser.add_argument("after", nargs="?", metavar="B", default=CHECKOUT, help="another (default: the files)")
    parser.add_argument("--processes", type=int, default=4, help="of each version, one after the other")
    parser.add_argument("--turns", type=int, default=6, help="of each pair of processes")
    parser.add_argument("--append", action="store_true", help=f"keep the ratios in {speed_table.FILE.name}")
    parser.add_argument("--table", action="store_true", help="print what is kept, and measure nothing")
    arguments = parser.parse_args(words)
    if arguments.table:
        print("\n".join(speed_table.lines()))
        return 0
    if arguments.before is None:
        parser.error("which commits are to be compared?")
    if arguments.append and arguments.after == CHECKOUT:
        parser.error("--append keeps the speed of a commit: name B")
    began = time.monotonic()
    try:
        names = [name_of(version) for version in (arguments.before, arguments.after)]
        with tempfile.TemporaryDirectory(prefix="regress-") as folder:
            folders = [lay_out(name, Path(folder) / f"{side}-{name}") for side, name in zip("AB", names, strict=True)]
            compile_both(folders)
            print(f"A {names[0]}, B {names[1]}: compiled in {time.monotonic() - began:.0f} s", flush=True)
            samples = measure(folders, arguments.processes, arguments.turns)
    except VersionError as error:
        print(error, file=sys.stderr)
        return 2
    changes = report(samples)
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    print(f"{arguments.processes * arguments.turns} turns, {time.monotonic() - began:.0f} s in all, "
          f"{used.ru_utime + used.ru_stime:.0f} s of processor time")  # fmt: skip
    if arguments.append:
        speed_table.append(*names, samples)
    return 1 if "slower" in changes else 0


def report(samples) -> list[str]:
    """Print the table and what has changed; the verdicts."""
    print(f"\n{'':34s} {'A, ms':>8s} {'B, ms':>8s}   B/A (quartiles)")
    verdicts = {}
    for what, pairs in samples.items():
        ratios = pairs[:, 1] / pairs[:, 0]
        low, middle, high = np.quantile(ratios, (0.25, 0.5, 0.75))
        a, b = 1e3 * np.median(pairs, axis=0)
        verdicts[what] = verdict(ratios)
        print(f"{what:34s} {a:8.3f} {b:8.3f}   {middle:.3f} ({low:.3f}-{high:.3f}) {verdicts[what]}")
    print("\nkernels: time in a step; scenes (" + ", ".join(SCENES) + "): of all their steps")
    for kind in ("slower", "faster"):
        found = [what for what, said in verdicts.items() if said == kind]
        print(f"{kind} by more than {100 * THRESHOLD:.0f} %: {', '.join(found) or 'nothing'}")
    return list(verdicts.values())
