"""The result file itself: VTKHDF with time steps, which ParaView opens as it is and h5py reads as arrays.

Layout (VTK file format documentation, VTKHDF 2.0, UnstructuredGrid): the rows of all outputs stand one
after the other; `Steps` holds where each output begins. Outside `/VTKHDF`, `/History` holds one row per
recorded step of the global figures and `/Run` the attributes of the run.

A killed process leaves a readable file. Data goes out first, the number of outputs (`NSteps`) last; HDF5
keeps its metadata in memory until we flush; nothing is compressed, because a compressed chunk that grows is
moved, and its old place reused while the file on disk still points there. Nor does a full disk harm it: the
space of an output is reserved before HDF5 learns of it.
"""

import errno
import math
import os
import shutil
from pathlib import Path

import h5py
import numpy as np

from periporo.core.numerics.tensors import COMPONENTS
from periporo.io.output.lock import Lock, Locked

_CHUNK_ROWS = 8192
_BLOCK = 64 * _CHUNK_ROWS  # rows of the topology made at once
_INDEX_ROWS = 512  # chunk of the datasets with one row per output
_HISTORY_ROWS = 4096
_METADATA_BYTES = 16_384  # most that a growing dataset adds to its description and chunk index at once
_VERTEX = 1  # VTK's cell type
_AXES = ("x", "y", "z")
_STORED_COMPONENTS = {1: (), 2: _AXES, 3: _AXES, 4: COMPONENTS, 6: COMPONENTS}
_COUNTS = ("NumberOfPoints", "NumberOfCells", "NumberOfConnectivityIds")

# The oldest file format: newer ones mark a file as being written, and a killed process leaves that mark.
# No lock, so that ParaView and open_results can look at a run while it goes on.
_ACCESS = {"libver": "earliest", "locking": False}


class OutputError(Exception):
    """A result file cannot be opened or written; raised on all ranks alike."""


