"""Surfaces of triangles from files: STL, PLY and OBJ, through the optional package `trimesh`."""

from dataclasses import dataclass
from functools import lru_cache
from itertools import takewhile
from pathlib import Path
from typing import Any

import numpy as np

from periporo.core.numerics.meshes import TriangleTree, plant, windings
from periporo.io.geometry.points import counted_from
from periporo.io.geometry.rasters import GroundFileError

_COARSE = 1e-3  # of an edge: what rounding may move a corner by


@dataclass(frozen=True, eq=False)
class Mesh:
    """A surface of triangles with its `tree`; `closed` if it has no border."""

    tree: TriangleTree
    closed: bool

    def inside(self, positions: np.ndarray) -> np.ndarray:
        """Which of `positions` (n, 3) a closed surface lies around, (n,) bool."""
        return self.count(positions) == 1

    def count(self, positions: np.ndarray) -> np.ndarray:
        """How often it lies around `positions` (n, 3); not 0 or 1 where it crosses itself."""
        found = np.zeros(len(positions), np.int64)
        tree = self.tree
        windings(tree.corners, tree.triangles, tree.boxes, np.ascontiguousarray(positions), found)
        return found


_kept: dict[tuple, Mesh] = {}


def read_mesh(name: str, origin: tuple[float, ...] = (), *, closed: bool = False) -> Mesh:
    """The surface in the file `name`, read once, its places counted from `origin` (3,) m.

    An open one is turned so that its outside is up. Raises GroundFileError, also if it must be `closed` and is not.
    """
    try:
        changed = Path(name).stat().st_mtime_ns
    except OSError as error:
        raise GroundFileError(f"the file cannot be read: {error.strerror}") from None
    key = name, changed, origin
    if key not in _kept:
        keep_mesh(name, origin, _prepared(*_corners_and_triangles(name, changed), origin))
    mesh = _kept[key]
    if closed and not mesh.closed:
        raise GroundFileError(f"the surface is open: an edge at {_border(mesh)} belongs to one triangle; close it")
    return mesh


def keep_mesh(name: str, origin: tuple[float, ...], mesh: Mesh) -> None:
    """Have `read_mesh` give this one, for instance from memory that several processes share."""
    for array in vars(mesh.tree).values():
        array.setflags(write=False)
    _kept[name, Path(name).stat().st_mtime_ns, origin] = mesh


def forget_meshes() -> None:
    """Free the memory of all that was read."""
    _kept.clear()
    _corners_and_triangles.cache_clear()


@lru_cache(maxsize=1)
def _corners_and_triangles(name: str, _changed: int) -> tuple[np.ndarray, np.ndarray]:
    """Corners (n, 3) m, each place once, and triangles (m, 3) between them, as in the file."""
    try:
        import trimesh
    except ImportError:
        raise GroundFileError("surfaces of triangles need trimesh (pip install 'periporo[terrain]')") from None
    try:
        found: Any = trimesh.load(name, process=False, force="mesh")
        corners, triangles = np.asarray(found.vertices, np.float64), np.asarray(found.faces, np.int64)
    except Exception as error:  # trimesh raises whatever the format's reader stumbles over
        raise GroundFileError(f"it cannot be read as a surface of triangles: {error}") from None
    if not len(triangles):
        raise GroundFileError("it holds no triangles")
    if not np.isfinite(corners).all():
        raise GroundFileError(f"corner {int(np.argmax(~np.isfinite(corners).all(axis=1))) + 1} is not a finite place")
    if _holds_single_precision(name) and np.array_equal(corners, corners.astype(np.float32)):
        _refuse_coarse(corners, triangles)
    corners, rows = _distinct(corners)
    triangles = rows[triangles]
    area = np.linalg.norm(_twice_area(corners, triangles), axis=1)
    sides = [corners[triangles[:, k]] - corners[triangles[:, k - 1]] for k in range(3)]
    longest = np.max([(side**2).sum(axis=1) for side in sides], axis=0)
    return corners, triangles[area > 1e-12 * longest]


