"""`periporo merge`: a result file in parts made one file."""

import contextlib
from pathlib import Path

import numpy as np

from periporo.errors import OutputError
from periporo.io.output.results import open_results
from periporo.io.output.vtkhdf import ResultFile
from periporo.io.output.vtkhdf_layout import STORED_COMPONENTS


def merge(path: Path, target: Path, overwrite: bool = False) -> None:
    """Write what the result file `path` holds into one new file, as a run without parts would have.

    Raises OutputError if the file exists or cannot be written, ResultError if the results cannot be read.
    """
    if target.absolute() == path.absolute():
        raise OutputError(f"{target} cannot be merged into itself; name another file")
    widths = {len(components): width for width, components in STORED_COMPONENTS.items()}
    with open_results(path) as results:
        results.origin = np.zeros(3)  # places stay as they are in the file
        names = results.history_names
        fields = {name: (widths[len(results.components(name))], results.unit(name)) for name in results.fields}
        file = ResultFile(
            target, results.dimension, fields, history_units={name: results.unit(name) for name in names},
            overwrite=overwrite, resume_step=None, obstacles="obstacles" in results.attributes,
        )  # fmt: skip
        with contextlib.closing(file):
            file.put_attributes(results.attributes)
            histories = [results.history(name).tolist() for name in names]
            if histories:
                file.put_history([dict(zip(names, row, strict=True)) for row in zip(*histories, strict=True)])
            for k in range(len(results)):
                _put_output(file, results, k, fields)


def _put_output(file, results, k, fields):
    file.begin_output(int(results.point_counts[k]), results.cells(k))
    file.put_rows("PointData/id", 0, results.ids(k))
    file.put_rows("Points", 0, results.positions(k))
    for name in fields:
        file.put_rows(f"PointData/{name}", 0, results.field(name, k))
    file.finish_output(float(results.times[k]), int(results.steps[k]))


def add_arguments(parser):
    """Arguments of `periporo merge`."""
    parser.add_argument("path", type=Path, help="result file in parts")
    parser.add_argument("target", type=Path, help="result file to write")
    parser.add_argument("--overwrite", action="store_true", help="replace an existing file")


def run(arguments):
    """Run `periporo merge`; the exit status."""
    merge(arguments.path, arguments.target, arguments.overwrite)
    print(f"merged: {arguments.target}")
    return 0
