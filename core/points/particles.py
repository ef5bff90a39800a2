"""Points as a struct of arrays: owned rows first, then ghosts."""

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from periporo.core.numerics.algebra import DIMENSION
from periporo.core.numerics.tensors import INDEX_PAIRS, component_count

INHERITED = "inherited_stress"
"""Stress that a point had in the material that it was of before."""
RING = "width"
"""The field of `Particles.widths`."""

SHEET = "sheet"
"""The field that tells images of a point from it, and from each other (`periporo.core.ranks.images`)."""

_CACHE_LINE = 64  # bytes
_NO_WIDTHS = np.empty(0)


Axes = tuple[tuple[int, ...], ...]


def scalars(count: int) -> Axes:
    """Axes of columns that do not count along any."""
    return ((),) * count


def vector(dimension: int) -> Axes:
    """Axes of the components of a vector."""
    return tuple((a,) for a in range(dimension))


def matrix(dimension: int) -> Axes:
    """Axes of the components of a matrix, row by row."""
    return tuple((a, b) for a in range(dimension) for b in range(dimension))


def symmetric(dimension: int) -> Axes:
    """Axes of a symmetric d x d matrix: (xx, yy, xy) or (xx, yy, zz, xy, yz, xz)."""
    return tuple(pair for pair in INDEX_PAIRS if max(pair) < dimension)


def tensor(dimension: int) -> Axes:
    """Axes of a row of a stress tensor, which has zz in the plane, too."""
    return INDEX_PAIRS[: component_count(dimension)]


@dataclass(frozen=True)
class Field:
    """A column, or columns, of point data. `columns` None is a plain (n,) array."""

    name: str
    columns: int | None
    unit: str
    migrates: bool = True
    """Travels with its point to another rank; otherwise it is remade in each step."""
    sent: bool = True
    """Has rows for ghosts."""
    dtype: type = np.float64
    axes: Axes | None = None
    """Along which axes each column counts, by which a mirror image of it follows; None if all are scalars."""
    place: bool = False
    """Counts from the origin, so that a shift of the point is one of the field."""
    sparse: bool = False
    """Takes no memory where it is zero at all points of a rank: a read-only array stands for zeros until `own`."""


def standard_fields(dimension: int) -> tuple[Field, ...]:
    """The fields of every scene; features add their own with `Particles.add_field`."""
    d, shape = dimension, dimension * (dimension + 1) // 2
    return (
        Field("id", None, "", dtype=np.int64),
        Field("material", None, "", dtype=np.int64),
        Field("body", None, "", dtype=np.int64),
        Field("group", None, "", dtype=np.int64),  # points of different groups do not bond
        Field("position", d, "m", axes=vector(d), place=True),
        Field("velocity", d, "m/s", axes=vector(d)),
        Field("volume", None, "m^3"),  # at the start: a point's weight among its neighbours, so it stays
        Field("mass", None, "kg", sent=False),
        Field("reference_position", d, "m", sent=False, place=True),  # where the neighbours were found
        Field("initial_position", d, "m", sent=False, place=True),
        Field("dilation", None, "1", sent=False),  # present over initial volume
        Field("jacobian", None, "1", migrates=False, sent=False),  # the same of this step alone
        # remade by the scheme in each step
        Field("share", 3, "1/m^3, 1, 1", migrates=False),  # J integrity / sum of w V, integrity, J integrity
        Field("shape_inverse", shape, "1/m^5", migrates=False, axes=symmetric(d)),
        Field("gradient", d * d, "1/s", migrates=False, axes=matrix(d)),  # velocity gradient
        Field("flux", d * d, "Pa/m^5", migrates=False, axes=matrix(d)),  # Z K^-1 / V
        Field("sums", 1 + shape + d * d, "", migrates=False),  # scratch of the geometry pass
    )


