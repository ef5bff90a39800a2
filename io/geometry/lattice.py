"""Bodies as sites of a lattice, in pieces of any size, so that no process needs all points.

A lattice covers the bounding box of a body with cells of one spacing. Site k has the global id
`first_id + k`; the last axis counts fastest. Points stand in the centres of the cells that lie inside.

Bodies that meet and bond continue the lattice of the first of them, so that there is no seam between them. A site
belongs to the first body that holds it; one that rounding puts outside of two bodies with a common edge, to the first.
"""

import math
from collections.abc import Iterator
from functools import cached_property

import numpy as np

from periporo.core.numerics.random_numbers import uniform
from periporo.io.geometry import rings
from periporo.io.geometry.layers import Layer, layer_of
from periporo.io.geometry.points import PointTable
from periporo.io.geometry.shapes import bounds, holds, inside, table
from periporo.io.schema.bodies import Body, Box, Cylinder, Disc, Points, Raster, Sphere
from periporo.io.schema.scene import SceneInput

CHUNK = 2**17  # sites looked at in one go

EDGE = 1e-6  # spacings within which a point lies on a bound

Sites = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]


class Lattice:
    """The sites of one body of a scene.

    `size` sites, numbered from the global id `first_id`; not every site lies inside the shape. `material` is the
    index of the body's material, `layers` lists (level, index) of those above, ascending. `company` are the bodies
    that share a lattice with this one, and itself, in the order of the scene; `round` is a shape filled with rings.
    """

    def __init__(self, scene: SceneInput, body: Body, company: "list[Lattice] | None" = None):
        self.body = body
        self.first_id = 0
        self.company = [] if company is None else company
        self.company.append(self)
        self.spacing = scene.spacing
        self.dimension = scene.dimension
        self.round = body.shape if body.lattice == "rings" and isinstance(body.shape, Disc | Cylinder) else None
        self.lower, self.upper = bounds(body.shape, scene.dimension)
        self.tolerance = EDGE * scene.spacing
        self._seed = scene.seed
        self._gravity = scene.vector(scene.gravity)
        names = list(scene.materials)
        self.material = names.index(body.material)
        self.layers = [(layer.above, names.index(layer.material)) for layer in body.layers]

    @cached_property
    def counts(self) -> tuple[int, ...]:
        """Cells along each axis; the rows of the table for points that have one."""
        if self.round is not None:
            return (rings.number(self.round, self.spacing),)
        if self.table is not None:
            return (len(self.table.positions),)
        if len(self.company) == 1:
            return self._own_counts
        last = self._cells_within(self.lower, self.upper)[1]
        return tuple(np.maximum(last - self._first_cell + 1, 0).tolist())

    @property
    def _own_counts(self):
        if self._columns is not None:
            across = (self.upper - self.lower)[:2]
            highest = max(1, round(self._columns.thickest / self.spacing))
            return *(max(1, round(float(side) / self.spacing)) for side in across), highest
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
        """Points whose places before jitter lie between two corners (d,) m, or on the edge; as `sites`."""
        if self.table is not None:
            x, edge = self.table.positions, self.tolerance
            return self._points(np.flatnonzero(((x >= lower - edge) & (x <= upper + edge)).all(axis=1)))
        first, last = (cells - self._first_cell for cells in self._cells_within(lower, upper))
        if self._columns is not None:
            first[2], last[2] = 0, self.counts[2]
        ranges = [
            np.arange(max(low, 0), min(high + 1, n), dtype=np.int64)
            for low, high, n in zip(first, last, self.counts, strict=True)
        ]
        index = np.zeros((1,), dtype=np.int64)
        for cells, n in zip(ranges, self.counts, strict=True):
            index = (index[:, None] * n + cells).ravel()
        sites = self._points(index)
        if self._columns is None:
            return sites
        z, edge = sites[1][:, 2], self.tolerance
        mine = (z >= lower[2] - edge) & (z <= upper[2] + edge)
        return sites[0][mine], sites[1][mine], sites[2][mine], sites[3][mine]

    def chunks(self) -> Iterator[Sites]:
        """All points in pieces."""
        for start in range(0, self.size, CHUNK):
            yield self.sites(start, start + CHUNK)

    def centres(self, cells: np.ndarray) -> np.ndarray:
        """Positions (n, d) m of the middles of `cells` (n, d), where points stand without jitter."""
        return self._placed(cells)[0]

    @cached_property
    def table(self) -> PointTable | None:
        """The points, where they stand in no cells: from a file, or on rings. Every process holds them all."""
        shape = self.body.shape
        if self.round is not None:
            return rings.table_of(self.round, self.spacing)
        return table(shape, self.dimension) if isinstance(shape, Points) else None

    @cached_property
    def _layer(self) -> Layer | None:
        return layer_of(self.body.shape) if isinstance(self.body.shape, Raster) else None

    @cached_property
    def _columns(self) -> Layer | None:
        """The layer whose ground each column of points begins on, if one does."""
        return self._layer if self._layer is not None and self._layer.conform else None

    def _cells_within(self, lower, upper):
        """First and last cells (d,) along each axis, counted from `_origin`, whose centres lie between two corners."""
        first = np.ceil((lower - self._origin) / self.spacing - 0.5 - EDGE)
        last = np.floor((upper - self._origin) / self.spacing - 0.5 + EDGE)
        most = 2.0**62
        return np.clip(first, -most, most).astype(np.int64), np.clip(last, -most, most).astype(np.int64)

    @cached_property
    def _first_cell(self) -> np.ndarray:
        """Number (d,) of the first cell along each axis."""
        if len(self.company) == 1:
            return np.zeros(self.dimension, np.int64)
        return self._cells_within(self.lower, self.upper)[0]

    @cached_property
    def _origin(self) -> np.ndarray:
        """Lower corner of cell 0, for the first of several bodies to share; round shapes keep their symmetry."""
        if self.company[0] is not self:
            return self.company[0]._origin
        shape, origin = self.body.shape, self.lower.copy()
        middle = (self.lower + self.upper - self.spacing * np.array(self._own_counts)) / 2.0
        if isinstance(shape, Disc | Sphere):
            return middle
        if isinstance(shape, Cylinder):
            along = "xyz".index(shape.axis)
            middle[along] = origin[along]
            return middle
        return origin

    def _points(self, index: np.ndarray) -> Sites:
        volumes = np.full(len(index), self.spacing**self.dimension)
        if self.table is not None:
            positions = self.table.positions[index]
            if self.table.volumes is not None:
                volumes = self.table.volumes[index]
        else:
            positions, mine = self._placed(np.stack(np.unravel_index(index, self.counts), axis=1))
            index, positions, volumes = index[mine], positions[mine], volumes[mine]
        materials = self._materials_at(positions)
        ids = index + self.first_id
        if self.body.jitter:
            shift = 2.0 * uniform(ids, self.dimension, self._seed) - 1.0
            positions = positions + self.body.jitter * self.spacing * shift
        return ids, positions, volumes, materials

    def _placed(self, cells: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Places (n, d) m of the middles of `cells` (n, d), and which of them hold points of the body (n,)."""
        positions = self._origin + (cells + self._first_cell + 0.5) * self.spacing
        if self._columns is None:
            return positions, self._owns(positions)
        return positions, self._stand(self._columns, positions, cells[:, 2])

    def _stand(self, layer: Layer, positions: np.ndarray, row: np.ndarray) -> np.ndarray:
        """Set points (n, 3) on the ground of a layer, the `row`-th (n,) of its column each; which there are, (n,)."""
        new = (np.diff(positions[:, :2], axis=0, prepend=np.nan) != 0.0).any(axis=1)
        begins = np.flatnonzero(new)
        column = np.repeat(np.arange(len(begins)), np.diff([*begins, len(positions)]))
        places = positions[begins]
        rows = np.rint(layer.thickness(places) / self.spacing)
        positions[:, 2] = layer.foot(places, self.spacing)[column] + row * self.spacing
        return row < rows[column]

    def contested(self, other: "Lattice", lower: np.ndarray, upper: np.ndarray) -> np.ndarray:
        """Places (n, d) of the sites between two corners that both bodies hold, not only on a common edge."""
        first, last = self._cells_within(lower, upper)
        cells = np.stack(np.meshgrid(*map(np.arange, first, last + 1), indexing="ij"), axis=-1)
        positions = self._origin + (cells.reshape(-1, self.dimension) + 0.5) * self.spacing
        both = [holds(lattice.body.shape, positions, -self.tolerance) for lattice in (self, other)]
        return positions[both[0] & both[1]]

    def _owns(self, positions: np.ndarray) -> np.ndarray:
        """Which of the body's cells with centres at `positions` (n, d) are its own, (n,) bool."""
        mine = inside(self.body.shape, positions)
        if self._layer is not None:  # cells that cut the ground are no places to stand
            mine[mine] &= positions[mine, 2] >= self._layer.foot(positions[mine], self.spacing) - self.tolerance
        if len(self.company) == 1:
            return mine
        lost = ~mine & holds(self.body.shape, positions, self.tolerance)  # on an edge, and perhaps in no body
        shared, before = np.zeros(len(positions), bool), True
        for other in self.company:
            if other is self:
                before = False
                continue
            near = holds(other.body.shape, positions, self.tolerance)
            theirs = near & inside(other.body.shape, positions)
            shared |= near
            lost &= ~(near if before else theirs)
            if before:
                mine &= ~theirs
        return mine | (lost & shared)

    def _materials_at(self, positions: np.ndarray) -> np.ndarray:
        materials = np.full(len(positions), self.material, dtype=np.int64)
        if self.layers:
            level = -positions @ (self._gravity / np.sqrt(np.sum(self._gravity**2)))
            for above, material in self.layers:
                materials[level >= above - self.tolerance] = material
        return materials


def build_lattices(scene: SceneInput) -> list[Lattice]:
    """A lattice for every body; their ids follow each other. Raises PointFileError."""
    companies: dict[int, list[Lattice]] = {}
    pairs = zip(scene.bodies, _companies(scene), strict=True)
    lattices = [Lattice(scene, body, companies.setdefault(first, [])) for body, first in pairs]
    first_id = 0
    for lattice in lattices:
        lattice.first_id = first_id
        first_id += lattice.size
    return lattices


def _companies(scene: SceneInput) -> list[int]:
    """For each body the first of those that it shares a lattice with: they meet, directly or by others, and bond."""
    touching, placed = scene.bodies_in_contact(), scene.placed_bodies()
    first = list(range(len(scene.bodies)))
    corners = [bounds(body.shape, scene.dimension) for body in scene.bodies]
    for k, body in enumerate(scene.bodies):
        alone = isinstance(body.shape, Points) or (isinstance(body.shape, Raster) and body.shape.conform)
        if body.lattice != "shared" or body.name in touching or body.name in placed or alone:
            corners[k] = np.full(scene.dimension, np.inf), np.full(scene.dimension, -np.inf)
        lower, upper = corners[k]
        for j in range(k):
            if (corners[j][0] <= upper + scene.spacing).all() and (corners[j][1] >= lower - scene.spacing).all():
                old, new = sorted((first[j], first[k]), reverse=True)
                first = [new if f == old else f for f in first]
    return first


def count_points(lattice: Lattice) -> int:
    """Number of points of a body."""
    if lattice.table is not None or (isinstance(lattice.body.shape, Box) and lattice.company[0] is lattice):
        return lattice.size
    return sum(len(ids) for ids, *_ in lattice.chunks())
