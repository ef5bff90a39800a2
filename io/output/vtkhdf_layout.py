"""Groups and datasets of a result file: made, cut back to fewer outputs, and looked at.

What they hold is said in `io.output.vtkhdf`.
"""

import errno
import math
import os
import shutil
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import h5py
import numpy as np

from periporo.core.numerics.tensors import COMPONENTS, MATRIX, VECTOR

_CHUNK_ROWS = 8192
INDEX_ROWS = 512  # chunk of the datasets with one row per output
HISTORY_ROWS = 4096
INDEX = "index.h5"
_METADATA_BYTES = 16_384  # most that a growing dataset adds to its description and chunk index at once
STORED_COMPONENTS = {1: (), 2: VECTOR, 3: VECTOR, 4: COMPONENTS, 6: COMPONENTS, 9: MATRIX}
COUNTS = ("NumberOfPoints", "NumberOfCells", "NumberOfConnectivityIds")

# The oldest file format: newer ones mark a file as being written, and a killed process leaves that mark.
# No lock, so that ParaView and open_results can look at a run while it goes on.
ACCESS = {"libver": "earliest", "locking": False}


@dataclass(frozen=True)
class Column:
    """What a dataset with a row per point holds."""

    kind: str
    unit: str = ""
    components: tuple[str, ...] = ()

    @property
    def tail(self) -> tuple[int, ...]:
        """Shape of a row."""
        return (len(self.components),) if self.components else ()

    def describe(self, dataset: h5py.Dataset) -> None:
        """Set the attributes of a dataset."""
        if self.unit:
            dataset.attrs["unit"] = self.unit
        if self.components:
            dataset.attrs["components"] = list(self.components)


def columns_of(fields) -> dict[str, Column]:
    """The datasets with a row per point, by name, for `fields`: name -> (columns, unit)."""
    columns = {"Points": Column("f8", "m", VECTOR), "PointData/id": Column("i8")}
    return columns | {
        f"PointData/{name}": Column("f8", unit, STORED_COMPONENTS[width]) for name, (width, unit) in fields.items()
    }


def stored_columns(grid: h5py.Group) -> dict[str, Column]:
    """The same of a file, from its group of points."""
    found = {"Points": grid["Points"]} | {f"PointData/{name}": grid["PointData"][name] for name in grid["PointData"]}
    return {
        name: Column(d.dtype.str[1:], str(d.attrs.get("unit", "")), tuple(d.attrs.get("components", ())))
        for name, d in found.items()
    }


def folder_of(path: Path) -> Path:
    """The folder of the part files that belong to the result file `path`."""
    return path.with_name(f"{path.name}.parts")


def create_rows(path: Path, columns: dict[str, Column]) -> h5py.File:
    """A new file of rows of points and nothing else."""
    file = hold_metadata(h5py.File(path, "x", **ACCESS))
    for name, column in columns.items():
        growing(file, name, column)
    return file


def create(path: Path, dimension: int, fields, obstacles: bool, parts: int | None) -> h5py.File:
    """A new file without outputs; what it holds depends on nothing but what is written (no times)."""
    path.unlink(missing_ok=True)  # whoever reads the old file keeps it
    file = hold_metadata(h5py.File(path, "x", **ACCESS))
    columns = columns_of(fields)
    grid = file.create_group("VTKHDF")
    grid.attrs.create("Version", (2, 0), dtype="i8")
    # of fixed length: VTK 9.3 reads no other
    grid.attrs.create("Type", b"UnstructuredGrid", dtype=h5py.string_dtype("ascii", 16))
    count = Column("i8")
    index = {name: growing(grid, None, count, rows=INDEX_ROWS) for name in (
        "NumberOfParts", "PartOffsets", "PointOffsets", "CellOffsets", "ConnectivityIdOffsets", "StepNumbers")}
    index["Values"] = growing(grid, None, Column("f8", "s"), rows=INDEX_ROWS)
    if parts is not None:  # rows of each part file in an output
        index["PartRows"] = grid.create_dataset(
            None, (0, parts), "i8", maxshape=(None, parts), chunks=(INDEX_ROWS, parts)
        )
    for name in COUNTS:
        growing(grid, name, count, rows=INDEX_ROWS)
    growing(grid, "Connectivity", count)
    growing(grid, "Offsets", count)
    growing(grid, "Types", Column("u1"))
    if parts is None:
        for name, column in columns.items():
            growing(grid, name, column)
    else:
        for name in ("Points", "PointData"):
            grid[name] = h5py.ExternalLink(f"{folder_of(path).name}/{INDEX}", name)
    offsets = {name.removeprefix("PointData/"): growing(grid, None, count, rows=INDEX_ROWS)
               for name in columns if name != "Points"}
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
    return hold_metadata(h5py.File(path, "r+", **ACCESS))


