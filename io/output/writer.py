"""Collective writing of results: every rank gives its own points, which are written in the order of their ids."""

import contextlib
from pathlib import Path

import numpy as np
from mpi4py import MPI

from periporo.core.numerics.cells import drawn
from periporo.errors import OutputError
from periporo.io.output.background import Background
from periporo.io.output.delivery import deliver, own_parts
from periporo.io.output.parts import Part
from periporo.io.output.vtkhdf import ResultFile
from periporo.io.output.vtkhdf_layout import STORED_COMPONENTS, columns_of, sync

_NO_ID = np.iinfo(np.int64).max


class ResultWriter:
    """Writes the results of one run while its next steps go on; every rank of `comm` calls it.

    path: the file, see io.output.vtkhdf for what is in it. comm: mpi4py communicator. dimension: 2 or 3.
    fields: name -> (columns, unit), with 1 column, 2 or 3 (vector), 4 or 6 (symmetric tensor in the order of
    core.tensors) or 9 (matrix, row by row). attributes: name -> text or number, about the run. history_units: name ->
    unit. overwrite: replace an existing file. obstacles: whether outputs hold obstacles, too. parts: number of files,
    each with a range of ids, that points are written to by several ranks (io.output.parts); None: rank 0 writes one.
    resume_step: go on with the existing file, dropping all that was recorded after this step. block_rows: most rows
    that rank 0 gathers at once.

    What is given to `write` is on its way to the disk, by `background`, and is there after `flush`. All methods raise
    OutputError, on all ranks alike, when something could not be written.
    """

    def __init__(self, path, comm, *, dimension, fields, attributes=None, history_units=None,
                 overwrite=False, resume_step=None, obstacles=False, parts=None, block_rows=262_144):
        for name, (columns, _) in fields.items():
            if columns not in STORED_COMPONENTS or name == "id":
                raise ValueError(f"field {name!r} with {columns} columns: 1, 2, 3, 4, 6 or 9 are allowed, "
                                 "and the name 'id' is taken by the global ids")
        self.path = Path(path)
        self.comm = comm
        self.background = Background(comm)
        self.dimension = dimension
        self.fields = dict(fields)
        self.obstacles = obstacles
        self.parts = parts
        self.block_rows = block_rows
        self._columns = columns_of(fields)
        self._file = None
        self._open_parts: dict[int, Part] = {}  # of this rank
        self._history = []
        self._attributes = dict(attributes or {})
        self._what = f"cannot write {self.path}"
        try:
            self._on_rank_0(self._open, overwrite, resume_step, dict(history_units or {}))
            self.background.settle()
            self._open_own_parts(resume_step)
            self.background.settle()
        except OutputError:
            self._abandon()
            raise

    def __enter__(self):
        return self

    def __exit__(self, kind, error, trace):
        if kind is None:
            self.close()
        else:
            self._abandon()  # without the other ranks, which may be elsewhere

    def write(self, time, step, ids, position, fields, cells=None):
        """Append one output; collective. It is written while the caller goes on.

        time: s. step: number of the time step. ids (n,): global ids of this rank's points in any order,
        unique over all ranks. position (n, dimension) m. fields: name -> (n,) or (n, columns). cells: the obstacles
        (`core.numerics.cells.Cells`), None for none; the same on all ranks.
        """
        if set(fields) != set(self.fields):
            raise ValueError(f"{self.path}: fields {sorted(fields)} given, {sorted(self.fields)} declared")
        ids = np.asarray(ids, dtype=np.int64)
        order = np.argsort(ids) if (np.diff(ids) < 0).any() else slice(None)  # as most have them
        ids = ids[order]
        columns = {"Points": (position, self.dimension)}
        columns |= {f"PointData/{name}": (fields[name], self.fields[name][0]) for name in self.fields}
        columns = {name: (np.reshape(values, (len(ids), width)), width)
                   for name, (values, width) in columns.items()}
        self.background.settle()
        self._record()
        self._on_rank_0(self._begin_output, self.comm.allreduce(len(ids)), cells)
        if self.parts is not None:
            self._write_parts(float(time), int(step), ids, order, columns, cells)
            return
        written = taken = 0
        while (end := self._end_of_block(ids, taken)) is not None:
            block = slice(taken, np.searchsorted(ids, end))
            rows = block if isinstance(order, slice) else order[block]
            written += self._write_block(written, ids[block], rows, columns)
            taken = block.stop
        self._on_rank_0(self._finish_output, float(time), int(step))

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
        self.background.settle()
        self._history = [row for row in self._history if row["step"] <= step]
        self._on_rank_0(self._rewind, step)
        self.background.settle()
        rows = self._rows_of_parts()
        for number, part in self._open_parts.items():
            self.background.do(self._what, part.cut, rows[number])
        self.background.settle()

    def flush(self):
        """Wait until all that is recorded is written; collective."""
        self._record()
        self.background.settle()

    def _record(self):
        """Have histories and attributes written."""
        history, self._history = self._history, []
        attributes, self._attributes = self._attributes, {}
        self._on_rank_0(self._flush, history, attributes)

    def sync(self):
        """Have all that is recorded brought to the disk, before a checkpoint for instance; collective."""
        self.background.settle()  # what waits for all ranks comes first
        self._record()
        self._on_rank_0(sync, self.path)
        for part in self._open_parts.values():
            self.background.do(self._what, part.sync)

    def close(self):
        """Write what is left and close the file; collective."""
        self.flush()
        self._abandon()

    def _on_rank_0(self, action, *arguments, size=0):
        """Have `action` done on rank 0."""
        if self.comm.rank == 0:
            self.background.do(self._what, action, *arguments, size=size)

    # In parts

    def _open_own_parts(self, resume_step):
        """Open the parts that this rank writes."""
        parts = self.parts or 0
        rows = [None] * parts if resume_step is None else self._rows_of_parts()
        for number in own_parts(self.comm, parts):
            self.background.do(self._what, self._open_part, number, rows[number])

    def _open_part(self, number, rows):
        self._open_parts[number] = Part(self.path, number, self._columns, rows)

    def _rows_of_parts(self):
        """Rows that each part should have; collective."""
        held = None if self._file is None or self.parts is None else self._file.part_rows.sum(axis=0).tolist()
        return self.comm.bcast(held)

    def _write_parts(self, time, step, ids, order, columns, cells):
        count = self.comm.allreduce(int(ids[-1]) + 1 if len(ids) else 0, MPI.MAX)
        values = (np.ascontiguousarray(values[order], np.float64) for values, _ in columns.values())
        delivered, rows = deliver(self.comm, self.parts, count, ids, list(values))
        for number, part in self._open_parts.items():
            packed, start = delivered[number], 1
            held = {"PointData/id": np.ascontiguousarray(packed[:, 0]).view(np.int64)}
            for name, (_, width) in columns.items():
                held[name] = packed[:, start : start + width]
                start += width
            obstacles = drawn(cells) if self.obstacles and number == self.parts - 1 else None
            rows[number] += 0 if obstacles is None else len(obstacles.points)
            self.background.do(self._what, part.append, held, obstacles, size=packed.nbytes)
        rows = self.comm.reduce(rows)
        self.background.afterwards(self._what, self._finish_output, time, step, rows)

    # In one file

    def _end_of_block(self, ids, taken):
        """The global id at which the next block of at most `block_rows` rows ends; None at the end."""
        smallest = int(ids[taken]) if taken < len(ids) else _NO_ID
        first = min(self.comm.allgather(smallest))
        return None if first == _NO_ID else first + self.block_rows

    def _write_block(self, offset, ids, rows, columns):
        """Gather one block field by field and have it written; its number of rows on all ranks."""
        counts = self.comm.allgather(len(ids))
        gathered = self._gather(ids[:, None], counts)
        into = None if gathered is None else np.argsort(gathered[:, 0], kind="stable")  # quick where they are sorted
        if into is not None:
            self._on_rank_0(self._put_ids, offset, gathered[into], size=gathered.nbytes)
        for name, (values, _) in columns.items():
            gathered = self._gather(np.array(values[rows], np.float64), counts)
            if into is not None:
                self._on_rank_0(self._put_rows, name, offset, gathered, into, size=gathered.nbytes)
        return sum(counts)

    def _gather(self, rows, counts):
        """The rows (n, k) of all ranks on rank 0, None elsewhere."""
        if self.comm.size == 1:
            return rows
        if self.comm.rank != 0:
            self.comm.Gatherv(np.ascontiguousarray(rows), None, root=0)
            return None
        width = rows.shape[1]
        everyone = np.empty((sum(counts), width), dtype=rows.dtype)
        self.comm.Gatherv(np.ascontiguousarray(rows), [everyone, [width * count for count in counts]], root=0)
        return everyone

    # On rank 0, in the background

    def _open(self, overwrite, resume_step, history_units):
        self._file = ResultFile(self.path, self.dimension, self.fields, history_units=history_units,
                                overwrite=overwrite, resume_step=resume_step, obstacles=self.obstacles,
                                parts=self.parts)
        attributes, self._attributes = self._attributes, {}
        self._flush([], attributes)

    def _begin_output(self, rows, cells):
        self._file.begin_output(rows, cells)

    def _put_ids(self, offset, ids):
        twice = np.flatnonzero(np.diff(ids[:, 0]) == 0)
        if len(twice):
            raise OutputError(f"cannot write {self.path}: the global id {ids[twice[0], 0]} occurs twice")
        self._file.put_rows("PointData/id", offset, ids)

    def _put_rows(self, name, offset, rows, into):
        self._file.put_rows(name, offset, rows if self.comm.size == 1 else rows[into])

    def _finish_output(self, time, step, part_rows=None):
        self._file.finish_output(time, step, part_rows)

    def _rewind(self, step):
        self._file.rewind(step)

    def _flush(self, history, attributes):
        if history:
            self._file.put_history(history)
        self._file.put_attributes(attributes)
        self._file.flush()

    def _abandon(self):
        """Close; after a failure another one on the way out would only hide the first."""
        self.background.close()
        file, self._file = self._file, None
        for held in [*self._open_parts.values(), *([] if file is None else [file])]:
            with contextlib.suppress(OSError, RuntimeError):
                held.close()
        self._open_parts = {}
