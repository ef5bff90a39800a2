"""Writing of checkpoints in the background: by rank 0 alone, or by several ranks in parts.

What is in them is said in `io.output.checkpoint`.
"""

import contextlib
import os
import shutil
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
from mpi4py import MPI

from periporo.io.output.delivery import deliver, own_parts
from periporo.io.output.parts import part_of
from periporo.io.output.vtkhdf_layout import folder_of, sync

_BLOCK = 32_768  # ids whose points, or whose rows, rank 0 gathers at once
_CHUNK = 16_384  # rows
_NO_ID = np.iinfo(np.int64).max


class CheckpointWriter:
    """A checkpoint file that is being written; rank 0 holds it, all ranks call."""

    def __init__(self, background, path: Path):
        self.background, self.comm, self.path = background, background.comm, path
        self._partial = path.with_name(path.name + ".partial")
        self._file = None
        self._what = f"cannot write the checkpoint {path}"
        if self.comm.rank == 0:
            background.undo = self._give_up

    def begin(self, attributes) -> None:
        """Make the file, under its temporary name."""
        self._on_rank_0(self._open, attributes)

    def put(self, table: str, keys: np.ndarray, columns: dict[str, np.ndarray]) -> None:
        """Write the rows of all ranks, which are sorted by `keys` (n,); equal keys are all on one rank."""
        comm = self.comm
        total = comm.allreduce(len(keys))
        self._on_rank_0(self._lay_out, table, total, _kinds(columns))
        taken = offset = 0
        while True:
            smallest = min(comm.allgather(int(keys[taken]) if taken < len(keys) else _NO_ID))
            if smallest == _NO_ID:
                return
            end = int(np.searchsorted(keys, smallest + _BLOCK))
            offset += self._put_block(table, offset, keys[taken:end], {n: c[taken:end] for n, c in columns.items()})
            taken = end

    def _put_block(self, table, offset, keys, columns) -> int:
        counts = self.comm.gather(len(keys))
        gathered = self._gather(keys, counts)
        order = None if gathered is None else np.argsort(gathered, kind="stable")
        for name, rows in columns.items():
            gathered = self._gather(rows, counts)
            if gathered is not None:
                self._on_rank_0(self._put_rows, f"{table}/{name}", offset, gathered, order, size=gathered.nbytes)
        return self.comm.bcast(sum(counts) if counts else None)

    def _gather(self, rows, counts):
        """The rows of all ranks on rank 0, None elsewhere; bytes, so that every type keeps its bits."""
        data = np.ascontiguousarray(rows)
        if self.comm.rank != 0:
            self.comm.Gatherv(data.view(np.int64).ravel(), None)
            return None
        everyone = np.empty((sum(counts), *data.shape[1:]), data.dtype)
        width = int(np.prod(data.shape[1:]))
        self.comm.Gatherv(data.view(np.int64).ravel(), [everyone.view(np.int64).ravel(), [width * c for c in counts]])
        return everyone

    def finish(self, then: Callable[[], object]) -> None:
        """Let the file have its name, and do `then`, when all is on the disk."""
        self.background.afterwards(self._what, self._close, then)

    def _on_rank_0(self, action, *arguments, size=0):
        if self.comm.rank == 0:
            self.background.do(self._what, action, *arguments, size=size)

    # On rank 0, in the background

    def _open(self, attributes):
        self._file = h5py.File(self._partial, "w", libver="latest", locking=False)
        self._file.attrs.update(attributes)

    def _lay_out(self, table, total, kinds):
        _lay_out(self._file, table, total, kinds)

    def _put_rows(self, name, offset, rows, order):
        if rows.size:
            self._file[name][offset : offset + len(rows)] = rows[order]

    def _close(self, then):
        self._file.close()
        self._file = None
        sync(self._partial)
        os.replace(self._partial, self.path)
        sync(self.path.absolute().parent)
        self.background.undo = _nothing
        then()

    def _give_up(self):
        with contextlib.suppress(OSError, RuntimeError):  # what went wrong is reported already
            if self._file is not None:
                file, self._file = self._file, None
                file.close()
            self._partial.unlink(missing_ok=True)
            shutil.rmtree(folder_of(self.path), ignore_errors=True)


class PartsWriter(CheckpointWriter):
    """The same with the rows in part files; rank 0 holds the file that joins them."""

    def __init__(self, background, path: Path, parts: int):
        super().__init__(background, path)
        self.parts = parts
        self._part_files: dict[int, h5py.File] = {}
        self._count = 0  # above all ids

    def begin(self, attributes) -> None:
        super().begin(attributes)
        for number in own_parts(self.comm, self.parts):
            self.background.do(self._what, self._open_part, number)

    def put(self, table: str, keys: np.ndarray, columns: dict[str, np.ndarray]) -> None:
        comm = self.comm
        if table == "points":
            self._count = comm.allreduce(int(keys[-1]) + 1 if len(keys) else 0, MPI.MAX)
        delivered, counts = deliver(comm, self.parts, self._count, keys, list(columns.values()))
        kinds = _kinds(columns)
        for number, rows in delivered.items():
            self.background.do(self._what, self._put_part, number, table, rows[:, 1:], kinds, size=rows.nbytes)
        self._on_rank_0(self._join, table, comm.reduce(counts), kinds)

    def finish(self, then: Callable[[], object]) -> None:
        for number in own_parts(self.comm, self.parts):
            self.background.do(self._what, self._close_part, number)
        super().finish(then)

    def _open_part(self, number):
        part = part_of(self.path, number)
        part.parent.mkdir(exist_ok=True)
        self._part_files[number] = h5py.File(part, "w", libver="latest", locking=False)

    def _put_part(self, number, table, rows, kinds):
        file, start = self._part_files[number], 0
        _lay_out(file, table, len(rows), kinds)
        for name, (dtype, tail) in kinds.items():
            width = int(np.prod(tail))
            if len(rows) and width:
                column = np.ascontiguousarray(rows[:, start : start + width]).view(dtype)
                file[f"{table}/{name}"][...] = column.reshape(len(rows), *tail)
            start += width

    def _join(self, table, counts, kinds):
        for name, (dtype, tail) in kinds.items():
            layout = h5py.VirtualLayout((int(counts.sum()), *tail), dtype)
            ends = np.cumsum(counts).tolist()
            for number, (end, rows) in enumerate(zip(ends, counts.tolist(), strict=True)):
                if rows and np.prod(tail):
                    source = str(part_of(self.path, number).relative_to(self.path.parent))
                    layout[end - rows : end] = h5py.VirtualSource(source, f"{table}/{name}", (rows, *tail), dtype)
            self._file.create_virtual_dataset(f"{table}/{name}", layout)
        self._file[table].attrs["parts"] = counts

    def _close_part(self, number):
        self._part_files.pop(number).close()
        sync(part_of(self.path, number))
        sync(folder_of(self.path))


def _kinds(columns):
    return {name: (rows.dtype, rows.shape[1:]) for name, rows in columns.items()}


def _lay_out(file, table, total, kinds):
    for name, (dtype, tail) in kinds.items():
        shape = (total, *tail)
        # the checksums tell on reading whether the file was damaged
        layout = {"chunks": (min(_CHUNK, total), *tail), "fletcher32": True} if np.prod(shape) else {}
        file.create_dataset(f"{table}/{name}", shape, dtype, **layout)


def _nothing():
    pass