class ResultFile:
    """One result file open for writing, in one process.

    fields: name -> (columns, unit). Vectors (2 or 3 columns) are stored with 3 columns and symmetric tensors
    (4 or 6) with 6, zeros in the places that plane strain lacks. An output is made of `begin_output`,
    `put_rows` for `Points`, `PointData/id` and each `PointData/<field>`, and `finish_output`, which makes it
    count.
    Raises OutputError, or OSError or RuntimeError from h5py.
    """

    def __init__(self, path, dimension, fields, *, history_units, overwrite, resume_step):
        self.path = Path(path)
        self.dimension = dimension
        self.fields = fields
        self.history_units = history_units
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
        if resume_step is not None:
            self._file = _reopen(self.path)
            self._check_same_layout()
            self._truncate(resume_step)
        else:
            self._file = _create(self.path)
            self._lay_out()
        self._count_outputs()
        self._file.flush()

    def _count_outputs(self):
        self._count = int(self._steps.attrs["NSteps"])
        self._start = int(self._grid["NumberOfPoints"][: self._count].sum())

    @property
    def _grid(self):
        return self._file["VTKHDF"]

    @property
    def _steps(self):
        return self._file["VTKHDF/Steps"]

    def begin_output(self, rows):
        """Reserve the space of an output of `rows` points, so that a full disk shows before it is written."""
        grid, steps = self._grid, self._steps
        added = [(grid[name], self._start + rows) for name in ("Points", "Types")]
        added += [(dataset, self._start + rows) for dataset in grid["PointData"].values()]
        added += [(grid["Offsets"], self._start + self._count + rows + 1), (grid["Connectivity"], rows)]
        added += [(grid[name], self._count + 1) for name in _COUNTS]
        added += [(dataset, self._count + 1) for dataset in _datasets(steps)]
        self._reserve(added)

    def put_rows(self, name, offset, rows):
        """Write rows (n,) or (n, k) of the present output, `offset` rows behind its beginning."""
        dataset = self._grid[name]
        if dataset.ndim == 2 and dataset.shape[1] > rows.shape[1]:
            rows = np.pad(rows, ((0, 0), (0, dataset.shape[1] - rows.shape[1])))
        _put(dataset, self._start + offset, rows.reshape(len(rows), *dataset.shape[1:]))

    def finish_output(self, time, step, rows):
        """Complete the output of `rows` points at this time (s) and step, and make it count."""
        grid, steps = self._grid, self._steps
        # All outputs share one Connectivity: vertex cell k refers to point k.
        for first in range(len(grid["Connectivity"]), rows, _BLOCK):
            _put(grid["Connectivity"], first, np.arange(first, min(first + _BLOCK, rows)))
        for first in range(0, rows + 1, _BLOCK):
            offsets = np.arange(first, min(first + _BLOCK, rows + 1))
            _put(grid["Offsets"], self._start + self._count + first, offsets)
        for first in range(0, rows, _BLOCK):
            types = np.full(min(_BLOCK, rows - first), _VERTEX, dtype=np.uint8)
            _put(grid["Types"], self._start + first, types)
        for name in _COUNTS:
            _put(grid[name], self._count, [rows])
        entry = {"NumberOfParts": 1, "PartOffsets": self._count, "PointOffsets": self._start,
                 "CellOffsets": self._start, "ConnectivityIdOffsets": 0, "StepNumbers": step, "Values": time}
        for name, value in entry.items():
            _put(steps[name], self._count, [value])
        for dataset in steps["PointDataOffsets"].values():
            _put(dataset, self._count, [self._start])
        self._file.flush()
        steps.attrs.modify("NSteps", self._count + 1)
        self._file.flush()
        self._count += 1
        self._start += rows

    def rewind(self, step):
        """Drop the outputs and the history after `step`."""
        self._truncate(step)
        self._count_outputs()
        self._file.flush()

    def put_history(self, rows):
        """Append rows of global figures: a list of dictionaries with the same names."""
        history = self._file["History"]
        if len(history) and set(history) != set(rows[0]):
            raise OutputError(f"cannot write {self.path}: history row {sorted(rows[0])}, but the file holds "
                              f"{sorted(history)}")
        start = min((len(dataset) for dataset in history.values()), default=0)
        self._reserve([(dataset, start + len(rows)) for dataset in history.values()],
                      extra=0 if len(history) else len(rows[0]) * 8 * (len(rows) + _HISTORY_ROWS))
        for name in rows[0]:
            if name not in history:
                kind = "i8" if name == "step" else "f8"
                _growing(history, name, kind, rows=_HISTORY_ROWS, unit=self.history_units.get(name, ""))
            _put(history[name], start, [row[name] for row in rows])

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

    def _lay_out(self):
        grid = self._file.create_group("VTKHDF")
        grid.attrs.create("Version", (2, 0), dtype="i8")
        grid.attrs.create("Type", b"UnstructuredGrid", dtype=h5py.string_dtype("ascii", 16))
        steps = grid.create_group("Steps")
        steps.attrs.create("NSteps", 0, dtype="i8")
        for name in _COUNTS:
            _growing(grid, name, "i8", rows=_INDEX_ROWS)
        _growing(grid, "Connectivity", "i8")
        _growing(grid, "Offsets", "i8")
        _growing(grid, "Types", "u1")
        _growing(grid, "Points", "f8", unit="m", components=_AXES)
        for name in ("NumberOfParts", "PartOffsets", "PointOffsets", "CellOffsets", "ConnectivityIdOffsets",
                     "StepNumbers"):
            _growing(steps, name, "i8", rows=_INDEX_ROWS)
        _growing(steps, "Values", "f8", rows=_INDEX_ROWS, unit="s")
        data, offsets = grid.create_group("PointData"), steps.create_group("PointDataOffsets")
        _growing(data, "id", "i8")
        for name, (columns, unit) in self.fields.items():
            _growing(data, name, "f8", unit=unit, components=_STORED_COMPONENTS[columns])
        for name in data:
            _growing(offsets, name, "i8", rows=_INDEX_ROWS)
        self._file.create_group("History")
        self._file.create_group("Run").attrs["dimension"] = self.dimension

    def _check_same_layout(self):
        """The file to resume must be one of ours, with the same fields."""
        if "VTKHDF/Steps/StepNumbers" not in self._file:
            raise OutputError(f"cannot resume {self.path}: it is not a result file of periporo")
        stored = {name: len(dataset.attrs.get("components", ())) for name, dataset in
                  self._grid["PointData"].items() if name != "id"}
        wanted = {name: len(_STORED_COMPONENTS[columns]) for name, (columns, _) in self.fields.items()}
        if stored != wanted or self._file["Run"].attrs["dimension"] != self.dimension:
            raise OutputError(f"cannot resume {self.path}: it holds the fields {sorted(stored)} in "
                              f"{self._file['Run'].attrs['dimension']} dimensions, this run writes "
                              f"{sorted(wanted)} in {self.dimension}; ask for the same output, or start anew")

    def _truncate(self, step):
        """Drop the outputs and the history after `step`."""
        grid, steps, history = self._grid, self._steps, self._file["History"]
        numbers = steps["StepNumbers"][: steps.attrs["NSteps"]]
        keep = int(np.searchsorted(numbers, step, side="right"))
        rows = int(grid["NumberOfPoints"][:keep].sum())
        steps.attrs.modify("NSteps", keep)
        self._file.flush()  # the count first: what is about to go must not count
        for dataset in (*_datasets(steps), *(grid[name] for name in _COUNTS)):
            dataset.resize(keep, axis=0)
        for dataset in (grid["Points"], grid["Types"], *grid["PointData"].values()):
            dataset.resize(rows, axis=0)
        grid["Offsets"].resize(rows + keep, axis=0)
        if "step" in history:
            whole = min(len(dataset) for dataset in history.values())
            kept = int(np.searchsorted(history["step"][:whole], step, side="right"))
            for dataset in history.values():
                dataset.resize(kept, axis=0)


