"""The result file itself: VTKHDF with time steps, which ParaView opens as it is and h5py reads as arrays.

Layout (VTK file format documentation, VTKHDF 2.0, UnstructuredGrid): the rows of all outputs stand one
after the other; `Steps` holds where each output begins. An output consists of one part, the points, or, in a scene
with obstacles, of two: the points, and the obstacles as cells, whose rows have no values (NaN) and ids below zero.
The number of parts never changes within a file, for VTK 9.5 to 9.7 then lose some. Outputs with as many points and
the same cells as the one before share these. Outside `/VTKHDF`, `/History` holds one row per recorded step of the
global figures and `/Run` the attributes of the run.

The file is whole after every flush, and a killed process leaves a readable one. Data goes out first, then what tells
where it is together with the number of outputs, which comes last: HDF5 writes metadata in the order of addresses, and
the group `Steps` is made after its datasets. Metadata stays in memory until we flush; nothing is compressed, because
a compressed chunk that grows is moved, and its old place reused while the file on disk still points there. Nor does a
full disk harm it: the space of an output is reserved before HDF5 learns of it.
"""

from pathlib import Path

import numpy as np

from periporo.core.numerics.cells import VERTEX, Cells, drawn
from periporo.errors import OutputError
from periporo.io.output.lock import Lock, Locked
from periporo.io.output.parts import damage, obstacle_rows, padded, remove, write_index
from periporo.io.output.vtkhdf_layout import (
    COUNTS,
    HISTORY_ROWS,
    INDEX,
    Index,
    close,
    columns_of,
    create,
    cut,
    folder_of,
    history_column,
    put,
    reopen,
    reserve,
    stored_columns,
)

_BLOCK = 64 * 8192  # rows of the topology made at once


