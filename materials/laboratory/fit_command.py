"""`periporo fit MATERIAL.yaml TESTS.yaml -o FOLDER`: the command line of `periporo.fit`."""

import importlib.util
import sys
from pathlib import Path

import numpy as np
import yaml

from periporo.errors import InputError
from periporo.materials.laboratory.files import write_table
from periporo.materials.laboratory.fit import Fit, fit

_INPUT_ERROR = 2


def add_arguments(parser) -> None:
    """Arguments of `periporo fit`."""
    parser.add_argument("material", help="YAML file with `model` and parameters, from which the search begins")
    parser.add_argument("tests", help="YAML file with `parameters` to find and `tests` with what was measured")
    parser.add_argument("-o", "--output", default="fit", help="folder of the results (default: %(default)s)")
    parser.add_argument("--no-plot", action="store_true", help="draw no pictures")


def run(arguments) -> int:
    """Carry out `periporo fit`; the exit status is 2 if an input is wrong."""
    try:
        found = fit(arguments.material, arguments.tests, say=print)
    except InputError as error:
        print(error, file=sys.stderr)
        return _INPUT_ERROR
    print("\n".join(described(found)))
    folder = Path(arguments.output)
    folder.mkdir(parents=True, exist_ok=True)
    material = folder / "material.yaml"
    material.write_text(yaml.safe_dump(found.data, sort_keys=False))
    print(material)
    draws = not arguments.no_plot and importlib.util.find_spec("matplotlib") is not None
    for number, (columns, measured) in enumerate(zip(found.curves, found.measured, strict=True)):
        table = folder / f"test_{number}.csv"
        write_table(table, columns)
        print(table)
        if draws:
            from periporo.materials.laboratory.plots import draw_plots  # only here: matplotlib is optional

            for file in draw_plots(found.material, columns, folder, f"test_{number}", [measured]):
                print(file)
    return 0


def described(found: Fit) -> list[str]:
    """A line for each parameter with its confidence, what is left, and pairs that are known only together."""
    width = max(map(len, found.values))
    lines = [f"{'parameter':{width}s}  value, with the half-width of its 95 % interval"]
    for name, value in found.values.items():
        half = found.confidence[name]
        lines.append(f"{name:{width}s}  {value:.6g} +- {half:.2g} ({abs(half / value) if value else np.inf:.1%})")
    lines.append(f"{'misfit':{width}s}  {found.misfit:.2%} of the measured ranges")
    names = list(found.values)
    for a, b in zip(*np.triu_indices(len(names), 1), strict=True):
        if abs(found.correlation[a, b]) > 0.95:
            lines.append(f"{names[a]} and {names[b]} are hardly told apart: correlation {found.correlation[a, b]:.2f}")
    return lines
