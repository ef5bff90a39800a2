"""Collective writing of results: every rank gives its own points, rank 0 writes them in global-id order."""

import contextlib
import os
from pathlib import Path

import numpy as np

from periporo.errors import OutputError
from periporo.io.output.vtkhdf import ResultFile

__all__ = ["OutputError", "ResultWriter"]

_NO_ID = np.iinfo(np.int64).max


class ResultWriter:
    """Writes the results of one run; every rank of `comm` calls it, rank 0 touches the file.

    path: the file, see io.output.vtkhdf for what is in it. comm: mpi4py communicator. dimension: 2 or 3.
    fields: name -> (columns, unit), with 1 column, 2 or 3 (vector), 4 or 6 (symmetric tensor in the order of
    core.tensors). attributes: name -> text or number, about the run. history_units: name -> unit.
    overwrite: replace an existing file. obstacles: whether outputs hold obstacles, too. resume_step: go on with the
    existing file, dropping all that was recorded after this step. block_rows: most rows that rank 0 gathers at once.
    Raises OutputError, on all ranks alike, when the file cannot be opened or written.
    """

    def __init__(self, path, comm, *, dimension, fields, attributes=None, history_units=None,
                 overwrite=False, resume_step=None, obstacles=False, block_rows=262_144):
        for name, (columns, _) in fields.items():
            if columns not in (1, 2, 3, 4, 6) or name == "id":
                raise ValueError(f"field {name!r} with {columns} columns: 1, 2, 3, 4 or 6 are allowed, "
                                 "and the name 'id' is taken by the global ids")
        self.path = Path(path)
        self.comm = comm
        self.dimension = dimension
        self.fields = dict(fields)
        self.obstacles = obstacles
        self.block_rows = block_rows
        self._file = None
        self._history = []
        self._attributes = dict(attributes or {})
        self._collectively(self._open, overwrite, resume_step, dict(history_units or {}))

    def __enter__(self):
        return self

    def __exit__(self, kind, error, trace):
        if kind is None:
            self.close()
        else:
            self._abandon()  # without the other ranks, which may be elsewhere

    def write(self, time, step, ids, position, fields, cells=None):
        """Append one output; collective.

        time: s. step: number of the time step. ids (n,): global ids of this rank's points in any order,
        unique over all ranks. position (n, dimension) m. fields: name -> (n,) or (n, columns). cells: the obstacles
        (`core.numerics.cells.Cells`), None for none; matters on rank 0 only.
        """
        if set(fields) != set(self.fields):
            raise ValueError(f"{self.path}: fields {sorted(fields)} given, {sorted(self.fields)} declared")
        order = np.argsort(ids)
        ids = np.asarray(ids, dtype=np.int64)[order]
        columns = {"Points": (position, self.dimension)}
        columns |= {f"PointData/{name}": (fields[name], self.fields[name][0]) for name in self.fields}
        columns = {name: (np.reshape(values, (len(ids), width)), width)
                   for name, (values, width) in columns.items()}
        self.flush()
        self._collectively(self._begin_output, sum(self.comm.allgather(len(ids))), cells)
        written = taken = 0
        while (end := self._end_of_block(ids, taken)) is not None:
            block = slice(taken, np.searchsorted(ids, end))
            written += self._write_block(written, ids[block], order[block], columns)
            taken = block.stop
        self._collectively(self._finish_output, float(time), int(step))

    def append_history(self, row):
        """Record the global figures of a step, name -> number with at least `step`; matters on rank 0 only.

        Rows stay in memory until the next `write`, `flush` or `close`. Each row needs the same names.
        """
        if self.comm.rank != 0:
            return
        if "step" not in row or (self._history and row.keys() != self._history[0].keys()):
            raise ValueError(f"history row {sorted(row)}: each row needs the same names, one of them 'step'")
        self._history.append(dict(row))

    def set_attributes(self, attributes):
        """Set attributes of the run, e.g. its wall time; written at the next `write`, `flush` or `close`."""
        self._attributes.update(attributes)

    def rewind(self, step):
        """Drop all that was recorded after this step; collective."""
        self._collectively(self._rewind, step)

    def flush(self):
        """Bring all that is recorded to disk, before a checkpoint for instance; collective."""
        self._collectively(self._flush)

    def close(self):
        """Write what is left and close the file; collective."""
        self._collectively(self._close)

    def _collectively(self, action, *arguments):
        """Do `action` on rank 0; then all ranks return, or raise the same OutputError."""
        failure = None
        if self.comm.rank == 0:
            try:
                action(*arguments)
            except OutputError as error:
                failure = str(error)
            except (OSError, RuntimeError) as error:  # h5py raises the one or the other
                number = getattr(error, "errno", None)
                failure = f"cannot write {self.path}: {os.strerror(number) if number else error}"
            if failure is not None:
                self._abandon()
        failure = self.comm.bcast(failure, root=0)
        if failure is not None:
            raise OutputError(failure)

    def _end_of_block(self, ids, taken):
        """The global id at which the next block of at most `block_rows` rows ends; None at the end."""
        smallest = int(ids[taken]) if taken < len(ids) else _NO_ID
        first = min(self.comm.allgather(smallest))
        return None if first == _NO_ID else first + self.block_rows

    def _write_block(self, offset, ids, order, columns):
        """Gather one block field by field and write it; its number of rows on all ranks."""
        counts = self.comm.allgather(len(ids))
        gathered = self._gather(ids[:, None], counts)
        into = None if gathered is None else np.argsort(gathered[:, 0])
        self._collectively(self._put_ids, offset, gathered, into)
        for name, (values, _) in columns.items():
            gathered = self._gather(values[order].astype(np.float64), counts)
            self._collectively(self._put_rows, name, offset, gathered, into)
        return sum(counts)

    def _gather(self, rows, counts):
        """The rows (n, k) of all ranks on rank 0, None elsewhere."""
        if self.comm.rank != 0:
            self.comm.Gatherv(np.ascontiguousarray(rows), None, root=0)
            return None
        width = rows.shape[1]
        everyone = np.empty((sum(counts), width), dtype=rows.dtype)
        self.comm.Gatherv(np.ascontiguousarray(rows), [everyone, [width * count for count in counts]], root=0)
        return everyone

    # On rank 0 only

    def _open(self, overwrite, resume_step, history_units):
        self._file = ResultFile(self.path, self.dimension, self.fields, history_units=history_units,
                                overwrite=overwrite, resume_step=resume_step, obstacles=self.obstacles)
        self._flush()

    def _begin_output(self, rows, cells):
        self._file.begin_output(rows, cells)

    def _put_ids(self, offset, ids, into):
        ids = ids[into]
        twice = np.flatnonzero(np.diff(ids[:, 0]) == 0)
        if len(twice):
            raise OutputError(f"cannot write {self.path}: the global id {ids[twice[0], 0]} occurs twice")
        self._file.put_rows("PointData/id", offset, ids)

    def _put_rows(self, name, offset, rows, into):
        self._file.put_rows(name, offset, rows[into])

    def _finish_output(self, time, step):
        self._file.finish_output(time, step)

    def _rewind(self, step):
        self._history = [row for row in self._history if row["step"] <= step]
        self._file.rewind(step)

    def _flush(self):
        if self._history:
            self._file.put_history(self._history)
        self._file.put_attributes(self._attributes)
        self._file.flush()
        self._history.clear()
        self._attributes.clear()

    def _close(self):
        if self._file is not None:
            self._flush()
            file, self._file = self._file, None
            file.close()

    def _abandon(self):
        """Close after a failure; another failure on the way out would only hide the first."""
        if self._file is not None:
            file, self._file = self._file, None
            with contextlib.suppress(OSError, RuntimeError):
                file.close()
