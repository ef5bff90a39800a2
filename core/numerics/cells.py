"""Cells in space, as VTK has them: how obstacles are drawn."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

EMPTY, VERTEX, LINE, POLY_LINE, POLYGON, QUAD, HEXAHEDRON = 0, 1, 3, 4, 7, 9, 12
"""VTK's numbers of kinds of cells."""

Outline = tuple[np.ndarray, list[tuple[int, Sequence[int]]]]
"""Points (n, d) m, and cells between them: their kinds and rows of points."""


@dataclass(frozen=True)
class Cells:
    """`points` (n, 3) m, the `number` (n,) of the thing that each belongs to, `connectivity` (m,) rows of points,
    `offsets` (cells + 1,) into it, and `types` (cells,)."""

    points: np.ndarray
    number: np.ndarray
    connectivity: np.ndarray
    offsets: np.ndarray
    types: np.ndarray

    @property
    def counts(self) -> tuple[int, int, int]:
        """Points, cells and entries of the connectivity."""
        return len(self.points), len(self.types), len(self.connectivity)

    def split(self) -> list[tuple[int, int, np.ndarray]]:
        """Number, kind and points (k, 3) m of each cell."""
        rows = np.split(self.connectivity, self.offsets[1:-1])
        cells = zip(rows, self.types.tolist(), strict=True)
        return [(int(self.number[row[0]]), kind, self.points[row]) for row, kind in cells if len(row)]


def joined(outlines: dict[int, Outline]) -> Cells:
    """The outlines of things by their numbers as cells; of none, one empty cell.

    A part without any cell is read as one of -1 cells by VTK 9.5 and 9.6.
    """
    points, number, rows, types = [np.zeros((0, 3))], [np.zeros(0, np.int64)], [], []
    for key, (places, cells) in outlines.items():
        start = sum(map(len, points))
        points.append(np.pad(places, ((0, 0), (0, 3 - places.shape[1]))))
        number.append(np.full(len(places), key))
        rows += [start + np.asarray(r) for _, r in cells]
        types += [kind for kind, _ in cells]
    if not types:
        rows, types = [np.zeros(0, np.int64)], [EMPTY]
    return Cells(
        np.concatenate(points), np.concatenate(number), np.concatenate(rows).astype(np.int64),
        np.cumsum([0, *map(len, rows)]), np.array(types, np.uint8),
    )  # fmt: skip


def drawn(cells: Cells | None) -> Cells:
    """The cells of what is drawn, also if there is nothing to draw."""
    return joined({}) if cells is None else cells
