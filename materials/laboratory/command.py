"""`periporo drive MATERIAL.yaml TEST -o FOLDER`: the command line of `periporo.drive`."""

import argparse
import importlib.util
import sys
from pathlib import Path

import numpy as np

from periporo.errors import InputError, Problem
from periporo.materials.laboratory.columns import STOPPABLE
from periporo.materials.laboratory.drive import DriveStopped, as_test, drive
from periporo.materials.laboratory.files import as_material, write_table
from periporo.materials.laboratory.paths import BUILT_IN

_INPUT_ERROR, _STOPPED = 2, 3  # exit status


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of `periporo drive`."""
    parser.add_argument("material", help="YAML file with `model` and its parameters")
    parser.add_argument(
        "path",
        help="YAML file of a test in phases; CSV file with time_s and strain_xx, stress_xx or F11 columns; or a "
        f"built-in path ({', '.join(BUILT_IN)}), as in triaxial:confining=1e5,strain=0.1,rows=100,rate=1e-3",
    )
    parser.add_argument("-o", "--output", default="drive", help="folder of the results (default: %(default)s)")
    parser.add_argument("-n", "--substeps", type=int, help="steps per row (default: 10, or what the test says)")
    parser.add_argument(
        "--initial-stress",
        metavar="PA",
        help="mean stress, or six components xx,yy,zz,xy,yz,xz, tension positive: --initial-stress=-1e5",
    )
    parser.add_argument(
        "--volume", type=float, default=1.0, metavar="M3",
        help="volume of the specimen, for laws with a size effect (default: 1 m^3)",
    )  # fmt: skip
    parser.add_argument(
        "--id", type=int, default=0, metavar="N", help="number of the point, for laws that draw by it (default: 0)"
    )
    parser.add_argument(
        "--measured", action="append", default=[], metavar="CSV",
        help=f"curve to draw over, with any of the columns {', '.join(STOPPABLE)}; may be repeated",
    )  # fmt: skip
    parser.add_argument("--no-plot", action="store_true", help="draw no pictures")


def run(arguments: argparse.Namespace) -> int:
    """Carry out `periporo drive`; messages go to stderr.

    The exit status is 2 if an input is wrong, 3 if the point did not reach the end of the path: the table then
    holds the rows that it reached.
    """
    status = 0
    folder = Path(arguments.output)
    draws = not arguments.no_plot and importlib.util.find_spec("matplotlib") is not None
    try:
        material, test = as_material(arguments.material), as_test(arguments.path)
        columns = drive(
            material, test, arguments.substeps, _parse_stress(arguments.initial_stress), volume=arguments.volume,
            number=arguments.id, pictures=folder if draws else None, measured=arguments.measured,
        )  # fmt: skip
    except InputError as error:
        print(error, file=sys.stderr)
        return _INPUT_ERROR
    except DriveStopped as stop:
        print(f"{stop}\nthe table ends before that row", file=sys.stderr)
        columns, status = stop.columns, _STOPPED
    folder.mkdir(parents=True, exist_ok=True)
    table = folder / f"{test.name}.csv"
    write_table(table, columns)
    print(table)
    if draws:
        print("\n".join(str(file) for file in sorted(folder.glob(f"{test.name}_*.png"))))
    elif not arguments.no_plot:
        print("no plots: they need matplotlib (pip install 'periporo[plot]')", file=sys.stderr)
    return status


def _parse_stress(text: str | None) -> np.ndarray | None:
    if text is None:
        return None
    try:
        values = np.array([float(part) for part in text.split(",")])
    except ValueError:
        values = np.full(6, np.nan)
    if len(values) == 1:
        values = values[0] * np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0])
    if len(values) != 6 or not np.isfinite(values).all():
        message = f"one number or six are needed, separated by commas, not '{text}'"
        raise InputError("--initial-stress", [Problem((), message)])
    return values
