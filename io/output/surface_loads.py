"""What an obstacle bears along its surface: the forces of points on it, spread over what they stand for."""

from dataclasses import dataclass

import numpy as np

from periporo.core.numerics.cells import POLY_LINE

_PARTS = 2.0  # places a spacing
_SPREAD = 4  # places to either side, over which a force is spread
_CORNER = np.cos(np.radians(20.0))  # edges that turn by more meet in a corner


@dataclass(frozen=True)
class SurfaceLoad:
    """Load on an obstacle at places along its surface, (k,) m `along` it, `place` (k, 3) m, and `force` (k, 3).

    In the plane along its outline, force per area, Pa, with the outward `normal` (k, 3) and the `tangent` (k, 3); along
    an axis force per length, N/m, without.
    """

    along: np.ndarray
    place: np.ndarray
    force: np.ndarray
    normal: np.ndarray | None = None
    tangent: np.ndarray | None = None

    @property
    def pressure(self) -> np.ndarray | None:
        """Pressure of the soil (k,) Pa, positive."""
        return None if self.normal is None else -(self.force * self.normal).sum(axis=1)

    @property
    def shear(self) -> np.ndarray | None:
        """Shear stress on the obstacle (k,) Pa, positive in the direction in which `along` grows."""
        return None if self.tangent is None else (self.force * self.tangent).sum(axis=1)


def along_axis(corners: np.ndarray, axis: int, places: np.ndarray, forces: np.ndarray, spacing: float) -> SurfaceLoad:
    """Force per length along an axis (0, 1, 2) of an obstacle with these corners (n, 3) m.

    places (m, 3) m of points, and their forces (m, 3) N on it.
    """
    lower, upper = corners.min(axis=0), corners.max(axis=0)
    middle, found = _spread(places[:, axis] - lower[axis], forces, upper[axis] - lower[axis], spacing, closed=False)
    place = np.tile(0.5 * (lower + upper), (len(middle), 1))
    place[:, axis] = lower[axis] + middle
    return SurfaceLoad(place[:, axis].copy(), place, found)


def along_outline(
    outline: tuple[int, np.ndarray], places: np.ndarray, forces: np.ndarray, spacing: float, rings: bool
) -> SurfaceLoad:
    """Force per area along an outline in the plane: VTK's kind of cell, and corners (n, 3) m.

    places (m, 3) m of points, and their forces (m, 3) N on it; of `rings` those of the whole circle.
    """
    kind, corners = outline
    vertices = corners[:, :2]
    closed = len(vertices) > 2 and (kind != POLY_LINE or bool((vertices[0] == vertices[-1]).all()))
    if closed and not (vertices[0] == vertices[-1]).all():
        vertices = np.concatenate([vertices, vertices[:1]])
    edges = np.diff(vertices, axis=0)
    length = np.sqrt((edges**2).sum(axis=1))
    direction = edges / length[:, None]
    if rings:  # as in space: what is on one side of the axis is on the other, too
        mirror = np.array([-1.0, 1.0, 1.0])
        places, forces = np.concatenate([places, places * mirror]), np.concatenate([forces, forces * mirror])
    edge, foot = _nearest(vertices[:-1], direction, length, places[:, :2])
    out = direction[:, ::-1] * ([-1.0, 1.0] if kind == POLY_LINE else [1.0, -1.0])
    parts, start = [], np.concatenate([[0.0], np.cumsum(length)])
    for first, last, round_ in _sides(direction, closed):
        own = np.arange(first, last) % len(edges)
        before = np.concatenate([[0.0], np.cumsum(length[own])])
        at = {int(e): k for k, e in enumerate(own)}
        mine = np.isin(edge, own)
        reach = np.array([before[at[int(e)]] for e in edge[mine]]) + foot[mine]
        middle, found = _spread(reach, forces[mine], before[-1], spacing, closed=round_)
        k = np.clip(np.searchsorted(before, middle) - 1, 0, len(own) - 1)
        place = vertices[own[k]] + (middle - before[k])[:, None] * direction[own[k]]
        parts.append((start[own[k]] + middle - before[k], place, found, out[own[k]], direction[own[k]]))
    along, place, found, *ways = (np.concatenate(part) for part in zip(*parts, strict=True))
    order = np.argsort(along)
    if rings:
        order = order[place[order, 0] > 0.0]
        found = found / (2.0 * np.pi * place[:, :1])
    place, normal, tangent = (np.pad(rows[order], ((0, 0), (0, 1))) for rows in (place, *ways))
    return SurfaceLoad(along[order], place, found[order], normal, tangent)


def _sides(direction, closed):
    """First edge, last but one, and whether it has no end, of what lies between corners."""
    n = len(direction)
    turns = np.flatnonzero((direction * np.roll(direction, 1, axis=0)).sum(axis=1) < _CORNER)  # before these edges
    if not closed:
        turns = np.union1d(turns, [0])
        return [(int(a), int(b), False) for a, b in zip(turns, [*turns[1:], n], strict=True)]
    if not len(turns):
        return [(0, n, True)]
    return [(int(a), int(b), False) for a, b in zip(turns, [*turns[1:], turns[0] + n], strict=True)]


def _nearest(start, direction, length, places):
    """The nearest edge (m,) of each place, and the way (m,) m along it to its foot."""
    edge, foot, least = np.zeros(len(places), np.int64), np.zeros(len(places)), np.full(len(places), np.inf)
    for e in range(len(start)):
        way = np.clip((places - start[e]) @ direction[e], 0.0, length[e])
        distance = ((places - start[e] - way[:, None] * direction[e]) ** 2).sum(axis=1)
        nearer = distance < least
        edge[nearer], foot[nearer], least[nearer] = e, way[nearer], distance[nearer]
    return edge, foot


def _spread(at, forces, length, spacing, closed):
    """Places (k,) m on a side of that `length`, and force per length (k, 3) there of forces `at` (m,) m.

    By hats that join at the ends of a closed side, and come back from those of others: their sum is that of the forces.
    """
    count = max(int(np.ceil(_PARTS * length / spacing)), _SPREAD)
    step = length / count
    middle = step * (np.arange(count) + 0.5)
    found = np.zeros((count, forces.shape[1]))
    for turn in (-1, 0, 1):
        images = (at + turn * length,) if closed else (at + 2 * turn * length, 2 * turn * length - at)
        for image in images:
            away = np.abs(middle[:, None] - image) / (_SPREAD * step)
            found += np.maximum(1.0 - away, 0.0) @ forces / (_SPREAD * step)
    return middle, found
