"""Checkpoints: the state of a run in one HDF5 file, the same for any number of ranks.

`/points/<field>` holds a row per point in the order of ids, `/rows_<k>/` ids, stress and state of the active rows of
material k in the order of their ids; the attribute `memory` is what the parts of the program remember (JSON, whose
numbers keep every bit), `configuration` the scene. A file has a temporary name until it is whole and on the disk.
Rank 0 writes what it gathers block by block; every rank reads its own part.
"""

import contextlib
import json
import os
from pathlib import Path

import h5py
import numpy as np

from periporo.core.numerics.jit import program_fingerprint
from periporo.errors import OutputError

PROGRAM = program_fingerprint()
"""What wrote a checkpoint: version of the sources and kind of processor, on which bits may depend."""

_BLOCK = 32_768  # ids whose points, or whose rows, rank 0 gathers at once
_CHUNK = 16_384  # rows
_NO_ID = np.iinfo(np.int64).max


class CheckpointError(OutputError):
    """A checkpoint is damaged; raised on all ranks alike."""


def path_of(target: Path, step: int) -> Path:
    """The checkpoint of `step` that belongs to the result file `target`."""
    return target.with_name(f"{target.stem}.checkpoint-{step:012d}.h5")


def existing(target: Path) -> list[Path]:
    """The whole checkpoints that belong to the result file `target`, the newest first."""
    return sorted(_beside(target, ".h5"), reverse=True)


def remove(target: Path, keep: int = 0) -> None:
    """Delete all checkpoints of `target` but the newest `keep`, and what a killed run left half written."""
    for path in (*existing(target)[keep:], *_beside(target, ".h5.partial")):
        path.unlink(missing_ok=True)


def _beside(target, ending):
    start = f"{target.stem}.checkpoint-"
    if not target.absolute().parent.is_dir():
        return []
    return [p for p in target.absolute().parent.iterdir() if p.name.startswith(start) and p.name.endswith(ending)]


def write(comm, target: Path, step: int, memory: dict, tables, configuration: str, keep: int) -> Path:
    """Write a checkpoint of `step` beside the result file `target` and delete older ones but `keep`; collective.

    `tables` yields (name, keys (n,), columns by name) of this rank's rows: `points`, and `rows_0`, `rows_1` ... by the
    ids of their first ends; `memory` is what the parts remember, `configuration` the scene as JSON.
    Raises OutputError on all ranks alike, when the disk is full for example; the older checkpoints remain then.
    """
    path = path_of(target, step)
    file = _Writer(comm, path)
    file.begin({"memory": json.dumps(memory), "configuration": configuration, "step": step, "program": PROGRAM})
    for table in tables:
        file.put(*table)
    file.finish()
    file.on_rank_0(remove, target, keep)
    return path


class _Writer:
    """A checkpoint file that is being written; rank 0 holds it, all ranks call."""

    def __init__(self, comm, path: Path):
        self.comm, self.path = comm, path
        self._partial = path.with_name(path.name + ".partial")
        self._file = None

    def begin(self, attributes) -> None:
        self.on_rank_0(self._open, attributes)

    def put(self, table: str, keys: np.ndarray, columns: dict[str, np.ndarray]) -> None:
        """Write the rows of all ranks, which are sorted by `keys` (n,); equal keys are all on one rank."""
        comm = self.comm
        total = comm.allreduce(len(keys))
        self.on_rank_0(self._lay_out, table, total, columns)
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
            self.on_rank_0(self._put_rows, f"{table}/{name}", offset, gathered, order)
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

    def finish(self) -> None:
        self.on_rank_0(self._close)

    def on_rank_0(self, action, *arguments) -> None:
        """Do `action` on rank 0; then all ranks return, or raise the same OutputError."""
        failure = None
        if self.comm.rank == 0:
            try:
                action(*arguments)
            except (OSError, RuntimeError) as error:  # h5py raises the one or the other
                number = getattr(error, "errno", None)
                failure = f"cannot write the checkpoint {self.path}: {os.strerror(number) if number else error}"
        failure = self.comm.bcast(failure)
        if failure is not None:
            if self.comm.rank == 0:
                self._give_up()
            raise OutputError(failure)

    # On rank 0 only

    def _open(self, attributes):
        self._file = h5py.File(self._partial, "w", libver="latest", locking=False)
        self._file.attrs.update(attributes)

    def _lay_out(self, table, total, columns):
        for name, rows in columns.items():
            shape = (total, *rows.shape[1:])
            # the checksums tell on reading whether the file was damaged
            layout = {"chunks": (min(_CHUNK, total), *rows.shape[1:]), "fletcher32": True} if np.prod(shape) else {}
            self._file.create_dataset(f"{table}/{name}", shape, rows.dtype, **layout)

    def _put_rows(self, name, offset, rows, order):
        if rows.size:
            self._file[name][offset : offset + len(rows)] = rows[order]

    def _close(self):
        self._file.close()
        self._file = None
        sync(self._partial)
        os.replace(self._partial, self.path)
        sync(self.path.absolute().parent)

    def _give_up(self):
        with contextlib.suppress(OSError, RuntimeError):  # what went wrong is reported already
            if self._file is not None:
                file, self._file = self._file, None
                file.close()
            self._partial.unlink(missing_ok=True)