class ResultFile:
    """One result file open for writing, in one process.

    fields: name -> (columns, unit). Vectors (2 or 3 columns) are stored with 3 columns and symmetric tensors
    (4 or 6) with 6, zeros in the places that plane strain lacks. An output is made of `begin_output`,
    `put_rows` for `Points`, `PointData/id` and each `PointData/<field>`, and `finish_output`, which makes it
    count. obstacles: whether outputs have a second part for them. parts: number of files beside it that hold the rows
    of points (`io.output.parts`), by others; None if this file does.
    Raises OutputError, or OSError or RuntimeError from h5py.
    """

    def __init__(self, path, dimension, fields, *, history_units, overwrite, resume_step, obstacles=False,
                 parts=None):
        self.path = Path(path)
        self.dimension = dimension
        self.fields = fields
        self.history_units = history_units
        self.obstacles = obstacles
        self.columns = columns_of(fields)
        folder = self.path.absolute().parent
        if not folder.is_dir():
            raise OutputError(f"cannot write {self.path}: the folder {folder} does not exist")
        if resume_step is None and self.path.exists() and not overwrite:
            raise OutputError(f"{self.path} exists; use --overwrite to replace it, --resume to go on with "
                              "its run, or choose another output file")
        self._lock = _locked(self.path)
        try:
            self._open(resume_step, parts)
        except BaseException:
            self._lock.release()
            raise

    def _open(self, resume_step, parts):
        if resume_step is None:
            remove(self.path)
            self._file = create(self.path, self.dimension, self.fields, self.obstacles, parts)
            if parts is not None:
                folder_of(self.path).mkdir(exist_ok=True)
        else:
            if not self.path.exists():
                raise OutputError(f"cannot resume {self.path}: the file does not exist; put it back, or start anew")
            self._file = reopen(self.path)
            self._check_same_layout(parts)
            cut(self._file, resume_step)
        self._begin_anew()
        if resume_step is not None and self.part_rows is not None:
            problem = damage(self.path, self.part_rows, self.columns)
            if problem is not None:
                raise OutputError(f"cannot resume {self.path}: {problem}; put back what belongs there, or start anew")
        self._join_parts()

    def _begin_anew(self):
        self._file.flush()
        self._index = Index(self._file)

    def _join_parts(self):
        if self.part_rows is not None:
            write_index(self.path, self.columns, self.part_rows)

    @property
    def part_rows(self):
        """Rows of each part in each output (outputs, parts); None if they are in this file."""
        return self._index.part_rows

    @property
    def _grid(self):
        return self._file["VTKHDF"]

    def begin_output(self, rows, cells: Cells | None = None):
        """Reserve the space of an output of `rows` points and the obstacles `cells`, so that a full disk shows before
        it is written."""
        grid, ends = self._grid, self._index.ends
        cells = drawn(cells if self.obstacles else None)
        self._rows, self._cells = rows, cells if self.obstacles else None
        stored = ends["rows"] + rows + len(cells.points)
        added = [(dataset, stored) for dataset in self._index.row_datasets]
        added += [(grid["Types"], ends["Types"] + rows + len(cells.types))]
        added += [(grid["Offsets"], ends["Offsets"] + rows + 1 + len(cells.offsets))]
        added += [(grid["Connectivity"], ends["Connectivity"] + rows + len(cells.connectivity))]
        added += [(grid[name], ends[name] + 2) for name in COUNTS]
        added += [(dataset, self._index.count + 1) for dataset in self._index.datasets]
        reserve(self._file, self.path, added)

    def put_rows(self, name, offset, rows):
        """Write rows (n,) or (n, k) of the present output, `offset` rows behind its beginning."""
        put(self._grid[name], self._index.ends["rows"] + offset, padded(rows, self.columns[name]))

    def finish_output(self, time, step, part_rows=None):
        """Complete the output that was begun, at this time (s) and step, and make it count.

        part_rows (parts,): the rows that each part got, which are on their way to the disk.
        """
        index, steps = self._index, self._index.steps
        start = index.ends["rows"]
        if self._cells is not None and part_rows is None:
            for name, rows in obstacle_rows(self._cells, self.columns).items():
                self.put_rows(name, self._rows, rows)
        entry = self._put_cells(self._rows, self._cells)
        if part_rows is not None:
            entry["PartRows"] = part_rows
            write_index(self.path, self.columns, np.vstack([index.part_rows, part_rows]))
        self._file.flush()
        entry |= {"PointOffsets": start, "StepNumbers": step, "Values": time}
        for name, value in entry.items():
            put(steps[name], index.count, [value])
        for dataset in steps["PointDataOffsets"].values():
            put(dataset, index.count, [start])
        if index.count % steps["Values"].chunks[0] == 0:
            self._file.flush()  # the first entries of a chunk: its place must be known before they count
        steps.attrs.modify("NSteps", index.count + 1)
        self._begin_anew()

    def _put_cells(self, rows, cells):
        """The cells of an output, a vertex for each of its points and the obstacles'; its entries in `Steps`."""
        grid, ends, index = self._grid, self._index.ends, self._index
        if self._has_cells_of_before(rows, cells):
            shared = ("NumberOfParts", "PartOffsets", "CellOffsets", "ConnectivityIdOffsets")
            return {name: int(index.steps[name][index.count - 1]) for name in shared}
        part, cell, connection = ends["NumberOfPoints"], ends["Types"], ends["Connectivity"]
        for name in COUNTS:
            put(grid[name], part, [rows])
        for first in range(0, rows + 1, _BLOCK):
            numbers = np.arange(first, min(first + _BLOCK, rows + 1))
            put(grid["Offsets"], cell + part + first, numbers)
            put(grid["Types"], cell + first, np.full((numbers < rows).sum(), VERTEX, np.uint8))
            put(grid["Connectivity"], connection + first, numbers[numbers < rows])
        if cells is not None:
            for name, count in zip(COUNTS, cells.counts, strict=True):
                put(grid[name], part + 1, [count])
            put(grid["Offsets"], cell + part + rows + 1, cells.offsets)
            put(grid["Types"], cell + rows, cells.types)
            put(grid["Connectivity"], connection + rows, cells.connectivity)
        return {"NumberOfParts": 1 if cells is None else 2, "PartOffsets": part, "CellOffsets": cell,
                "ConnectivityIdOffsets": connection}  # fmt: skip

    def _has_cells_of_before(self, rows, cells):
        """Whether the output before has as many points and the same cells."""
        index, grid = self._index, self._grid
        if index.count == 0:
            return False
        parts = index.parts(index.count - 1)
        counts = [(rows, rows, rows), *([] if cells is None else [cells.counts])]
        if [grid[name][parts].tolist() for name in COUNTS] != [list(column) for column in zip(*counts, strict=True)]:
            return False
        if cells is None:
            return True
        cell = int(index.steps["CellOffsets"][index.count - 1]) + rows
        connection = int(index.steps["ConnectivityIdOffsets"][index.count - 1]) + rows
        held = (grid["Connectivity"][connection : connection + len(cells.connectivity)],
                grid["Offsets"][cell + parts.start + 1 : cell + parts.start + 1 + len(cells.offsets)],
                grid["Types"][cell : cell + len(cells.types)])  # fmt: skip
        return all(map(np.array_equal, held, (cells.connectivity, cells.offsets, cells.types)))

    def rewind(self, step):
        """Drop the outputs and the history after `step`."""
        cut(self._file, step)
        self._begin_anew()
        self._join_parts()

    def put_history(self, rows):
        """Append rows of global figures: a list of dictionaries with the same names."""
        history = self._file["History"]
        if len(history) and set(history) != set(rows[0]):
            raise OutputError(f"cannot write {self.path}: history row {sorted(rows[0])}, but the file holds "
                              f"{sorted(history)}")
        start = min((len(dataset) for dataset in history.values()), default=0)
        reserve(self._file, self.path, [(dataset, start + len(rows)) for dataset in history.values()],
                extra=0 if len(history) else len(rows[0]) * 8 * (len(rows) + HISTORY_ROWS))
        for name in rows[0]:
            if name not in history:
                history_column(history, name, self.history_units.get(name, ""))
            put(history[name], start, [row[name] for row in rows])

    def put_attributes(self, attributes):
        """Set attributes of the run, name -> text or number."""
        reserve(self._file, self.path, [], extra=sum(2 * len(str(value)) for value in attributes.values()))
        for name, value in attributes.items():
            self._file["Run"].attrs[name] = value

    def flush(self):
        """Bring everything to disk."""
        self._file.flush()

    def close(self):
        """Flush, close, give back the space that was reserved and not used, and let others in."""
        try:
            close(self._file, self.path)
        finally:
            self._lock.release()

    def _check_same_layout(self, parts):
        """The file to resume must be one of ours, with the same fields, in as many parts."""
        if "VTKHDF/Steps/StepNumbers" not in self._file:
            raise OutputError(f"cannot resume {self.path}: it is not a result file of periporo")
        held = Index(self._file).part_rows
        if (None if held is None else held.shape[1]) != parts:
            raise OutputError(f"cannot resume {self.path}: it is {_in_parts(held)}, and the scene asks for another "
                              "number of output.parts; put that back, or start anew")  # fmt: skip
        run = self._file["Run"].attrs
        try:
            stored = {name: len(column.components) for name, column in stored_columns(self._grid).items()}
        except KeyError:
            raise OutputError(f"cannot resume {self.path}: {folder_of(self.path) / INDEX} is missing or damaged; "
                              "put it back, or start anew") from None  # fmt: skip
        wanted = {name: len(column.components) for name, column in self.columns.items()}
        if stored != wanted or run["dimension"] != self.dimension:
            raise OutputError(f"cannot resume {self.path}: it holds the fields {_names(stored)} in "
                              f"{run['dimension']} dimensions, this run writes "
                              f"{_names(wanted)} in {self.dimension}; ask for the same output, or start anew")
        self.obstacles = "obstacles" in run  # the number of parts stays; up to 0.1.0 it was one


def _names(columns):
    return sorted(name.removeprefix("PointData/") for name in columns if name not in ("Points", "PointData/id"))


def _in_parts(held):
    return "one file" if held is None else f"in {held.shape[1]} parts"


def _locked(path):
    try:
        return Lock(path)
    except Locked as holder:
        raise OutputError(f"{path} is being written by another run ({holder}); wait for its end, or choose another "
                          "output file") from None