def hold_metadata(file):
    """Let metadata reach the disk at a flush only, so that the file is whole at any other time."""
    config = file.id.get_mdc_config()
    config.evictions_enabled = False
    config.incr_mode = config.flash_incr_mode = config.decr_mode = 0
    file.id.set_mdc_config(config)
    return file


def growing(group, name, column: Column, *, rows=_CHUNK_ROWS):
    """An empty dataset that grows by rows."""
    tail = column.tail
    dataset = group.create_dataset(name, (0, *tail), column.kind, maxshape=(None, *tail), chunks=(rows, *tail))
    column.describe(dataset)
    return dataset


def reserve(file: h5py.File, path: Path, added, extra: int = 0) -> None:
    """Reserve disk space for each (dataset, rows) of `added` to grow to that many rows, and `extra` bytes.

    So that a full disk shows before HDF5 learns of it.
    """
    size = extra + _METADATA_BYTES * (1 + len(added))
    for dataset, rows in added:
        chunks = math.ceil(rows / dataset.chunks[0]) - math.ceil(len(dataset) / dataset.chunks[0])
        size += max(chunks, 0) * dataset.dtype.itemsize * int(np.prod(dataset.chunks))
    end = file.id.get_filesize()  # as HDF5 sees it; what was reserved before and not used is behind
    if not hasattr(os, "posix_fallocate"):
        if shutil.disk_usage(path.absolute().parent).free < size:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return
    with open(path, "rb+") as handle:
        os.posix_fallocate(handle.fileno(), end, size)


def close(file: h5py.File, path: Path) -> None:
    """Close a file, and give back the space that was reserved and not used."""
    file.flush()
    size = file.id.get_filesize()
    file.close()
    if os.path.getsize(path) > size:
        os.truncate(path, size)


def sync(path: Path) -> None:
    """Bring a file, or a folder's entries, to the disk."""
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def history_column(group, name, unit):
    """A dataset for one global figure."""
    return growing(group, name, Column("i8" if name == "step" else "f8", unit), rows=HISTORY_ROWS)


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

    @property
    def part_rows(self) -> np.ndarray | None:
        """Rows of the part files in each output, (outputs, parts); None if the rows are in this file."""
        return self.steps["PartRows"][: self.count] if "PartRows" in self.steps else None

    @property
    def row_datasets(self) -> list[h5py.Dataset]:
        """Those of this file with a row per point."""
        return [] if "PartRows" in self.steps else [self.grid["Points"], *self.grid["PointData"].values()]

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
        alone = parts.stop == last + 1 and parts.start == last  # each output with one part of its own
        if alone and not self.steps["ConnectivityIdOffsets"][: self.count].any():
            ids = int(self.grid["NumberOfConnectivityIds"][: parts.stop].max())  # before 0.2.0 all shared the longest
        return dict.fromkeys(COUNTS, parts.stop) | {
            "Connectivity": ids, "Offsets": cells + parts.stop, "Types": cells, "rows": begin["PointOffsets"] + points,
        }  # fmt: skip

    def lengths(self) -> list[tuple[h5py.Dataset, int]]:
        """Every dataset of the grid, and how many rows it should have."""
        ends, grid = self.ends, self.grid
        wanted = [(dataset, self.count) for dataset in self.datasets]
        wanted += [(grid[name], ends[name]) for name in (*COUNTS, "Connectivity", "Offsets", "Types")]
        return wanted + [(dataset, ends["rows"]) for dataset in self.row_datasets]


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