def _holds_single_precision(name: str) -> bool:
    """Whether the file may hold its corners so: every STL (text ones are told by their digits), a PLY by its header."""
    if Path(name).suffix.lower() != ".ply":
        return Path(name).suffix.lower() == ".stl"
    with open(name, "rb") as file:
        header = takewhile(lambda line: line.strip() != b"end_header", file)
        return any(line.split() in ([b"property", kind, b"x"] for kind in (b"float", b"float32")) for line in header)


def _distinct(places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The rows of `places` (n, 3), each once and in their order, and which of them each row is.

    Like NumPy's unique of rows, which compares them as a whole and takes nearly five times as long.
    """
    number = np.zeros(len(places), np.int64)
    for column in places.T:
        _, rank = np.unique(column, return_inverse=True)
        _, first, number = np.unique(number * len(places) + rank, return_index=True, return_inverse=True)
    return places[first], number


def _refuse_coarse(corners: np.ndarray, triangles: np.ndarray) -> None:
    """Raise GroundFileError if single precision has moved corners by more than `_COARSE` of an edge."""
    step = float(np.spacing(np.float32(np.abs(corners).max())))
    edge = float(np.median(np.linalg.norm(corners[triangles[:, 1]] - corners[triangles[:, 0]], axis=1)))
    if step > _COARSE * edge:
        raise GroundFileError(
            f"it holds single-precision numbers, which at {np.abs(corners).max():.9g} m are {step:.3g} m apart, and "
            f"half of its edges are shorter than {edge:.3g} m; write it about a local origin, or as OBJ, or as PLY "
            "with `property double`"
        )


def _twice_area(corners: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Normals (m, 3) of triangles, twice as long as their areas."""
    first = corners[triangles[:, 0]]
    return np.cross(corners[triangles[:, 1]] - first, corners[triangles[:, 2]] - first)


def _prepared(corners: np.ndarray, triangles: np.ndarray, origin: tuple[float, ...]) -> Mesh:
    """The surface with its outside known. Raises GroundFileError if neighbours disagree about it."""
    ends = np.sort(triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 3, 2), axis=2)
    edges = ends[..., 0] * len(corners) + ends[..., 1]
    forwards = triangles[:, [0, 1, 2]] < triangles[:, [1, 2, 0]]
    order = np.argsort(edges.ravel(), kind="stable")
    sorted_edges, way = edges.ravel()[order], forwards.ravel()[order]
    begins = np.flatnonzero(np.concatenate([[True], sorted_edges[1:] != sorted_edges[:-1]]))
    count = np.diff([*begins, len(sorted_edges)])
    turns = np.add.reduceat(np.where(way, 1, -1), begins)
    bad = np.abs(turns) > 1
    if bad.any():
        at = corners[sorted_edges[begins[np.argmax(bad)]] // len(corners)]
        raise GroundFileError(
            f"its triangles disagree about which side is outside, at ({_place(at)}); turn them all alike, for instance "
            "with trimesh's fix_normals"
        )
    alone = np.zeros(len(sorted_edges), bool)
    alone[order] = np.repeat(count == 1, count)
    open_edge = alone.reshape(-1, 3)
    closed = not open_edge.any()
    normals = _twice_area(corners, triangles)
    upward = float(normals[:, 2].sum())
    around = float((corners[triangles[:, 0]] * normals).sum())  # six volumes
    if (around if closed else upward) < 0.0:
        triangles = triangles[:, ::-1]
        open_edge = open_edge[:, [1, 0, 2]]
    at_border = np.zeros(len(corners), bool)
    for k in range(3):
        at_border[triangles[open_edge[:, k]][:, [k, (k + 1) % 3]]] = True
    bits = np.concatenate([open_edge, at_border[triangles]], axis=1)
    borders = (bits << np.arange(6)).sum(axis=1)
    places = counted_from(corners, origin) if origin else corners
    return Mesh(plant(places, triangles, borders), closed)


def _border(mesh: Mesh) -> str:
    """A place at the border of an open surface, for people."""
    row = int(np.argmax(mesh.tree.borders & 7 > 0))
    return f"({_place(mesh.tree.corners[mesh.tree.triangles[row]].mean(axis=0))})"


def _place(place) -> str:
    return ", ".join(f"{x:.9g}" for x in place)