def _locked(path):
    try:
        return Lock(path)
    except Locked as holder:
        raise OutputError(f"{path} is being written by another run ({holder}); wait for its end, or choose another "
                          "output file") from None


def _create(path):
    """A new file; what it holds depends on nothing but what is written (no times)."""
    path.unlink(missing_ok=True)  # whoever reads the old file keeps it
    return _hold_metadata(h5py.File(path, "x", **_ACCESS))


def _reopen(path):
    if not path.exists():
        raise OutputError(f"cannot resume {path}: the file does not exist; put it back, or start anew")
    return _hold_metadata(h5py.File(path, "r+", **_ACCESS))


def _hold_metadata(file):
    """Let metadata reach the disk at a flush only, so that the file is whole at any other time."""
    config = file.id.get_mdc_config()
    config.evictions_enabled = False
    config.incr_mode = config.flash_incr_mode = config.decr_mode = 0
    file.id.set_mdc_config(config)
    return file


def _datasets(steps):
    """The datasets with one entry per output in the group `Steps`."""
    own = [item for item in steps.values() if isinstance(item, h5py.Dataset)]
    return own + list(steps["PointDataOffsets"].values())


def _growing(group, name, kind, *, rows=_CHUNK_ROWS, unit="", components=()):
    """An empty dataset that grows by rows."""
    tail = (len(components),) if components else ()
    dataset = group.create_dataset(name, (0, *tail), kind, maxshape=(None, *tail), chunks=(rows, *tail))
    if unit:
        dataset.attrs["unit"] = unit
    if components:
        dataset.attrs["components"] = list(components)


def _put(dataset, start, rows):
    """Write rows from row `start` on; the dataset grows to hold them."""
    if len(dataset) < start + len(rows):
        dataset.resize(start + len(rows), axis=0)
    dataset[start : start + len(rows)] = rows
