"""Points of a body from a file: CSV; VTK through the optional package `vtk`; cells of meshes through `meshio`."""

import contextlib
import csv
import difflib
import io
import math
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

MAX_FILE_BYTES = 2_000_000_000
_TABLES = (".csv", ".xyz")
_VTK_SUFFIXES = (".vtk", ".vtu", ".vtp")


_MESH_SUFFIXES = (".msh", ".inp", ".med", ".bdf", ".xdmf")
_TRIANGLES = {"triangle": ((0, 1, 2),), "quad": ((0, 1, 2), (0, 2, 3))}
_TETRAHEDRA = {
    "tetra": ((0, 1, 2, 3),),
    "pyramid": ((0, 1, 2, 4), (0, 2, 3, 4)),
    "wedge": ((0, 1, 2, 5), (0, 1, 5, 4), (0, 4, 5, 3)),
    "hexahedron": ((0, 1, 2, 6), (0, 2, 3, 6), (0, 3, 7, 6), (0, 7, 4, 6), (0, 4, 5, 6), (0, 5, 1, 6)),
}
_LESS = {2: ("vertex", "line"), 3: ("vertex", "line", "triangle", "quad")}  # cells of fewer dimensions


class PointFileError(ValueError):
    """The file does not hold the points that a body needs; the message says why."""


@dataclass(frozen=True, eq=False)
class PointTable:
    """`positions` (n, d) m and `volumes` (n,) m^d, or None where the file gives none."""

    positions: np.ndarray
    volumes: np.ndarray | None


def read_points(name: str, dimension: int, origin: tuple[float, ...] = (), *, cells: bool = False) -> PointTable:
    """The points of file `name`, read once, their places counted from `origin` (d,) m, by default as in the file.

    Of `cells`, and always of a mesh, they are the middles. Raises PointFileError if they cannot be used as they are.
    """
    try:
        found = Path(name).stat()
    except OSError as error:
        raise PointFileError(f"the file cannot be read: {error.strerror}") from None
    if found.st_size > MAX_FILE_BYTES:
        raise PointFileError(f"the file is larger than {MAX_FILE_BYTES // 10**9} GB")
    return _read(Path(name), dimension, found.st_mtime_ns, origin, cells)


@lru_cache(maxsize=8)
def _read(path: Path, dimension: int, _modified: int, origin: tuple[float, ...], cells: bool) -> PointTable:
    suffix = path.suffix.lower()
    if suffix not in (*_TABLES, *_VTK_SUFFIXES, *_MESH_SUFFIXES):
        allowed = ", ".join((*_TABLES, *_VTK_SUFFIXES, *_MESH_SUFFIXES))
        raise PointFileError(f"unknown kind of file '{suffix}'; allowed: {allowed}")
    read: Callable[[Path, int], tuple[np.ndarray, np.ndarray | None]]
    read = _from_cells if cells or suffix in _MESH_SUFFIXES else _from_csv if suffix in _TABLES else _from_vtk
    positions, volumes = read(path, dimension)
    _refuse_bad_rows(positions, volumes, first_row=2 if suffix in _TABLES else 0)
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
    """Columns x, y, z and volume of a table, in any order and case; others, such as those of GIS programs, are left."""
    axes = "xyz"[:dimension]
    try:
        with open(path, encoding="utf-8-sig", newline="") as file:
            line = file.readline()
            mark = next((mark for mark in ",;" if mark in line), None)
            names = [name.lower() for name in _cells(line.lstrip("/# \t"), mark)]  # as CloudCompare begins
            columns = [names.index(name) for name in _wanted(names, axes)]
            begin = file.tell()
            width = len(_cells(file.readline(), mark))
            file.seek(begin)
            with warnings.catch_warnings(action="ignore"):  # of an empty table, which is an error below
                table = np.loadtxt(file, delimiter=mark, ndmin=2, comments=None, quotechar='"', usecols=columns)
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
    if width != len(names):
        raise PointFileError(f"the header has {len(names)} columns, the rows have {width}")
    return table[:, :dimension], table[:, dimension] if "volume" in names else None


def _cells(line: str, mark: str | None) -> list[str]:
    """The entries of a line between commas or semicolons, or between blanks."""
    entries = line.split() if mark is None else next(csv.reader([line.strip()], delimiter=mark), [])
    return [entry.strip() for entry in entries]


