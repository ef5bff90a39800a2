"""Points of a body from a file: CSV, or VTK files through the optional `vtk` package."""

import csv
import math
import warnings
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

MAX_FILE_BYTES = 2_000_000_000
_VTK_SUFFIXES = (".vtk", ".vtu", ".vtp")


class PointFileError(ValueError):
    """The file does not hold the points that a body needs; the message says why."""


@dataclass(frozen=True, eq=False)
class PointTable:
    """`positions` (n, d) m and `volumes` (n,) m^d, or None where the file gives none."""

    positions: np.ndarray
    volumes: np.ndarray | None


def read_points(name: str, dimension: int, origin: tuple[float, ...] = ()) -> PointTable:
    """The points of file `name`, read once, their places counted from `origin` (d,) m, by default as in the file.

    Raises PointFileError if they cannot be used as they are.
    """
    try:
        found = Path(name).stat()
    except OSError as error:
        raise PointFileError(f"the file cannot be read: {error.strerror}") from None
    if found.st_size > MAX_FILE_BYTES:
        raise PointFileError(f"the file is larger than {MAX_FILE_BYTES // 10**9} GB")
    return _read(Path(name), dimension, found.st_mtime_ns, origin)


@lru_cache(maxsize=8)
def _read(path: Path, dimension: int, _modified: int, origin: tuple[float, ...]) -> PointTable:
    suffix = path.suffix.lower()
    if suffix != ".csv" and suffix not in _VTK_SUFFIXES:
        raise PointFileError(f"unknown kind of file '{suffix}'; allowed: .csv, {', '.join(_VTK_SUFFIXES)}")
    positions, volumes = _from_csv(path, dimension) if suffix == ".csv" else _from_vtk(path, dimension)
    _refuse_bad_rows(positions, volumes, first_row=2 if suffix == ".csv" else 0)
    if origin:
        positions = counted_from(positions, origin)
    positions.setflags(write=False)
    return PointTable(positions, volumes)


def counted_from(value, origin):
    """Coordinates, a number or an array (n, d) of them, counted from `origin`, a number or (d,), m.

    With the digits that they were written with: 4000000.005 becomes .005 and not .00499999988824129.
    """
    if np.ndim(value) == 0:
        return round(value - origin, _decimals(value, origin)) if origin else value
    columns = zip(value.T, origin, strict=True)
    return np.stack([np.round(x - o, _decimals(np.nanmax(np.abs(x)), o)) if o else x for x, o in columns], axis=1)


def _decimals(*values) -> int:
    """Decimals to which the largest of some numbers is known in binary."""
    return math.floor(-math.log10(math.ulp(max(map(abs, values)))))


def _refuse_bad_rows(positions: np.ndarray, volumes: np.ndarray | None, first_row: int) -> None:
    if not len(positions):
        raise PointFileError("the file holds no points")
    bad = ~np.isfinite(positions).all(axis=1)
    if bad.any():
        raise PointFileError(f"row {np.argmax(bad) + first_row} has a coordinate that is not a finite number")
    if volumes is not None:
        bad = ~((volumes > 0.0) & np.isfinite(volumes))
        if bad.any():
            raise PointFileError(
                f"row {np.argmax(bad) + first_row} has a volume that is not a positive number"
            )


def _from_csv(path: Path, dimension: int) -> tuple[np.ndarray, np.ndarray | None]:
    axes = list("xyz"[:dimension])
    try:
        with open(path, encoding="utf-8-sig", newline="") as file:
            header = [name.strip() for name in next(csv.reader([file.readline()]), [])]
            if sorted(header) not in (sorted(axes), sorted([*axes, "volume"])):
                expected = ",".join(axes)
                raise PointFileError(
                    f"its first line must be {expected} or {expected},volume, not {header!s:.60}"
                )
            with warnings.catch_warnings(action="ignore"):  # of an empty table, which is an error below
                table = np.loadtxt(file, delimiter=",", ndmin=2, comments=None)
    except UnicodeDecodeError:
        raise PointFileError("the file is not text") from None
    except OSError as error:
        raise PointFileError(f"the file cannot be read: {error.strerror}") from None
    except PointFileError:
        raise
    except ValueError as error:  # of NumPy: names the row that is not made of numbers
        raise PointFileError(f"below the header: {str(error).partition(';')[0]}") from None
    if table.size == 0:
        raise PointFileError("the file holds no points")
    if table.shape[1] != len(header):
        raise PointFileError(f"the header has {len(header)} columns, the rows have {table.shape[1]}")
    positions = table[:, [header.index(axis) for axis in axes]]
    return positions, table[:, header.index("volume")] if "volume" in header else None


def _from_vtk(path: Path, dimension: int) -> tuple[np.ndarray, np.ndarray | None]:
    try:
        from vtkmodules.util.numpy_support import vtk_to_numpy
        from vtkmodules.vtkIOLegacy import vtkDataSetReader
        from vtkmodules.vtkIOXML import vtkXMLPolyDataReader, vtkXMLUnstructuredGridReader
    except ImportError:
        raise PointFileError("VTK files need the vtk package (pip install vtk); or use .csv") from None
    readers = {".vtk": vtkDataSetReader, ".vtu": vtkXMLUnstructuredGridReader, ".vtp": vtkXMLPolyDataReader}
    reader: Any = readers[path.suffix.lower()]()
    reader.SetFileName(str(path))
    reader.Update()
    grid = reader.GetOutput()
    if reader.GetErrorCode() or grid is None or grid.GetNumberOfPoints() == 0 or not grid.GetPoints():
        raise PointFileError("the file is not readable VTK data with points")
    positions = np.array(vtk_to_numpy(grid.GetPoints().GetData()), dtype=float)
    if dimension == 2 and np.ptp(positions[:, 2]) > 0.0:
        raise PointFileError("its points do not lie in one x-y plane, but the scene has 2 dimensions")
    volumes = grid.GetPointData().GetArray("volume")
    return positions[:, :dimension].copy(), None if volumes is None else np.array(
        vtk_to_numpy(volumes), dtype=float
    )
