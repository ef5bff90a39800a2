"""Checkpoints: the state of a run in one HDF5 file, the same for any number of ranks.

`/points/<field>` holds a row per point in the order of ids, `/rows_<k>/` ids, stress and state of the active rows of
material k in the order of their ids; the attribute `memory` is what the parts of the program remember (JSON, whose
numbers keep every bit), `configuration` the scene. A file has a temporary name until it is whole and on the disk.
Rank 0 writes what it gathers block by block, or several ranks write parts, each with a range of ids, in the folder
`<name>.parts`; the file then joins them by virtual datasets. Every rank reads its own share.
"""

import functools
import json
import shutil
from pathlib import Path

import h5py
import numpy as np

from periporo.core.numerics.jit import program_fingerprint
from periporo.errors import OutputError
from periporo.io.output.checkpoint_writer import CheckpointWriter, PartsWriter
from periporo.io.output.parts import faults
from periporo.io.output.vtkhdf_layout import folder_of

PROGRAM = program_fingerprint()
"""What wrote a checkpoint: version of the sources and kind of processor, on which bits may depend."""

_NO_ID = np.iinfo(np.int64).max


class CheckpointError(OutputError):
    """A checkpoint is damaged; raised on all ranks alike."""


def path_of(target: Path, step: int) -> Path:
    """The checkpoint of `step` that belongs to the result file `target`."""
    return target.with_name(f"{target.stem}.checkpoint-{step:012d}.h5")


def existing(target: Path) -> list[Path]:
    """The whole checkpoints that belong to the result file `target`, the newest first."""
    return sorted(_beside(target, ".h5"), reverse=True)


def remove(target: Path, keep: int = 0, last: Path | None = None) -> None:
    """Delete all checkpoints of `target` but the newest `keep`, and what a killed run left half written.

    Those after the `last`, the one just written, go, too: they are damaged, or of a motion that was taken back.
    """
    found = existing(target)
    kept = [path for path in found if last is None or path.name <= last.name][:keep]
    for path in (*found, *_beside(target, ".h5.partial")):
        if path not in kept:
            path.unlink(missing_ok=True)
    for folder in _beside(target, ".parts"):
        if folder not in map(folder_of, kept):
            shutil.rmtree(folder)


def _beside(target, ending):
    start = f"{target.stem}.checkpoint-"
    if not target.absolute().parent.is_dir():
        return []
    return [p for p in target.absolute().parent.iterdir() if p.name.startswith(start) and p.name.endswith(ending)]


def write(background, target: Path, step: int, memory: dict, tables, configuration: str, keep: int, parts=None) -> Path:
    """Have a checkpoint of `step` written beside the result file `target`, and others but `keep` deleted; its path.

    Collective; done when `background` (`io.output.background`) has settled, which raises OutputError if the disk is
    full for example; the others remain then. `tables` yields (name, keys (n,), columns by name) of this
    rank's rows: `points`, and `rows_0`, `rows_1` ... by the ids of their first ends; `memory` is what the parts of the
    program remember, `configuration` the scene as JSON. parts: number of files that several ranks write side by side.
    """
    path = path_of(target, step)
    file = CheckpointWriter(background, path) if parts is None else PartsWriter(background, path, parts)
    file.begin({"memory": json.dumps(memory), "configuration": configuration, "step": step, "program": PROGRAM})
    for table in tables:
        file.put(*table)
    file.finish(functools.partial(remove, target, keep, path))
    return path


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
                failure = _faults(path, file, comm.rank, comm.size)
            if foreign is None and failure is None:
                share = _share(file, comm.rank, comm.size)
            failure = failure and f"it is damaged: {failure}"
    except (OSError, RuntimeError, KeyError, ValueError) as error:
        failure = f"it is damaged ({_damaged(path) or error})"
    failure = next((f for f in comm.allgather(failure) if f is not None), None)
    if failure is not None:
        raise CheckpointError(f"checkpoint {path}: {failure}")
    if share is None:
        raise OutputError(f"cannot resume from {path}: {foreign}; put it back, or start anew with --overwrite")
    if program != PROGRAM:
        message(f"{path.name} is of another version of periporo, or of another kind of processor: the run goes on, "
                "but not to the last bit as if it had not been interrupted")  # fmt: skip
    return share


def _faults(path, file, rank, ranks):
    """Which parts are missing or damaged, of those that this rank looks at, in words; None if none is."""
    rows = {table: group.attrs.get("parts", ()) for table, group in file.items()}

    def is_whole(part, number):
        return all(len(part[f"{table}/{name}"]) == rows[table][number] for table in rows for name in file[table])

    return faults(path, range(rank, len(rows["points"]), ranks), is_whole)


def _damaged(path):
    """The parts that cannot be read to their end, in words; None if there are none."""

    def is_readable(part, number):
        for table in part.values():
            for column in table.values():
                column[()]
        return True

    return faults(path, (int(part.stem) for part in folder_of(path).glob("*.h5")), is_readable)


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
