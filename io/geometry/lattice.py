"""Bodies as sites of a lattice, in pieces of any size, so that no process needs all points.

A lattice covers the bounding box of a body with cells of one spacing. Site k has the global id
`first_id + k`; the last axis counts fastest. Points stand in the centres of the cells that lie inside.
"""

import math
from collections.abc import Iterator
from functools import cached_property

import numpy as np

from periporo.core.numerics.random_numbers import uniform
from periporo.io.geometry.points import PointTable, read_points
from periporo.io.schema.bodies import Body, Box, Cylinder, Disc, Points, Polygon, Shape, Sphere
from periporo.io.schema.scene import SceneInput

CHUNK = 2**17  # sites looked at in one go

Sites = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]


class Lattice:
    """The sites of one body of a scene.

    `size` sites, numbered from the global id `first_id`; not every site lies inside the shape. `material` is the
    index of the body's material, `layers` lists (level, index) of those above, ascending.
    """

    def __init__(self, scene: SceneInput, body: Body, first_id: int = 0):
        self.body = body
        self.first_id = first_id
        self.spacing = scene.spacing
        self.dimension = scene.dimension
        self.lower, self.upper = _bounds(body.shape, scene.dimension)
        self._seed = scene.seed
        self._gravity = scene.vector(scene.gravity)
        names = list(scene.materials)
        self.material = names.index(body.material)
        self.layers = [(layer.above, names.index(layer.material)) for layer in body.layers]

    @cached_property
    def counts(self) -> tuple[int, ...]:
        """Cells along each axis; the rows of the file for points from a file."""
        if self._table is not None:
            return (len(self._table.positions),)
        return tuple(max(1, round(float(side) / self.spacing)) for side in self.upper - self.lower)

    @property
    def size(self) -> int:
        """Number of sites."""
        return math.prod(self.counts)

    def sites(self, start: int, stop: int) -> Sites:
        """Points among the sites `start` to `stop` (exclusive) of this lattice.

        Returns ids (n,) int64, positions (n, d) m, volumes (n,) m^d, indices (n,) into the scene's materials.
        """
        index = np.arange(max(start, 0), min(stop, self.size), dtype=np.int64)
        return self._points(index)

    def sites_within(self, lower: np.ndarray, upper: np.ndarray) -> Sites:
        """Points whose places before jitter lie between two corners (d,) m; as `sites`."""
        if self._table is not None:
            x = self._table.positions
            return self._points(np.flatnonzero(((x >= lower) & (x <= upper)).all(axis=1)))
        first = np.maximum(np.ceil((lower - self._origin) / self.spacing - 0.5), 0).astype(np.int64)
        last = np.floor((upper - self._origin) / self.spacing - 0.5).astype(np.int64)
        ranges = [
            np.arange(low, min(high + 1, n), dtype=np.int64)
            for low, high, n in zip(first, last, self.counts, strict=True)
        ]
        index = np.zeros((1,), dtype=np.int64)
        for cells, n in zip(ranges, self.counts, strict=True):
            index = (index[:, None] * n + cells).ravel()
        return self._points(index)

    def chunks(self) -> Iterator[Sites]:
        """All points in pieces."""
        for start in range(0, self.size, CHUNK):
            yield self.sites(start, start + CHUNK)

    @cached_property
    def _table(self) -> PointTable | None:
        shape = self.body.shape
        return read_points(shape.file, self.dimension) if isinstance(shape, Points) else None

    @cached_property
    def _origin(self) -> np.ndarray:
        """Lower corner of the first cell; round shapes keep their symmetry."""
        shape, origin = self.body.shape, self.lower.copy()
        middle = (self.lower + self.upper - self.spacing * np.array(self.counts)) / 2.0
        if isinstance(shape, Disc | Sphere):
            return middle
        if isinstance(shape, Cylinder):
            along = "xyz".index(shape.axis)
            middle[along] = origin[along]
            return middle
        return origin

    def _points(self, index: np.ndarray) -> Sites:
        volumes = np.full(len(index), self.spacing**self.dimension)
        if self._table is not None:
            positions = self._table.positions[index]
            if self._table.volumes is not None:
                volumes = self._table.volumes[index]
        else:
            cells = np.stack(np.unravel_index(index, self.counts), axis=1)
            positions = self._origin + (cells + 0.5) * self.spacing
            inside = _inside(self.body.shape, positions)
            index, positions, volumes = index[inside], positions[inside], volumes[inside]
        materials = self._materials_at(positions)
        ids = index + self.first_id
        if self.body.jitter:
            shift = 2.0 * uniform(ids, self.dimension, self._seed) - 1.0
            positions = positions + self.body.jitter * self.spacing * shift
        return ids, positions, volumes, materials

    def _materials_at(self, positions: np.ndarray) -> np.ndarray:
        materials = np.full(len(positions), self.material, dtype=np.int64)
        if self.layers:
            level = -positions @ (self._gravity / np.sqrt(np.sum(self._gravity**2)))
            for above, material in self.layers:
                materials[level >= above] = material
        return materials


