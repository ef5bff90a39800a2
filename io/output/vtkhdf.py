"""The result file itself: VTKHDF with time steps, which ParaView opens as it is and h5py reads as arrays.

Layout (VTK file format documentation, VTKHDF 2.0, UnstructuredGrid): the rows of all outputs stand one
after the other; `Steps` holds where each output begins. An output consists of one part, the points, or, in a scene
with obstacles, of two: the points, and the obstacles as cells, whose rows have no values (NaN) and ids below zero.
The number of parts never changes within a file, for VTK 9.5 to 9.7 then lose some. Outputs with as many points and
the same obstacles share their connectivity. Outside `/VTKHDF`, `/History` holds one row per recorded step of the
global figures and `/Run` the attributes of the run.

The file is whole after every flush, and a killed process leaves a readable one. Data goes out first, then what tells
where it is together with the number of outputs, which comes last: HDF5 writes metadata in the order of addresses, and
the group `Steps` is made after its datasets. Metadata stays in memory until we flush; nothing is compressed, because
a compressed chunk that grows is moved, and its old place reused while the file on disk still points there. Nor does a
full disk harm it: the space of an output is reserved before HDF5 learns of it.
"""

import errno
import math
import os
import shutil
from pathlib import Path

import numpy as np

from periporo.core.numerics.cells import VERTEX, Cells, joined
from periporo.errors import OutputError
from periporo.io.output.lock import Lock, Locked
from periporo.io.output.vtkhdf_layout import (
    COUNTS,
    HISTORY_ROWS,
    STORED_COMPONENTS,
    Index,
    create,
    cut,
    history_column,
    put,
    reopen,
)

_BLOCK = 64 * 8192  # rows of the topology made at once
_METADATA_BYTES = 16_384  # most that a growing dataset adds to its description and chunk index at once


