"""Verification cases by every correspondence scheme, with measured orders of convergence.

    python -m benchmarks schemes_accuracy [--quick] [--only V6] [--scheme sub_horizon] [--folder DIR] [--draw]

Runs the cases V2, V3 and V5 to V9 of benchmarks/verification_cases at full size by every scheme (an hour or two) and
writes docs/figures/schemes_accuracy.md. Each case of a scheme leaves a file in DIR and is not repeated; --draw only
makes the table of what is there. --quick runs the small sizes of the tests and leaves the table in DIR. Figures of
`sub_horizon_published` are recorded, those of `standard` too where its oscillations matter; exit status 1 if one of a
stable scheme is not met.
"""

import json
import re
import sys
import time
from dataclasses import asdict
from pathlib import Path

from periporo.core.motion.relaxation import RelaxationError

from . import FIGURES, option_parser
from .library.verification_cases import CASES, SCHEMES, Figure

TABLE = FIGURES / "schemes_accuracy.md"
NAMES = ("V5", "V6", "V7", "V8", "V9", "V2", "V3")  # the longest last


def file_of(case, scheme, full, folder) -> Path:
    """Where the figures of a case by a scheme are kept."""
    name = scheme.replace(", ", "_")
    return folder / f"{case.name}-{case.function.__name__}-{name}-{'full' if full else 'quick'}.json"


def figures_of(case, scheme, full, folder):
    """The figures of a case by a scheme, from its file if it is there; text if it came to no end."""
    file = file_of(case, scheme, full, folder)
    if not file.exists():
        began = time.monotonic()
        try:
            outcome = [asdict(f) for f in case.run(full, scheme)]
        except RelaxationError as error:
            if scheme == SCHEMES[0]:
                raise
            outcome = str(error)
        folder.mkdir(parents=True, exist_ok=True)
        file.write_text(json.dumps(outcome, indent=1) + "\n")
        print(f"{file.name} {time.monotonic() - began:.0f} s", flush=True)
    outcome = json.loads(file.read_text())
    return outcome if isinstance(outcome, str) else [Figure(**f) for f in outcome]


def table(results) -> list[str]:
    """Lines of the table of {(case, scheme): figures}: a row for each figure, a column for each scheme."""
    short = {"point_state, sharpened": "sharpened", "sub_horizon_published": "published"}
    lines = [f"| case | figure | {' | '.join(short.get(s, s) for s in SCHEMES)} |", "|---" * (2 + len(SCHEMES)) + "|"]
    for case in dict.fromkeys(case for case, _ in results):
        columns = {s: results.get((case, s), []) for s in SCHEMES}
        rows = max((f for f in columns.values() if not isinstance(f, str)), key=len)
        for k, figure in enumerate(rows):
            cells = [_cell(columns[s], k, figure.target) for s in SCHEMES]
            lines.append(f"| {case.name} | {figure.what.removesuffix(', relative')} | {' | '.join(cells)} |")
    return lines


def _cell(figures, k, target):
    if isinstance(figures, str):
        return "no equilibrium"
    if k >= len(figures):
        return ""
    value = figures[k].value
    value = f"{value:.2e}" if 0 < abs(value) < 1e-3 else f"{value:.3g}"
    value = re.sub(r"e\+?(-?)0?", r"e\1", value)  # 1e-05 as 1e-5, 1e+10 as 1e10
    return value if target == "recorded" or figures[k].met else f"**{value}**"


def main(words=None):
    """Run and tabulate."""
    parser = option_parser(__name__, __doc__)
    parser.add_argument("--quick", action="store_true", help="small sizes, table into the folder")
    parser.add_argument("--only", choices=NAMES, help="only this case")
    parser.add_argument("--scheme", choices=SCHEMES, help="only this scheme")
    parser.add_argument("--folder", type=Path, default=Path("schemes_accuracy"), help="where the figures are kept")
    parser.add_argument("--draw", action="store_true", help="run nothing")
    arguments = parser.parse_args(words)
    folder, full = arguments.folder.resolve(), not arguments.quick
    results = {}
    for name in NAMES:
        for case in (c for c in CASES if c.name == name and SCHEMES[0] in c.schemes):
            for scheme in SCHEMES:
                chosen = arguments.only in (None, name) and arguments.scheme in (None, scheme) and not arguments.draw
                if chosen or file_of(case, scheme, full, folder).exists():
                    results[case, scheme] = figures_of(case, scheme, full, folder)
    lines = table(results)
    print("\n".join(lines))
    (TABLE if full else folder / TABLE.name).write_text("\n".join(lines) + "\n")
    required = [f for (_, scheme), figures in results.items() if scheme == SCHEMES[0] for f in figures]
    sys.exit(0 if all(f.met for f in required) else 1)
