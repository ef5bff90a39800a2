"""Results in parts: the rows of points in files of their own, in the folder `<name>.parts` beside the result file.

Part w of W holds the points whose ids lie in the w-th of W equal ranges, in the order of ids, one output after the
other; obstacles follow in the last part. So what a part holds depends on the scene and not on the ranks, and rows of
all parts one after the other are those of a single file. `Steps/PartRows` of the result file counts them. `index.h5`
joins them by virtual datasets, to which the result file has external links: VTK, ParaView and h5py read it as one.

At an output the parts are written first, then a new index takes the place of the old one, and then the result file
counts the output: whoever reads meanwhile sees the outputs before. A part that is missing shows as zeros to HDF5, and
so to other programs; `open_results` looks first.
"""

import os
from collections.abc import Callable, Iterable
from pathlib import Path

import h5py
import numpy as np

from periporo.core.numerics.cells import Cells
from periporo.errors import OutputError
from periporo.io.output.vtkhdf_layout import (
    ACCESS,
    INDEX,
    Column,
    close,
    create_rows,
    folder_of,
    put,
    reopen,
    reserve,
    sync,
)


def part_of(path: Path, number: int) -> Path:
    """Part `number` of the result file `path`."""
    return folder_of(path) / f"{number:04d}.h5"


def remove(path: Path) -> None:
    """Remove the parts of a result file that is to be replaced; a folder that holds anything else stays."""
    folder = folder_of(path)
    if folder.is_dir():
        for file in [*folder.glob("[0-9][0-9][0-9][0-9].h5"), *folder.glob(f"{INDEX}*")]:
            file.unlink()
        if not any(folder.iterdir()):
            folder.rmdir()


class Part:
    """A part file open for writing, by the rank that owns it. rows: go on behind these; None: make it."""

    def __init__(self, path: Path, number: int, columns: dict[str, Column], rows: int | None = None):
        self.path, self.columns = part_of(path, number), columns
        self._result = path
        if rows is None:
            self._file = create_rows(self.path, columns)
            self.rows = 0
        else:
            self._file = reopen(self.path)
            self.cut(rows)
        self._file.flush()

    def append(self, rows: dict[str, np.ndarray], obstacles: Cells | None) -> None:
        """Write rows of points of an output, by dataset, and obstacles behind them, and bring them out."""
        ids = rows["PointData/id"]
        twice = np.flatnonzero(np.diff(ids) == 0)
        if len(twice):
            raise OutputError(f"cannot write {self._result}: the global id {ids[twice[0]]} occurs twice")
        end = self.rows + len(ids) + (0 if obstacles is None else len(obstacles.points))
        reserve(self._file, self.path, [(self._file[name], end) for name in rows])
        self._put(rows)
        if obstacles is not None:
            self._put(obstacle_rows(obstacles, self.columns))
        self._file.flush()

    def _put(self, rows):
        for name, values in rows.items():
            put(self._file[name], self.rows, padded(values, self.columns[name]))
        self.rows += len(rows["Points"])

    def sync(self) -> None:
        """Bring all to the disk."""
        self._file.flush()
        sync(self.path)

    def cut(self, rows: int) -> None:
        """Drop what is behind these rows."""
        for name in self.columns:
            self._file[name].resize(rows, axis=0)
        self._file.flush()
        self.rows = rows

    def close(self) -> None:
        """Close the file."""
        close(self._file, self.path)


def padded(rows: np.ndarray, column: Column) -> np.ndarray:
    """Rows (n,) or (n, k) as they are stored: zeros in the places that plane strain lacks."""
    if rows.ndim == 2 and column.tail and rows.shape[1] < column.tail[0]:
        wide = np.zeros((len(rows), *column.tail), rows.dtype)
        wide[:, : rows.shape[1]] = rows
        return wide
    return rows.reshape(len(rows), *column.tail)


def obstacle_rows(cells: Cells, columns: dict[str, Column]) -> dict[str, np.ndarray]:
    """Rows of obstacles: their points, ids below zero, and no values."""
    rows = {name: np.full((len(cells.points), *column.tail), np.nan) for name, column in columns.items()}
    return rows | {"Points": cells.points, "PointData/id": -1 - cells.number}


