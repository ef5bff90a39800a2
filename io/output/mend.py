"""What a killed run leaves of an output in a result file, removed."""

from pathlib import Path

import h5py
import numpy as np

from periporo.io.output.lock import Lock, Locked
from periporo.io.output.parts import Part, part_of
from periporo.io.output.vtkhdf_layout import Index, cut, is_whole, reopen, stored_columns


def mend(path: Path) -> str | None:
    """Cut off what a killed run left of an output that it was writing.

    What was done, or why not, as a sentence; None if the file is whole or not one of ours.
    """
    try:
        with h5py.File(path, "r", locking=False) as file:
            if "VTKHDF/Steps/StepNumbers" not in file:
                return None
            columns = stored_columns(file["VTKHDF"])
            longer = _longer(path, Index(file).part_rows, columns)
            whole = is_whole(file)
    except (OSError, RuntimeError, KeyError):
        return None  # whoever reads it will say why
    if whole and not longer:
        return None
    try:
        lock = Lock(Path(path))
    except Locked as holder:
        return f"an output is being written ({holder})"
    except OSError as error:
        return f"the last output was cut off while it was written, and the file cannot be mended: {error.strerror}"
    with lock:
        try:
            with reopen(path) as file:
                cut(file, np.inf)
            for number, rows in longer.items():
                Part(path, number, columns, rows).close()  # which drops what is behind its rows
        except OSError as error:
            return f"the last output was cut off while it was written, and the file cannot be mended: {error}"
    return "the last output was cut off while it was written; what there was of it has been removed"


def _longer(path, part_rows, columns):
    """The parts that hold more rows than count, by number, with the rows that do."""
    found = {}
    for number, rows in enumerate([] if part_rows is None else part_rows.sum(axis=0).tolist()):
        with h5py.File(part_of(path, number), "r", locking=False) as file:
            lengths = [len(file[name]) for name in columns]
        if min(lengths) >= rows and max(lengths) > rows:  # others are damaged, which readers tell
            found[number] = rows
    return found
