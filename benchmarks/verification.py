"""Remakes the figures of docs/reference/verification.

    python -m benchmarks verification [--quick] [--case V5] [--scheme sub_horizon]

Runs every case, or one, and prints what it measures, must meet and takes in s of processor time; exit status 1 if a
target is missed. At full size, which takes about an hour, it puts the sections of the cases that it ran into their
pages; --quick runs the small sizes of the tests, and --scheme runs cases with another correspondence scheme: both only
print.
"""

import itertools
import sys
import textwrap
import time

from . import ROOT, option_parser
from .library.verification_cases import CASES, OPTIONS, SCHEMES

FOLDER = ROOT / "docs" / "reference" / "verification"
PAGES = {  # title, and the cases up to the first of the next page
    "invariants": ("Verification: invariants", "V1"),
    "closed_forms": ("Verification: waves, equilibria and laws", "V5"),
    "ground": ("Verification: sliding, failure and collapse", "V15"),
    "contact": ("Verification: contact", "C1"),
    "water": ("Verification: water", "W1"),
}
HEAD = "| scheme | figure | value | target | met | s |"


def rows_of(case, scheme, full):
    """Rows of the table for one case with one scheme, and whether all targets are met."""
    began = time.process_time()
    figures = case.run(full, scheme)
    first = (scheme, f"{time.process_time() - began:.0f}")
    rows = []
    for f in figures:
        met = "" if f.target == "recorded" else "yes" if f.met else "**no**"
        rows.append(f"| {first[0]} | {f.what} | {f.value:.4g} | {f.target} | {met} | {first[1]} |")
        first = ("", "")
        print(f"| {case.name} {rows[-1]}", flush=True)
    return rows, all(f.met for f in figures)


def section(name, results):
    """The section of a case, from what its parts compare and their rows."""
    lines = [f"## {name}"]
    for what, rows in results:
        text = textwrap.wrap(f"{what[0].upper()}{what[1:]}.", 120)
        lines += ["", *text, "", HEAD, "|---" * HEAD.count(" | ") + "|---|", *rows]
    return "\n".join(lines) + "\n"


def write(fresh):
    """Put the sections `fresh`, by the case's name, into the pages, in the order of the cases; the others stay."""
    order = list(dict.fromkeys(case.name for case in CASES))
    starts = [order.index(first) for _, first in PAGES.values()]
    for (page, (title, _)), start, end in zip(PAGES.items(), starts, [*starts[1:], None], strict=True):
        file, found = FOLDER / f"{page}.md", {}
        if file.exists():
            found = {part.split("\n")[0]: f"## {part}" for part in file.read_text().split("\n## ")[1:]}
        found = {name: text.rstrip("\n") + "\n" for name, text in (found | fresh).items()}
        head = (
            f"# {title}\n\nWhat the cases measure, must meet and take in s of processor time, remade by\n"
            "`python -m benchmarks verification`. "
            "[Verification](../../explanation/verification.md) tells how the cases are set up.\n"
        )
        file.write_text("\n".join([head, *(found[name] for name in order[start:end] if name in found)]))


def main(words=None):
    """Run, print, and write the table."""
    parser = option_parser(__name__, __doc__)
    parser.add_argument("--quick", action="store_true", help="small sizes; the pages are left as they are")
    parser.add_argument("--case", choices=sorted({c.name for c in CASES}), help="only this case")
    schemes = list(dict.fromkeys([*SCHEMES, *OPTIONS]))
    parser.add_argument("--scheme", choices=schemes, help="another scheme; the pages are left as they are")
    arguments = parser.parse_args(words)
    chosen = [case for case in CASES if arguments.case in (None, case.name)]
    sound = True
    print(f"| case {HEAD}")
    for name, cases in itertools.groupby(chosen, key=lambda case: case.name):
        results = []
        for case in cases:
            results.append((case.what, []))
            for scheme in [arguments.scheme] if arguments.scheme else case.schemes:
                rows, met = rows_of(case, scheme, not arguments.quick)
                results[-1][1].extend(rows)
                sound = sound and met
        if not arguments.quick and not arguments.scheme:  # now, so that an interrupted run keeps what it has
            write({name: section(name, results)})
    sys.exit(0 if sound else 1)
