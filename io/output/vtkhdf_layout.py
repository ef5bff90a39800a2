"""Groups and datasets of a result file: made, cut back to fewer outputs, and looked at.

What they hold is said in `io.output.vtkhdf`.
"""

from functools import cached_property
from pathlib import Path

import h5py
import numpy as np

from periporo.core.numerics.tensors import COMPONENTS
from periporo.io.output.lock import Lock, Locked

_CHUNK_ROWS = 8192
INDEX_ROWS = 512  # chunk of the datasets with one row per output
HISTORY_ROWS = 4096
_AXES = ("x", "y", "z")
STORED_COMPONENTS = {1: (), 2: _AXES, 3: _AXES, 4: COMPONENTS, 6: COMPONENTS}
COUNTS = ("NumberOfPoints", "NumberOfCells", "NumberOfConnectivityIds")

# The oldest file format: newer ones mark a file as being written, and a killed process leaves that mark.
# No lock, so that ParaView and open_results can look at a run while it goes on.
ACCESS = {"libver": "earliest", "locking": False}


def create(path: Path, dimension: int, fields, obstacles: bool) -> h5py.File:
    """A new file without outputs; what it holds depends on nothing but what is written (no times)."""
    path.unlink(missing_ok=True)  # whoever reads the old file keeps it
    file = _hold_metadata(h5py.File(path, "x", **ACCESS))
    grid = file.create_group("VTKHDF")
    grid.attrs.create("Version", (2, 0), dtype="i8")
    # of fixed length: VTK 9.3 reads no other
    grid.attrs.create("Type", b"UnstructuredGrid", dtype=h5py.string_dtype("ascii", 16))
    index = {name: _growing(grid, None, "i8", rows=INDEX_ROWS) for name in (
        "NumberOfParts", "PartOffsets", "PointOffsets", "CellOffsets", "ConnectivityIdOffsets", "StepNumbers")}
    index["Values"] = _growing(grid, None, "f8", rows=INDEX_ROWS, unit="s")
    for name in COUNTS:
        _growing(grid, name, "i8", rows=INDEX_ROWS)
    _growing(grid, "Connectivity", "i8")
    _growing(grid, "Offsets", "i8")
    _growing(grid, "Types", "u1")
    _growing(grid, "Points", "f8", unit="m", components=_AXES)
    data = grid.create_group("PointData")
    _growing(data, "id", "i8")
    for name, (columns, unit) in fields.items():
        _growing(data, name, "f8", unit=unit, components=STORED_COMPONENTS[columns])
    offsets = {name: _growing(grid, None, "i8", rows=INDEX_ROWS) for name in data}
    steps = grid.create_group("Steps")
    steps.attrs.create("NSteps", 0, dtype="i8")
    for name, dataset in index.items():
        steps[name] = dataset
    group = steps.create_group("PointDataOffsets")
    for name, dataset in offsets.items():
        group[name] = dataset
    file.create_group("History")
    file.create_group("Run").attrs.update({"dimension": dimension} | ({"obstacles": 1} if obstacles else {}))
    return file


def reopen(path: Path) -> h5py.File:
    """An existing file, to go on writing it."""
    return _hold_metadata(h5py.File(path, "r+", **ACCESS))


def _hold_metadata(file):
    """Let metadata reach the disk at a flush only, so that the file is whole at any other time."""
    config = file.id.get_mdc_config()
    config.evictions_enabled = False
    config.incr_mode = config.flash_incr_mode = config.decr_mode = 0
    file.id.set_mdc_config(config)
    return file


def _growing(group, name, kind, *, rows=_CHUNK_ROWS, unit="", components=()):
    """An empty dataset that grows by rows."""
    tail = (len(components),) if components else ()
    dataset = group.create_dataset(name, (0, *tail), kind, maxshape=(None, *tail), chunks=(rows, *tail))
    if unit:
        dataset.attrs["unit"] = unit
    if components:
        dataset.attrs["components"] = list(components)
    return dataset


def history_column(group, name, unit):
    """A dataset for one global figure."""
    return _growing(group, name, "i8" if name == "step" else "f8", rows=HISTORY_ROWS, unit=unit)


