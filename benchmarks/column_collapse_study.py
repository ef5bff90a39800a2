"""Columns of soil that collapse under their weight: runs all cases, remakes pictures and table.

    python -m benchmarks column_collapse_study [--quick] [--only PATTERN] [--folder DIR] [--draw]

Each case of configs/studies/column_collapse.yaml runs in a folder of its own below DIR, as an ordinary scene. What is
finished is skipped, what was interrupted goes on. Then the pictures in docs/figures and the table in
docs/reference/column_collapse_cases.md are made from the cases that are there; --draw does only that. --quick runs
every case at a spacing of 5 mm and leaves pictures and table in DIR. --only takes the cases whose name matches a
pattern such as 'paper-*-dry-*'. Exit status 1 if a run failed.
"""

import sys
import time
from fnmatch import fnmatch
from pathlib import Path

from . import FIGURES, ROOT, option_parser
from .library.runs import is_finished
from .library.study import figures, table
from .library.study.cases import RESULT, Study, run

STUDY = ROOT / "configs" / "studies" / "column_collapse.yaml"
QUICK_SPACING = 5e-3  # m


def main(words=None):
    """Run, draw, tabulate."""
    parser = option_parser(__name__, __doc__)
    parser.add_argument("--quick", action="store_true", help="spacing 5 mm, pictures and table into the folder")
    parser.add_argument("--only", default="*", metavar="PATTERN", help="only cases whose name matches")
    parser.add_argument("--folder", type=Path, default=Path("column_collapse"), help="where the runs are kept")
    parser.add_argument("--draw", action="store_true", help="run nothing")
    arguments = parser.parse_args(words)
    folder = arguments.folder.resolve()
    study = Study(STUDY, QUICK_SPACING if arguments.quick else None)
    failed = [] if arguments.draw else run_all(study, arguments.only, folder)
    done = {case: folder / case.name for case in study.cases if is_finished(folder / case.name / RESULT)}
    spacing = QUICK_SPACING if arguments.quick else 2.5e-3
    figures.draw_all(done, spacing, folder / "pictures" if arguments.quick else FIGURES)
    rows = table.lines(done)
    print("\n".join([*rows, *table.scatter_lines(done)]))
    if arguments.quick:
        (folder / "table.md").write_text("\n".join(rows) + "\n")
    else:
        table.put_into(ROOT / "docs" / "reference" / "column_collapse_cases.md", rows)
    for name in failed:
        print(f"failed: {name}", file=sys.stderr)
    sys.exit(1 if failed else 0)


def run_all(study, pattern, folder):
    """Run the cases that match one after the other; the names of those that failed."""
    failed = []
    chosen = [case for case in study.cases if fnmatch(case.name, pattern)]
    for number, case in enumerate(chosen, start=1):
        began = time.monotonic()
        print(f"{number}/{len(chosen)} {case.name}", end=" ", flush=True)
        status = run(study, case, folder / case.name)
        print("failed" if status else f"{time.monotonic() - began:.0f} s", flush=True)
        if status:
            failed.append(case.name)
    return failed
