"""`periporo profile`: a field of a result along a line, as a table."""

import argparse
import csv
from pathlib import Path

import numpy as np

from periporo.io.output.results import ResultError, open_results


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of `periporo profile`."""
    parser.add_argument("path", type=Path, help="result file")
    parser.add_argument("field", help="name of a field, such as velocity")
    for name, meaning in (("from", "begins"), ("to", "ends")):
        parser.add_argument(
            f"--{name}", dest=f"{name}_", type=float, nargs="+", required=True, metavar="M",
            help=f"coordinates at which the line {meaning}",
        )  # fmt: skip
    parser.add_argument("--step", type=int, default=-1, help="output, -1 is the last (default)")
    parser.add_argument("--count", type=int, default=101, help="places along the line (default 101)")
    parser.add_argument("-o", "--output", type=Path, metavar="FILE", help="default: run_FIELD_profile.csv beside it")


def run(arguments: argparse.Namespace) -> int:
    """Run `periporo profile`; the exit status."""
    path, field = arguments.path, arguments.field
    with open_results(path) as results:
        if arguments.count < 2:
            raise ResultError(f"--count must be at least 2, not {arguments.count}")
        way, values = results.profile(field, arguments.from_, arguments.to_, arguments.step, count=arguments.count)
        unit = f" [{results.unit(field)}]" if results.unit(field) else ""
        heads = [f"{field} {name}".strip() + unit for name in results.components(field) or ("",)]
    file = arguments.output or path.with_name(f"{path.stem}_{field}_profile.csv")
    file.parent.mkdir(parents=True, exist_ok=True)
    with open(file, "w", newline="") as opened:
        table = csv.writer(opened)
        table.writerow(["distance [m]", *heads])
        table.writerows(np.column_stack([way, values]).tolist())
    soil = int(np.isfinite(values.reshape(len(way), -1)).all(axis=1).sum())
    print(f"{file}: {field} at {len(way)} places, {soil} of them in soil (nan elsewhere)")
    return 0
