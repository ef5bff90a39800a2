"""A surface over the x-y plane, given by its heights at the places of a grid: each cell is two triangles.

Heights are `level` (ny, nx) m, rows along y from the lowest on, NaN where nothing is known; `corner` (2,) m is the
place of the first one, `cell` (2,) m the distance of neighbours. Beyond the border the surface goes on with the heights
of its border. Triangles are made on the way: nothing else is stored.
"""

import numpy as np

from periporo.core.numerics.facets import (
    LOOKS,
    MOST,
    PLAIN,
    TOLERANCE,
    TOUCHING,
    accept,
    begin,
    improve,
    must_look_again,
    offer,
    radius_of_others,
)  # fmt: skip
from periporo.core.numerics.jit import inlined, kernel


def height_at(level: np.ndarray, corner: np.ndarray, cell: np.ndarray, place: np.ndarray) -> np.ndarray:
    """Height (n,) m of the surface at each `place` (n, 2|3) m; NaN where it has none."""
    found, normal = np.empty(len(place)), np.empty((len(place), 3))
    _find_heights(level, corner, cell, np.ascontiguousarray(place), found, normal)
    return found


@inlined
def _at(level, i, j):
    """Height in column i, row j; beyond the border that of the border."""
    return level[min(max(j, 0), level.shape[0] - 1), min(max(i, 0), level.shape[1] - 1)]


@inlined
def _heights(level, corner, cell, place, found, normal):
    for n in range(place.shape[0]):
        u, v = (place[n, 0] - corner[0]) / cell[0], (place[n, 1] - corner[1]) / cell[1]
        i, j = int(np.floor(u)), int(np.floor(v))
        u, v = u - i, v - j
        low, high = _at(level, i, j), _at(level, i + 1, j + 1)
        if u >= v:
            side = _at(level, i + 1, j)
            along, across = side - low, high - side
        else:
            side = _at(level, i, j + 1)
            along, across = high - side, side - low
        found[n] = low + (along * u if u > 0.0 else 0.0) + (across * v if v > 0.0 else 0.0)  # on an edge, that edge's
        nx, ny = -along / cell[0], -across / cell[1]
        length = np.sqrt(nx * nx + ny * ny + 1.0)
        normal[n, 0], normal[n, 1], normal[n, 2] = nx / length, ny / length, 1.0 / length


@kernel
def _find_heights(level, corner, cell, place, found, normal):
    _heights(level, corner, cell, place, found, normal)


@kernel
def height_gap(level, corner, cell, holes, position, reach, within, gap, normal):
    """Fill how far balls of radius `reach` m at `position` (n, 3) are from the surface: gap (n,) m, normal (n, 3).

    A gap is that of the middle; the surface is looked for `within` m, beyond which a gap is infinite above it, and
    that of the plane right above it below. It is NaN right above or below `holes`, if there are any. See
    `core.numerics.facets`.
    """
    way, gaps, best, u = np.zeros((MOST, 3)), np.zeros(MOST), np.zeros(11), np.zeros(3)
    need, new = np.zeros(MOST), np.zeros(3)
    above, slope = np.zeros(1), np.zeros((1, 3))
    for n in range(position.shape[0]):
        x, y, z = position[n, 0], position[n, 1], position[n, 2]
        u[0] = u[1] = u[2] = 0.0
        normal[n, 0] = normal[n, 1] = normal[n, 2] = 0.0
        count, gap[n] = 0, np.inf
        for look in range(LOOKS):
            seen = reach if look == 0 else TOUCHING * reach
            y0, y1, y2 = x + u[0], y + u[1], z + u[2]
            count, radius = 0, within if look == 0 else TOUCHING * reach
            while count < MOST:
                begin(best, _way_down(level, corner, cell, y0, y1, y2) if count == 0 else np.inf)
                while True:
                    _scan(level, corner, cell, y0, y1, y2, seen, radius, way, gaps, count, best)
                    if not must_look_again(best):
                        break
                now = accept(best, reach, way, gaps, count)
                if now == count:
                    break
                count = now
                if not gaps[0] < seen:
                    break
                radius = radius_of_others(gaps[0], reach, seen, radius)
            if look == 0 and count > 0:
                gap[n] = gaps[0]
                for a in range(3):
                    normal[n, a] = way[0, a]
            if count == 0 or not gaps[0] < seen or (look == 0 and count == 1 and gaps[0] > PLAIN * reach):
                break
            if improve(way, gaps, count, reach, u, need, new):
                break
        size = np.sqrt(u[0] ** 2 + u[1] ** 2 + u[2] ** 2)
        if size > 0.0:
            gap[n] = reach - size
            for a in range(3):
                normal[n, a] = u[a] / size
        if gap[n] == np.inf or holes:
            _heights(level, corner, cell, position[n : n + 1], above, slope)
            if not z - above[0] > 0.0 and (gap[n] == np.inf or np.isnan(above[0])):
                gap[n] = (z - above[0]) * slope[0, 2]
                for a in range(3):
                    normal[n, a] = slope[0, a]


@inlined
def _way_down(level, corner, cell, x, y, z):
    """Way (m) to the surface right above or below, infinite where there is none."""
    u, v = (x - corner[0]) / cell[0], (y - corner[1]) / cell[1]
    if not np.isfinite(u + v):
        return np.inf
    i, j = int(np.floor(u)), int(np.floor(v))
    u, v = u - i, v - j
    low, high = _at(level, i, j), _at(level, i + 1, j + 1)
    side = _at(level, i + 1, j) if u >= v else _at(level, i, j + 1)
    way = abs(z - low - max(u, v) * (side - low) - min(u, v) * (high - side))
    return way if np.isfinite(way) else np.inf


@inlined
def _scan(level, corner, cell, x, y, z, reach, radius, way, gap, count, best):
    """Offer both triangles of every cell in reach."""
    small = 2.0 * TOLERANCE * reach
    radius = min(radius, best[8] + small)
    first = int(np.floor((x - radius - corner[0]) / cell[0]))
    last = int(np.floor((x + radius - corner[0]) / cell[0]))
    low, high = int(np.floor((y - radius - corner[1]) / cell[1])), int(np.floor((y + radius - corner[1]) / cell[1]))
    for j in range(low, high + 1):
        y0 = corner[1] + j * cell[1]
        y1 = corner[1] + (j + 1) * cell[1]
        dy = max(max(y0 - y, y - y1), 0.0)
        for i in range(first, last + 1):
            x0 = corner[0] + i * cell[0]
            x1 = corner[0] + (i + 1) * cell[0]
            a, b, c, d = _at(level, i, j), _at(level, i + 1, j), _at(level, i + 1, j + 1), _at(level, i, j + 1)
            dx = max(max(x0 - x, x - x1), 0.0)
            dz = max(max(min(min(a, b), min(c, d)) - z, z - max(max(a, b), max(c, d))), 0.0)
            farthest = min(radius, best[8] + small)
            if dx * dx + dy * dy + dz * dz > farthest * farthest:
                continue
            if not np.isnan(a + b + c):
                offer(x, y, z, x0, y0, a, x1, y0, b, x1, y1, c, 0, reach, radius, way, gap, count, best)
            if not np.isnan(a + c + d):
                offer(x, y, z, x0, y0, a, x1, y1, c, x0, y1, d, 0, reach, radius, way, gap, count, best)