class ResultFile:
    """One result file open for writing, in one process.

    fields: name -> (columns, unit). Vectors (2 or 3 columns) are stored with 3 columns and symmetric tensors
    (4 or 6) with 6, zeros in the places that plane strain lacks. An output is made of `begin_output`,
    `put_rows` for `Points`, `PointData/id` and each `PointData/<field>`, and `finish_output`, which makes it
    count. obstacles: whether outputs have a second part for them.
    Raises OutputError, or OSError or RuntimeError from h5py.
    """

    def __init__(self, path, dimension, fields, *, history_units, overwrite, resume_step, obstacles=False):
        self.path = Path(path)
        self.dimension = dimension
        self.fields = fields
        self.history_units = history_units
        self.obstacles = obstacles
        folder = self.path.absolute().parent
        if not folder.is_dir():
            raise OutputError(f"cannot write {self.path}: the folder {folder} does not exist")
        if resume_step is None and self.path.exists() and not overwrite:
            raise OutputError(f"{self.path} exists; use --overwrite to replace it, --resume to go on with "
                              "its run, or choose another output file")
        self._lock = _locked(self.path)
        try:
            self._open(resume_step)
        except BaseException:
            self._lock.release()
            raise

    def _open(self, resume_step):
        if resume_step is None:
            self._file = create(self.path, self.dimension, self.fields, self.obstacles)
        else:
            if not self.path.exists():
                raise OutputError(f"cannot resume {self.path}: the file does not exist; put it back, or start anew")
            self._file = reopen(self.path)
            self._check_same_layout()
            cut(self._file, resume_step)
        self._begin_anew()

    def _begin_anew(self):
        self._file.flush()
        self._index = Index(self._file)

    @property
    def _grid(self):
        return self._file["VTKHDF"]

    def begin_output(self, rows, cells: Cells | None = None):
        """Reserve the space of an output of `rows` points and the obstacles `cells`, so that a full disk shows before
        it is written."""
        grid, ends = self._grid, self._index.ends
        drawn = joined({}) if cells is None or not self.obstacles else cells
        self._rows, self._cells = rows, drawn if self.obstacles else None
        stored = ends["rows"] + rows + len(drawn.points)
        added = [(dataset, stored) for dataset in (grid["Points"], *grid["PointData"].values())]
        added += [(grid["Types"], ends["Types"] + rows + len(drawn.types))]
        added += [(grid["Offsets"], ends["Offsets"] + rows + 1 + len(drawn.offsets))]
        added += [(grid["Connectivity"], ends["Connectivity"] + rows + len(drawn.connectivity))]
        added += [(grid[name], ends[name] + 2) for name in COUNTS]
        added += [(dataset, self._index.count + 1) for dataset in self._index.datasets]
        self._reserve(added)

    def put_rows(self, name, offset, rows):
        """Write rows (n,) or (n, k) of the present output, `offset` rows behind its beginning."""
        dataset = self._grid[name]
        if dataset.ndim == 2 and dataset.shape[1] > rows.shape[1]:
            rows = np.pad(rows, ((0, 0), (0, dataset.shape[1] - rows.shape[1])))
        put(dataset, self._index.ends["rows"] + offset, rows.reshape(len(rows), *dataset.shape[1:]))

    def finish_output(self, time, step):
        """Complete the output that was begun, at this time (s) and step, and make it count."""
        index, steps = self._index, self._index.steps
        start = index.ends["rows"]
        if self._cells is not None:
            self._put_obstacles(self._rows, self._cells)
        entry = self._put_cells(self._rows, self._cells)
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

    def _put_obstacles(self, rows, cells):
        """The rows of the second part."""
        self.put_rows("Points", rows, cells.points)
        self.put_rows("PointData/id", rows, -1 - cells.number)
        for name in self.fields:
            dataset = self._grid["PointData"][name]
            self.put_rows(f"PointData/{name}", rows, np.full((len(cells.points), *dataset.shape[1:]), np.nan))

    def _put_cells(self, rows, cells):
        """The cells of an output, a vertex for each of its points and the obstacles'; its entries in `Steps`."""
        grid, ends = self._grid, self._index.ends
        part, cell, connection = ends["NumberOfPoints"], ends["Types"], self._shared_connectivity(rows, cells)
        shared = connection is not None
        connection = connection if shared else ends["Connectivity"]
        for name in COUNTS:
            put(grid[name], part, [rows])
        for first in range(0, rows + 1, _BLOCK):
            numbers = np.arange(first, min(first + _BLOCK, rows + 1))
            put(grid["Offsets"], cell + part + first, numbers)
            put(grid["Types"], cell + first, np.full((numbers < rows).sum(), VERTEX, np.uint8))
            if not shared:
                put(grid["Connectivity"], connection + first, numbers[numbers < rows])
        if cells is not None:
            for name, count in zip(COUNTS, cells.counts, strict=True):
                put(grid[name], part + 1, [count])
            put(grid["Offsets"], cell + part + rows + 1, cells.offsets)
            put(grid["Types"], cell + rows, cells.types)
            if not shared:
                put(grid["Connectivity"], connection + rows, cells.connectivity)
        return {"NumberOfParts": 1 if cells is None else 2, "PartOffsets": part, "CellOffsets": cell,
                "ConnectivityIdOffsets": connection}  # fmt: skip

    def _shared_connectivity(self, rows, cells):
        """Where the connectivity of the output before stands, if this one has the same; else None."""
        index, grid = self._index, self._grid
        if index.count == 0:
            return None
        parts, start = index.parts(index.count - 1), int(index.steps["ConnectivityIdOffsets"][index.count - 1])
        wanted = [rows] if cells is None else [rows, len(cells.connectivity)]
        if grid["NumberOfConnectivityIds"][parts].tolist() != wanted:
            return None
        stored = grid["Connectivity"][start + rows : start + sum(wanted)]
        return start if cells is None or np.array_equal(stored, cells.connectivity) else None

    def rewind(self, step):
        """Drop the outputs and the history after `step`."""
        cut(self._file, step)
        self._begin_anew()

    def put_history(self, rows):
        """Append rows of global figures: a list of dictionaries with the same names."""
        history = self._file["History"]
        if len(history) and set(history) != set(rows[0]):
            raise OutputError(f"cannot write {self.path}: history row {sorted(rows[0])}, but the file holds "
                              f"{sorted(history)}")
        start = min((len(dataset) for dataset in history.values()), default=0)
        self._reserve([(dataset, start + len(rows)) for dataset in history.values()],
                      extra=0 if len(history) else len(rows[0]) * 8 * (len(rows) + HISTORY_ROWS))
        for name in rows[0]:
            if name not in history:
                history_column(history, name, self.history_units.get(name, ""))
            put(history[name], start, [row[name] for row in rows])

    def put_attributes(self, attributes):
        """Set attributes of the run, name -> text or number."""
        self._reserve([], extra=sum(2 * len(str(value)) for value in attributes.values()))
        for name, value in attributes.items():
            self._file["Run"].attrs[name] = value

    def flush(self):
        """Bring everything to disk."""
        self._file.flush()

    def close(self):
        """Flush, close, give back the space that was reserved and not used, and let others in."""
        try:
            self._file.flush()
            size = self._file.id.get_filesize()
            self._file.close()
            if os.path.getsize(self.path) > size:
                os.truncate(self.path, size)
        finally:
            self._lock.release()

    def _reserve(self, added, extra=0):
        """Reserve disk space for the datasets of `added` to grow to the given rows, and `extra` bytes."""
        size = extra + _METADATA_BYTES * (1 + len(added))
        for dataset, rows in added:
            chunks = math.ceil(rows / dataset.chunks[0]) - math.ceil(len(dataset) / dataset.chunks[0])
            size += max(chunks, 0) * dataset.dtype.itemsize * int(np.prod(dataset.chunks))
        end = self._file.id.get_filesize()  # as HDF5 sees it; what was reserved before and not used is behind
        if not hasattr(os, "posix_fallocate"):
            if shutil.disk_usage(self.path.absolute().parent).free < size:
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            return
        with open(self.path, "rb+") as file:
            os.posix_fallocate(file.fileno(), end, size)

    def _check_same_layout(self):
        """The file to resume must be one of ours, with the same fields."""
        if "VTKHDF/Steps/StepNumbers" not in self._file:
            raise OutputError(f"cannot resume {self.path}: it is not a result file of periporo")
        run = self._file["Run"].attrs
        stored = {name: len(dataset.attrs.get("components", ())) for name, dataset in
                  self._grid["PointData"].items() if name != "id"}
        wanted = {name: len(STORED_COMPONENTS[columns]) for name, (columns, _) in self.fields.items()}
        if stored != wanted or run["dimension"] != self.dimension:
            raise OutputError(f"cannot resume {self.path}: it holds the fields {sorted(stored)} in "
                              f"{run['dimension']} dimensions, this run writes "
                              f"{sorted(wanted)} in {self.dimension}; ask for the same output, or start anew")
        self.obstacles = "obstacles" in run  # the number of parts stays; up to 0.1.0 it was one


def _locked(path):
    try:
        return Lock(path)
    except Locked as holder:
        raise OutputError(f"{path} is being written by another run ({holder}); wait for its end, or choose another "
                          "output file") from None


