"""Rigid ground of any shape: heights on a grid, or a surface of triangles.

What a point meets is the nearest way out of it, see `periporo.core.numerics.facets`: at an edge that runs in both
faces, at one that sticks out the nearest, and nothing of the seams of a plane.
"""

import numpy as np

from periporo.contact.surfaces import unbounded
from periporo.core.numerics.cells import POLYGON, QUAD
from periporo.core.numerics.heights import height_at, height_gap
from periporo.core.numerics.meshes import TriangleTree, mesh_gap

_FINEST = 100  # cells of a drawing along each axis
_AROUND = 4.0  # times as far as other obstacles are drawn: soil comes far on a slope


class HeightField:
    """Ground below heights on a grid, see `periporo.core.numerics.heights`.

    `reach` m within which a point touches; the surface is looked for `within` m of a point.
    """

    def __init__(self, level, corner, cell, *, reach, within):
        self.level, self.corner, self.cell = level, corner, cell
        self.reach, self.within = reach, within
        self._holes = bool(np.isnan(level).any())

    def gap(self, position):
        """See `Surface.gap`; NaN over a hole."""
        gap, normal = np.empty(len(position)), np.empty((len(position), 3))
        height_gap(
            self.level, self.corner, self.cell, self._holes, np.ascontiguousarray(position), self.reach, self.within,
            gap, normal,
        )  # fmt: skip
        return gap, normal

    def bounds(self):
        """See `Surface.bounds`; it goes on beyond its border."""
        return unbounded(3)

    def outline(self, middle, size):
        """See `Surface.outline`; of a fine grid some of the heights."""
        picked, size = [], _AROUND * size
        for a, count in ((0, self.level.shape[1]), (1, self.level.shape[0])):
            ends = (middle[a] + np.array([-size, size]) - self.corner[a]) / self.cell[a]
            low, high = np.clip([np.floor(ends[0]), np.ceil(ends[1])], 0, count - 1).astype(int)
            picked.append(np.unique(np.linspace(low, high, min(high - low, _FINEST) + 1).astype(int)))
        columns, rows = picked
        x, y = np.meshgrid(*(self.corner[a] + p * self.cell[a] for a, p in enumerate(picked)))
        points = np.stack([x, y, self.level[np.ix_(rows, columns)]], axis=-1)
        number = np.arange(x.size).reshape(x.shape)
        quads = np.stack([number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]], axis=-1).reshape(-1, 4)
        return _known(points.reshape(-1, 3), quads, QUAD)


class TriangleSurface:
    """Ground behind triangles, see `periporo.core.numerics.meshes`; `reach` and `within` as those of `HeightField`."""

    def __init__(self, tree: TriangleTree, *, reach, within):
        self.tree, self.reach, self.within = tree, reach, within

    def gap(self, position):
        """See `Surface.gap`; infinite where no triangle is near."""
        gap, normal = np.empty(len(position)), np.empty((len(position), 3))
        tree = self.tree
        mesh_gap(
            tree.corners, tree.triangles, tree.borders, tree.boxes, np.ascontiguousarray(position),
            self.reach, self.within, gap, normal,
        )  # fmt: skip
        return gap, normal

    def bounds(self):
        """See `Surface.bounds`."""
        return self.tree.corners.min(axis=0) - self.within, self.tree.corners.max(axis=0) + self.within

    def outline(self, middle, size):
        """See `Surface.outline`; corners of a fine surface are drawn together."""
        corners, size = self.tree.corners, _AROUND * size
        near = (np.abs(corners - middle) <= size).all(axis=1)[self.tree.triangles].any(axis=1)
        triangles = self.tree.triangles[near]
        if len(triangles) > 2 * _FINEST**2:
            side = np.ptp(corners[triangles].reshape(-1, 3), axis=0).max() / _FINEST
            cell = np.floor((corners - middle) / side).astype(np.int64)
            _, first, cluster = np.unique(cell, axis=0, return_index=True, return_inverse=True)
            triangles = first[cluster.ravel()[triangles]]
            whole = (triangles != np.roll(triangles, 1, axis=1)).all(axis=1)
            triangles = np.unique(triangles[whole], axis=0)
        used, rows = np.unique(triangles, return_inverse=True)
        return _known(corners[used], rows.reshape(-1, 3), POLYGON)


class FrictionMap:
    """Coefficients of friction on a grid, as those of `periporo.core.numerics.heights`."""

    def __init__(self, level, corner, cell):
        self._level, self._corner, self._cell = level, corner, cell

    def at(self, place: np.ndarray) -> np.ndarray:
        """Coefficients (n,) at each `place` (n, 3) m."""
        return height_at(self._level, self._corner, self._cell, place)


def _known(points, cells, kind):
    """The outline of those cells whose corners are all known."""
    known = ~np.isnan(points[cells]).any(axis=(1, 2))
    used, rows = np.unique(cells[known], return_inverse=True)
    return points[used], [(kind, row) for row in rows.reshape(-1, cells.shape[1])]