def sync(path: Path) -> None:
    """Bring a file, or a folder's entries, to the disk."""
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


Table = dict[str, np.ndarray]


def read(path: Path, comm, configuration: str, message=print) -> tuple[Table, list[Table], dict]:
    """This rank's share of a checkpoint: columns of the points, of `rows_0`, `rows_1` ..., and the memory; collective.

    `configuration` is that of the run that wants to go on; `message` is told if another version wrote the file. On all
    ranks alike raises CheckpointError if the file is damaged, OutputError if it belongs to another scene.
    """
    share: tuple[Table, list[Table], dict] | None = None
    failure, foreign, program = None, None, PROGRAM
    try:
        with h5py.File(path, "r", locking=False) as file:
            foreign = _difference(file, configuration)
            program = file.attrs.get("program")
            if foreign is None:
                share = _share(file, comm.rank, comm.size)
    except (OSError, RuntimeError, KeyError, ValueError) as error:
        failure = f"it is damaged ({error})"
    failure = next((f for f in comm.allgather(failure) if f is not None), None)
    if failure is not None:
        raise CheckpointError(f"checkpoint {path}: {failure}")
    if share is None:
        raise OutputError(f"cannot resume from {path}: {foreign}; put it back, or start anew with --overwrite")
    if program != PROGRAM:
        message(f"{path.name} is of another version of periporo, or of another kind of processor: the run goes on, "
                "but not to the last bit as if it had not been interrupted")  # fmt: skip
    return share


def _difference(file, configuration):
    """What changed in the scene since the checkpoint, None if nothing."""
    before, now = json.loads(file.attrs["configuration"]), json.loads(configuration)
    changed = sorted(k for k in before.keys() | now.keys() if before.get(k) != now.get(k))
    return f"the scene has another {', '.join(changed)}" if changed else None


def _share(file, rank, ranks):
    ids = file["points/id"]
    begin, end = (len(ids) * r // ranks for r in (rank, rank + 1))
    points = {name: data[begin:end] for name, data in file["points"].items()}
    lower = int(ids[begin]) if begin < len(ids) else _NO_ID
    upper = int(ids[end]) if end < len(ids) else _NO_ID
    rows = []
    for k in range(sum(name.startswith("rows_") for name in file)):
        table = file[f"rows_{k}"]
        part = slice(_first_at_least(table["ids"], lower), _first_at_least(table["ids"], upper))
        rows.append({name: table[name][part] for name in ("ids", "stress", "state")})
    return points, rows, json.loads(file.attrs["memory"])


def _first_at_least(ids, value):
    """The first row of the sorted dataset `ids` (n, 2) whose first id is not below `value`."""
    low, high = 0, len(ids)
    while low < high:
        middle = (low + high) // 2
        if ids[middle, 0] < value:
            low = middle + 1
        else:
            high = middle
    return low