def write_index(path: Path, columns: dict[str, Column], part_rows: np.ndarray) -> None:
    """Join the parts of the result file `path`, whose rows in each output are `part_rows` (outputs, parts)."""
    target = folder_of(path) / INDEX
    partial = target.with_name(f"{INDEX}.partial")
    blocks = _blocks(part_rows)
    with h5py.File(partial, "w", **ACCESS) as file:
        for name, column in columns.items():
            layout = h5py.VirtualLayout((int(part_rows.sum()), *column.tail), column.kind)
            for part, at, source, rows, total, outputs in blocks:
                shape = (source + rows * outputs, *column.tail)
                held = h5py.VirtualSource(f"{part:04d}.h5", name, shape, column.kind)
                layout[h5py.MultiBlockSlice(at, stride=total, count=outputs, block=rows)] = held[source:]
            column.describe(file.create_virtual_dataset(name, layout))
    os.replace(partial, target)


def _blocks(part_rows):
    """(part, first row among all, first row in the part, rows in an output, all rows of an output, outputs).

    Outputs that follow each other with as many rows in each part are one block of each part.
    """
    found = []
    change = np.flatnonzero((np.diff(part_rows, axis=0) != 0).any(axis=1)) + 1
    totals = part_rows.sum(axis=1)
    for first, last in zip([0, *change], [*change, len(part_rows)], strict=True):
        if first == last:
            continue
        rows, total = part_rows[first].tolist(), int(totals[first])
        at, sources = int(totals[:first].sum()), part_rows[:first].sum(axis=0).tolist()
        for part, count in enumerate(rows):
            if count:
                found.append((part, at, sources[part], count, total, last - first))
            at += count
    return found


def faults(path: Path, numbers: Iterable[int], is_whole: Callable[[h5py.File, int], bool]) -> str | None:
    """Which of the parts `numbers` that belong to `path` are missing or damaged, in words; None if none is.

    is_whole: whether an open part, by its number, holds what it should.
    """
    missing, damaged = [], []
    for number in numbers:
        part = part_of(path, number)
        if not part.is_file():
            missing.append(part.name)
            continue
        try:
            with part.open("rb") as handle, h5py.File(handle, "r") as file:
                whole = is_whole(file, number)
        except (OSError, RuntimeError, KeyError):
            whole = False
        if not whole:
            damaged.append(part.name)
    told = [f"{', '.join(names[:5])}{' ...' if len(names) > 5 else ''} {'is' if len(names) == 1 else 'are'} {state}"
            for names, state in ((missing, "missing"), (damaged, "damaged")) if names]  # fmt: skip
    return f"of the parts in {folder_of(path)} {' and '.join(told)}" if told else None


def damage(path: Path, part_rows: np.ndarray, columns: dict[str, Column]) -> str | None:
    """What is wrong with the parts of a result file, by name; None if all are there and hold their rows."""
    rows = part_rows.sum(axis=0)

    def is_whole(file, number):
        return all(len(file[name]) >= rows[number] and file[name].shape[1:] == c.tail for name, c in columns.items())

    return faults(path, range(len(rows)), is_whole)


class Parts:
    """The parts of a result file open for reading. Raises OSError or RuntimeError where one is damaged."""

    def __init__(self, path: Path, part_rows: np.ndarray):
        self.path = path
        self._starts = np.cumsum(np.pad(part_rows, ((1, 0), (0, 0))), axis=0)
        self._begins = np.cumsum(np.pad(part_rows, ((0, 0), (1, 0))), axis=1)
        self._handles: list = []
        self._files: dict[int, h5py.File] = {}

    def read(self, name: str, output: int, begin: int, end: int) -> np.ndarray:
        """Rows `begin` to `end` of an output."""
        edges = self._begins[output].tolist()
        pieces = []
        for part, (first, last) in enumerate(zip(edges, edges[1:], strict=False)):
            low, high = max(begin, first), min(end, last)
            if low < high:
                start = int(self._starts[output, part]) - first
                pieces.append(self._file(part)[name][start + low : start + high])
        return np.concatenate(pieces) if pieces else self._file(0)[name][:0]

    def _file(self, part):
        if part not in self._files:
            handle = part_of(self.path, part).open("rb")
            self._handles.append(handle)
            self._files[part] = h5py.File(handle, "r")
        return self._files[part]

    def close(self) -> None:
        """Close the files."""
        for file in [*self._files.values(), *self._handles]:
            file.close()