def _wanted(names: list[str], axes: str) -> list[str]:
    """The columns of a table that are read: its header must name them, and no other axis. Raises PointFileError."""
    wanted = [*axes, *(name for name in names if name == "volume")]
    if sorted(wanted) != sorted(name for name in names if name in ("x", "y", "z", "volume")):
        expected = ",".join(axes)
        raise PointFileError(
            f"its first line must name the columns {expected} and, if it has it, volume, not {str(names):.60}"
        )
    near = difflib.get_close_matches("volume", names)
    if near and "volume" not in names:
        raise PointFileError(f"its column '{near[0]}' is not read; name it volume, if it is that, in m^{len(axes)}")
    return wanted


def _from_cells(path: Path, dimension: int) -> tuple[np.ndarray, np.ndarray]:
    """Middles and volumes of the cells of a mesh; those of fewer dimensions, such as its surface, are left."""
    corners, blocks = _mesh(path, dimension)
    parts = _TRIANGLES if dimension == 2 else _TETRAHEDRA
    middles, volumes = [], []
    for kind, cells in blocks:
        name = kind.rstrip("0123456789")  # of cells with nodes between the corners, which come first
        if name in _LESS[dimension]:
            continue
        if name not in parts:
            raise PointFileError(f"it has cells of the kind '{kind}'; allowed: {', '.join(parts)}")
        simplices = corners[cells[:, np.array(parts[name])]]  # cells, parts, corners, components
        edges = simplices[:, :, 1:] - simplices[:, :, :1]
        size = np.linalg.det(edges) / math.factorial(dimension)
        middle = simplices.mean(axis=2)
        bad = ~((size > 0.0).all(axis=1) | (size < 0.0).all(axis=1))
        if bad.any():
            row = int(np.argmax(bad))
            at = ", ".join(f"{x:.9g}" for x in middle[row].mean(axis=0))
            raise PointFileError(f"the {name} {row + 1} at ({at}) is flat or turned inside out")
        share = size / size.sum(axis=1, keepdims=True)
        middles.append((share[:, :, None] * middle).sum(axis=1))
        volumes.append(np.abs(size).sum(axis=1))
    if not middles:
        raise PointFileError(f"it has no cells of {dimension} dimensions; allowed: {', '.join(parts)}")
    return np.concatenate(middles), np.concatenate(volumes)


def _mesh(path: Path, dimension: int) -> tuple[np.ndarray, list[tuple[str, np.ndarray]]]:
    """Corners (n, d) m of a mesh, and its cells by their kind."""
    try:
        import meshio
    except ImportError:
        raise PointFileError("cells of a mesh need meshio (pip install 'periporo[terrain]')") from None
    told = io.StringIO()
    try:
        with contextlib.redirect_stdout(told), contextlib.redirect_stderr(told):
            mesh = meshio.read(path)
    except (Exception, SystemExit) as error:  # what the format's reader stumbles over; or it would end the program
        raise PointFileError(f"it cannot be read as a mesh: {error!s:.200}") from None
    corners = np.asarray(mesh.points, float)
    if not np.isfinite(corners).all():
        raise PointFileError(f"corner {int(np.argmax(~np.isfinite(corners).all(axis=1))) + 1} is not a finite place")
    if dimension == 2 and corners.shape[1] == 3 and np.ptp(corners[:, 2]) > 0.0:
        raise PointFileError("its corners do not lie in one x-y plane, but the scene has 2 dimensions")
    if corners.shape[1] < dimension:
        raise PointFileError("it lies in a plane, but the scene has 3 dimensions")
    return corners[:, :dimension], _each_once([(block.type, np.asarray(block.data)) for block in mesh.cells])


def _each_once(blocks: list[tuple[str, np.ndarray]]) -> list[tuple[str, np.ndarray]]:
    """The cells of each kind, in the order of the file; gmsh writes a cell of two groups twice into MSH 2.2."""
    joined = []
    for kind in dict.fromkeys(kind for kind, _ in blocks):
        cells = np.concatenate([cells for other, cells in blocks if other == kind])
        _, first = np.unique(np.sort(cells, axis=1), axis=0, return_index=True)
        joined.append((kind, cells[np.sort(first)]))
    return joined


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