def build_lattices(scene: SceneInput) -> list[Lattice]:
    """A lattice for every body; their ids follow each other."""
    lattices, first_id = [], 0
    for body in scene.bodies:
        lattices.append(Lattice(scene, body, first_id))
        first_id += lattices[-1].size
    return lattices


def count_points(lattice: Lattice) -> int:
    """Number of points of a body."""
    if isinstance(lattice.body.shape, Box | Points):
        return lattice.size
    return sum(len(ids) for ids, *_ in lattice.chunks())


def _bounds(shape: Shape, dimension: int) -> tuple[np.ndarray, np.ndarray]:
    """Lower and upper corner (d,) m of the box around a shape."""
    match shape:
        case Box():
            return np.array(shape.lower), np.array(shape.upper)
        case Disc() | Sphere():
            return np.array(shape.center) - shape.radius, np.array(shape.center) + shape.radius
        case Cylinder():
            base, along = np.array(shape.base), np.arange(3) == "xyz".index(shape.axis)
            lower = base - np.where(along, 0.0, shape.radius)
            return lower, base + np.where(along, shape.height, shape.radius)
        case Polygon():
            corners, extrude = np.array(shape.vertices), [[z] for z in shape.extrude or ()]
            sides = np.concatenate(
                [[corners.min(axis=0), corners.max(axis=0)], np.array(extrude or [[], []])], axis=1
            )
            return sides[0], sides[1]
        case Points():
            positions = read_points(shape.file, dimension).positions
            return positions.min(axis=0), positions.max(axis=0)


def _inside(shape: Shape, positions: np.ndarray) -> np.ndarray:
    """Which of `positions` (n, d) lie inside a shape, (n,) bool."""
    match shape:
        case Disc() | Sphere():
            return np.sum((positions - shape.center) ** 2, axis=1) <= shape.radius**2
        case Cylinder():
            across = [axis for axis in range(3) if "xyz"[axis] != shape.axis]
            return np.sum((positions - shape.base)[:, across] ** 2, axis=1) <= shape.radius**2
        case Polygon():
            return inside_polygon(np.array(shape.vertices), positions)
        case _:
            return np.ones(len(positions), dtype=bool)


def inside_polygon(corners: np.ndarray, positions: np.ndarray) -> np.ndarray:
    """Even-odd rule: a ray along x from an inner point crosses an odd number of edges."""
    x, y = positions[:, 0], positions[:, 1]
    inside = np.zeros(len(positions), dtype=bool)
    for (xa, ya), (xb, yb) in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        if ya != yb:
            spans = (ya > y) != (yb > y)
            inside ^= spans & (x < xa + (y - ya) * ((xb - xa) / (yb - ya)))
    return inside