class Particles:
    """Arrays of `owned` points of this rank followed by `total - owned` ghosts, one attribute per field.

    Owned rows from `awake` on sleep, where points may (`periporo.core.motion.sleep`), and those from `stirred` on are
    in no pair that is listed, since only others that sleep are close to them; elsewhere both are `owned`.
    """

    def __init__(self, dimension: int):
        self.dimension = dimension
        self.components = component_count(dimension)
        self.dim = DIMENSION[dimension]
        self.fields: dict[str, Field] = {}
        self.awake = self.stirred = 0
        self.owned = 0
        self.total = 0
        for field in standard_fields(dimension):
            self.add_field(field)

    if TYPE_CHECKING:

        def __getattr__(self, name: str) -> np.ndarray:
            """Fields are attributes: type checkers take every other name for one."""

    def add_field(self, field: Field) -> None:
        """Declare a field, zero in every row. Raises ValueError if the name is taken."""
        if field.name in self.fields:
            raise ValueError(f"point field '{field.name}' is declared twice")
        self.fields[field.name] = field
        setattr(self, field.name, self._zeros(field, field.sparse))

    def keep(self, name: str) -> None:
        """Let a field that a step makes belong to its point from now on: it migrates, and is saved."""
        self.fields[name] = replace(self.fields[name], migrates=True)

    def own(self, name: str) -> np.ndarray:
        """The array of a sparse field, to be written to."""
        if not getattr(self, name).flags.writeable:
            setattr(self, name, self._zeros(self.fields[name], sparse=False))
        return getattr(self, name)

    def _zeros(self, field: Field, sparse: bool) -> np.ndarray:
        rows = self.total if field.sent else self.owned
        if sparse:
            return _nothing(rows, field.columns)
        return _aligned_zeros(rows if field.columns is None else (rows, field.columns), field.dtype)

    def note_pairs(self, *ends: np.ndarray) -> None:
        """Find which points are in no pair with these `ends`, rows of points."""
        if self.awake < self.owned:
            highest = [int(end[end < self.owned].max(initial=0)) for end in ends]
            self.stirred = min(max(self.awake, 1 + max(highest)), self.owned)

    def clear(self, array: np.ndarray) -> None:
        """Set the rows (total, ...) to zero of all points that pairs may have added to."""
        if self.stirred == self.owned:
            array.fill(0.0)
        else:
            array[: self.stirred] = 0.0
            array[self.owned :] = 0.0

    def present_volume(self) -> np.ndarray:
        """Volume (owned,) m^3 of the points after the last step."""
        return self.volume[: self.owned] * self.dilation

    def widths(self) -> np.ndarray:
        """Circumference (total,) m that points had as rings at the start; empty where they are none."""
        return getattr(self, RING) if RING in self.fields else _NO_WIDTHS

    def migrating(self) -> list[Field]:
        """Fields that belong to a point, in their order in a migration message."""
        return [f for f in self.fields.values() if f.migrates]

    def replace(self, owned: dict[str, np.ndarray], ghosts: int) -> None:
        """New owned rows by field name, sleepers last, with room for `ghosts` more; the other fields become zero.

        Fields are taken out of `owned` one by one, so that old and new rows are not there all at once.
        """
        self.owned = len(owned["id"])
        self.awake = self.owned - (int(np.count_nonzero(owned["asleep"])) if "asleep" in self.fields else 0)
        self.total = self.owned + ghosts
        self.stirred = self.owned
        for field in self.fields.values():
            given = owned.pop(field.name) if field.migrates else None
            empty = field.sparse and not (given is not None and given.flags.writeable and given.any())
            array = self._zeros(field, sparse=empty)
            if given is not None and not empty:
                array[: self.owned] = given
            setattr(self, field.name, array)

    def take(self, rows: np.ndarray | slice) -> dict[str, np.ndarray]:
        """The migrating fields of the owned `rows`."""
        return {f.name: picked(getattr(self, f.name), rows) for f in self.migrating()}


def depth_of_sleep(owned: dict[str, np.ndarray]) -> np.ndarray:
    """Of points by field (n,): 0 for those that are awake, 1 for sleepers close to others, 2 for those behind them."""
    return np.where(owned["asleep"] != 0, np.where(owned["guard"] != 0, 1, 2), 0)


def awake_first(owned: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Rows of points by field, those that sleep behind the others, the deepest last."""
    if "asleep" not in owned:
        return owned
    depth = depth_of_sleep(owned)
    if not (depth[:-1] > depth[1:]).any():
        return owned
    order = np.argsort(depth, kind="stable")
    return {name: picked(array, order) for name, array in owned.items()}


def picked(array: np.ndarray, rows: np.ndarray | slice) -> np.ndarray:
    """Some `rows` of a field; of zeros that take no memory zeros that take none."""
    if array.flags.writeable or isinstance(rows, slice):
        return array[rows]
    return _nothing(np.count_nonzero(rows) if rows.dtype == bool else len(rows), array.shape[1])


def joined(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Rows of a field and more of them; zeros take no memory if the first took none."""
    if first.flags.writeable or second.any():
        return np.concatenate([first, second])
    return _nothing(len(first) + len(second), first.shape[1])


def _nothing(rows, columns):
    return np.broadcast_to(np.zeros(columns), (rows, columns))


def rows_of(ids: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """For each of the `wanted` ids its row in `ids`, -1 where it is not there."""
    if len(ids) == 0:
        return np.full(len(wanted), -1)
    order = np.argsort(ids, kind="stable")  # a point before its images
    known = ids[order]
    place = np.minimum(np.searchsorted(known, wanted), len(ids) - 1)
    return np.where(known[place] == wanted, order[place], -1)


def _aligned_zeros(shape, dtype) -> np.ndarray:
    """Zeros that start where a cache line does, or a machine vector of a point might lie across two of them."""
    size = (shape if isinstance(shape, int) else math.prod(shape)) * np.dtype(dtype).itemsize
    raw = np.zeros(size + _CACHE_LINE, np.uint8)
    start = -raw.ctypes.data % _CACHE_LINE
    return raw[start : start + size].view(dtype).reshape(shape)