def put(dataset, start, rows):
    """Write rows from row `start` on; the dataset grows to hold them."""
    if len(dataset) < start + len(rows):
        dataset.resize(start + len(rows), axis=0)
    dataset[start : start + len(rows)] = rows


class Index:
    """Where the outputs of an open file stand."""

    def __init__(self, file: h5py.File):
        self.grid, self.steps = file["VTKHDF"], file["VTKHDF/Steps"]
        self.count = int(self.steps.attrs["NSteps"])

    @property
    def datasets(self) -> list[h5py.Dataset]:
        """Those with an entry per output."""
        own = [item for item in self.steps.values() if isinstance(item, h5py.Dataset)]
        return own + list(self.steps["PointDataOffsets"].values())

    def parts(self, k: int) -> slice:
        """The parts of output k, rows of the datasets `COUNTS`."""
        first = int(self.steps["PartOffsets"][k])
        return slice(first, first + int(self.steps["NumberOfParts"][k]))

    @cached_property
    def ends(self) -> dict[str, int]:
        """How many rows each dataset has, by name, when it holds the outputs that count and nothing else."""
        if self.count == 0:
            return dict.fromkeys((*COUNTS, "Connectivity", "Offsets", "Types", "rows"), 0)
        last = self.count - 1
        parts = self.parts(last)
        points, cells, ids = (int(self.grid[name][parts].sum()) for name in COUNTS)
        begin = {name: int(self.steps[name][last]) for name in ("PointOffsets", "CellOffsets", "ConnectivityIdOffsets")}
        cells += begin["CellOffsets"]
        ids += begin["ConnectivityIdOffsets"]
        if parts.stop == last + 1 and not self.steps["ConnectivityIdOffsets"][: self.count].any():
            ids = int(self.grid["NumberOfConnectivityIds"][: parts.stop].max())  # before 0.2.0 all shared the longest
        return dict.fromkeys(COUNTS, parts.stop) | {
            "Connectivity": ids, "Offsets": cells + parts.stop, "Types": cells, "rows": begin["PointOffsets"] + points,
        }  # fmt: skip

    def lengths(self) -> list[tuple[h5py.Dataset, int]]:
        """Every dataset of the grid, and how many rows it should have."""
        ends, grid = self.ends, self.grid
        wanted = [(dataset, self.count) for dataset in self.datasets]
        wanted += [(grid[name], ends[name]) for name in (*COUNTS, "Connectivity", "Offsets", "Types")]
        return wanted + [(dataset, ends["rows"]) for dataset in (grid["Points"], *grid["PointData"].values())]


def is_whole(file: h5py.File) -> bool:
    """Whether the file holds the outputs that it counts and nothing of another one."""
    history = {len(dataset) for dataset in file["History"].values()}
    return len(history) < 2 and all(len(dataset) == rows for dataset, rows in Index(file).lengths())


def cut(file: h5py.File, step: float) -> None:
    """Drop the outputs and the history after `step`, and what a killed run left of another output."""
    index, history = Index(file), file["History"]
    keep = int(np.searchsorted(index.steps["StepNumbers"][: index.count], step, side="right"))
    index.steps.attrs.modify("NSteps", keep)
    file.flush()  # the count first: what is about to go must not count
    for dataset, rows in Index(file).lengths():
        dataset.resize(rows, axis=0)
    if "step" in history:
        whole = min(len(dataset) for dataset in history.values())
        kept = int(np.searchsorted(history["step"][:whole], step, side="right"))
        for dataset in history.values():
            dataset.resize(kept, axis=0)


def mend(path: Path) -> str | None:
    """Cut off what a killed run left of an output that it was writing.

    What was done, or why not, as a sentence; None if the file is whole or not one of ours.
    """
    try:
        with h5py.File(path, "r", locking=False) as file:
            if "VTKHDF/Steps/StepNumbers" not in file or is_whole(file):
                return None
    except (OSError, RuntimeError, KeyError):
        return None  # whoever reads it will say why
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
        except OSError as error:
            return f"the last output was cut off while it was written, and the file cannot be mended: {error}"
    return "the last output was cut off while it was written; what there was of it has been removed"
