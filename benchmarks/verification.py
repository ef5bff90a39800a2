"""Remakes the figures of docs/reference/verification_figures.md.

    python -m benchmarks verification [--quick] [--case V5] [--scheme sub_horizon]

Runs every case, or one, and prints what it measures and must meet; exit status 1 if a target is missed. At full
size, which takes about an hour, it puts the rows of the cases that it ran into the table; --quick runs the small
sizes of the tests, and --scheme runs cases with another correspondence scheme: both only print.
"""

import sys
import time

from . import ROOT, option_parser
from .library.verification_cases import CASES, OPTIONS, SCHEMES

PAGE = ROOT / "docs" / "reference" / "verification_figures.md"
HEAD = "| case | what | figure | value | target | met | seconds |"


def rows_of(case, scheme, full):
    """Lines of the table for one case."""
    began = time.perf_counter()
    figures = case.run(full, scheme)
    seconds = time.perf_counter() - began
    what = case.what if case.schemes == SCHEMES[:1] else f"{case.what} ({scheme})"
    verdict = {f: "" if f.target == "recorded" else "yes" if f.met else "**no**" for f in figures}
    labels = [f"{what} | "] + [" | "] * (len(figures) - 1)
    times = [f"{seconds:.0f}"] + [""] * (len(figures) - 1)
    lines = [
        f"| {case.name} | {label}{f.what} | {f.value:.4g} | {f.target} | {verdict[f]} | {time_} |"
        for label, f, time_ in zip(labels, figures, times, strict=True)
    ]
    print("\n".join(lines), flush=True)
    return lines, all(f.met for f in figures)


def write(fresh, names):
    """Put the lines `fresh` (by case name) into the table on the page, in the order of the cases."""
    text, _, table = PAGE.read_text().partition(HEAD)
    old = [line for line in table.splitlines() if line.startswith("| ") and line.split()[1] not in names]
    order = list(dict.fromkeys(case.name for case in CASES))
    lines = sorted(old + fresh, key=lambda line: order.index(line.split()[1]))
    PAGE.write_text("\n".join([f"{text}{HEAD}", "|---|---|---|---|---|---|---|", *lines]) + "\n")


def main(words=None):
    """Run, print, and write the table."""
    parser = option_parser(__name__, __doc__)
    parser.add_argument("--quick", action="store_true", help="small sizes; the table is left as it is")
    parser.add_argument("--case", choices=sorted({c.name for c in CASES}), help="only this case")
    schemes = list(dict.fromkeys([*SCHEMES, *OPTIONS]))
    parser.add_argument("--scheme", choices=schemes, help="another scheme; the table is left as it is")
    arguments = parser.parse_args(words)
    chosen = [case for case in CASES if arguments.case in (None, case.name)]
    lines, sound = [], True
    print(HEAD)
    for case in chosen:
        for scheme in [arguments.scheme] if arguments.scheme else case.schemes:
            rows, met = rows_of(case, scheme, not arguments.quick)
            lines, sound = lines + rows, sound and met
        if not arguments.quick and not arguments.scheme:
            done = {c.name for c in chosen[: chosen.index(case) + 1]}
            write(lines, done)  # now, so that an interrupted run keeps what it has
    sys.exit(0 if sound else 1)
