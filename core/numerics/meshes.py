"""A surface of triangles anywhere in space, found through a tree of boxes.

The triangles stand in the order of a curve through space (Morton 1966), so that rows that follow each other are
neighbours. Node k of the tree has the children 2 k and 2 k + 1; the last half are leaves with a few rows each.
"""

from dataclasses import dataclass

import numpy as np

from periporo.core.numerics.facets import LOOKS, MOST, PLAIN, TOLERANCE, TOUCHING, accept, improve, offer
from periporo.core.numerics.jit import inlined, kernel

_LEAF = 4  # triangles
_BITS = 20  # of a place along each axis, in the order of the curve


@dataclass(frozen=True)
class TriangleTree:
    """`corners` (n, 3) m, `triangles` (m, 3) rows of them, counterclockwise seen from outside, `borders` (m,) with the
    bits of `core.numerics.facets.offer`; boxes of the nodes: `lower`, `upper` (2 leaves, 3) m."""

    corners: np.ndarray
    triangles: np.ndarray
    borders: np.ndarray
    lower: np.ndarray
    upper: np.ndarray


def plant(corners: np.ndarray, triangles: np.ndarray, borders: np.ndarray) -> TriangleTree:
    """The tree over `triangles` (m, 3) with the given `corners` (n, 3) and `borders` (m,), m > 0."""
    low, high = corners.min(axis=0), corners.max(axis=0)
    middle = corners[triangles].mean(axis=1)
    place = ((middle - low) / max(float((high - low).max()), 1e-300) * (2**_BITS - 1)).astype(np.int64)
    key = np.zeros(len(triangles), np.int64)
    _interleave(place, key)
    order = np.argsort(key, kind="stable")
    triangles, borders = np.ascontiguousarray(triangles[order], np.int64), np.ascontiguousarray(borders[order])
    leaves = 1 << max(int(np.ceil(np.log2(len(triangles) / _LEAF))), 0)
    lower, upper = np.full((2 * leaves, 3), np.inf), np.full((2 * leaves, 3), -np.inf)
    _grow(corners, triangles, lower, upper)
    return TriangleTree(np.ascontiguousarray(corners), triangles, borders, lower, upper)


@kernel
def _interleave(place, key):
    for n in range(place.shape[0]):
        for bit in range(_BITS):
            for a in range(3):
                key[n] |= ((place[n, a] >> bit) & 1) << (3 * bit + a)


@kernel
def _grow(corners, triangles, lower, upper):
    leaves, count = lower.shape[0] // 2, triangles.shape[0]
    for leaf in range(leaves):
        for t in range(leaf * count // leaves, (leaf + 1) * count // leaves):
            for c in range(3):
                for a in range(3):
                    x = corners[triangles[t, c], a]
                    lower[leaves + leaf, a] = min(lower[leaves + leaf, a], x)
                    upper[leaves + leaf, a] = max(upper[leaves + leaf, a], x)
    for node in range(leaves - 1, 0, -1):
        for a in range(3):
            lower[node, a] = min(lower[2 * node, a], lower[2 * node + 1, a])
            upper[node, a] = max(upper[2 * node, a], upper[2 * node + 1, a])


@kernel
def mesh_gap(corners, triangles, borders, lower, upper, position, reach, within, gap, normal):
    """Fill how far balls of radius `reach` m at `position` (n, 3) are from the surface: gap (n,) m, normal (n, 3).

    As `core.numerics.heights.height_gap`, but infinite wherever nothing is `within`.
    """
    way, gaps, best, u = np.zeros((MOST, 3)), np.zeros(MOST), np.zeros(8), np.zeros(3)
    need, new = np.zeros(MOST), np.zeros(3)
    waiting = np.zeros(128, np.int64)
    for n in range(position.shape[0]):
        x, y, z = position[n, 0], position[n, 1], position[n, 2]
        normal[n, 0] = normal[n, 1] = normal[n, 2] = 0.0
        u[0] = u[1] = u[2] = 0.0
        count, gap[n] = 0, np.inf
        for look in range(LOOKS):
            seen = reach if look == 0 else TOUCHING * reach
            y0, y1, y2 = x + u[0], y + u[1], z + u[2]
            count, radius = 0, TOUCHING * reach
            while count < MOST:
                best[3], best[4] = np.inf, 0.0
                _scan(
                    corners, triangles, borders, lower, upper, y0, y1, y2, seen, radius, way, gaps, count, best,
                    waiting,
                )  # fmt: skip
                now = accept(best, reach, way, gaps, count)
                if now == count and count == 0 and look == 0 and radius < within:
                    radius = within  # nothing is near: look farther
                    continue
                if now == count:
                    break
                count = now
                if not gaps[0] < seen:
                    break
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
        if not np.isfinite(x + y + z):
            gap[n] = np.nan


@inlined
def _scan(corners, triangles, borders, lower, upper, x, y, z, reach, radius, way, gap, count, best, waiting):
    """Offer the triangles of every leaf in reach."""
    leaves, total = lower.shape[0] // 2, triangles.shape[0]
    waiting[0], depth = 1, 1
    while depth > 0:
        depth -= 1
        node = waiting[depth]
        dx = max(max(lower[node, 0] - x, x - upper[node, 0]), 0.0)
        dy = max(max(lower[node, 1] - y, y - upper[node, 1]), 0.0)
        dz = max(max(lower[node, 2] - z, z - upper[node, 2]), 0.0)
        nearest = min(radius, best[3] + 2.0 * TOLERANCE * reach)
        if not dx * dx + dy * dy + dz * dz <= nearest * nearest:
            continue
        if node < leaves:
            waiting[depth], waiting[depth + 1] = 2 * node, 2 * node + 1
            depth += 2
            continue
        leaf = node - leaves
        for t in range(leaf * total // leaves, (leaf + 1) * total // leaves):
            i, j, k = triangles[t, 0], triangles[t, 1], triangles[t, 2]
            offer(
                x, y, z, corners[i, 0], corners[i, 1], corners[i, 2], corners[j, 0], corners[j, 1], corners[j, 2],
                corners[k, 0], corners[k, 1], corners[k, 2], borders[t], reach, radius, way, gap, count, best,
            )  # fmt: skip


@kernel
def windings(corners, triangles, lower, upper, position, count):
    """Fill how often the surface lies around each `position` (n, 3): once inside of a closed one, count (n,).

    By what a ray along z crosses above, upwards less downwards. An edge that it meets belongs to one of two triangles.
    """
    leaves, total = lower.shape[0] // 2, triangles.shape[0]
    waiting = np.zeros(128, np.int64)
    for n in range(position.shape[0]):
        x, y, z = position[n, 0], position[n, 1], position[n, 2]
        waiting[0], depth = 1, 1
        count[n] = 0
        while depth > 0:
            depth -= 1
            node = waiting[depth]
            if not (
                lower[node, 0] <= x <= upper[node, 0] and lower[node, 1] <= y <= upper[node, 1] and z <= upper[node, 2]
            ):
                continue
            if node < leaves:
                waiting[depth], waiting[depth + 1] = 2 * node, 2 * node + 1
                depth += 2
                continue
            leaf = node - leaves
            for t in range(leaf * total // leaves, (leaf + 1) * total // leaves):
                count[n] += _crossing(corners, triangles[t], x, y, z)


@inlined
def _crossing(corners, triangle, x, y, z):
    """1 if a ray upwards leaves through a triangle, -1 if it enters, 0 if it misses."""
    odd = False
    for e in range(3):
        i, j = triangle[e], triangle[(e + 1) % 3]
        if i > j:
            i, j = j, i  # the same numbers for both triangles of an edge
        if (corners[i, 1] > y) != (corners[j, 1] > y):
            share = (y - corners[i, 1]) / (corners[j, 1] - corners[i, 1])
            odd = odd != (x < corners[i, 0] + share * (corners[j, 0] - corners[i, 0]))
    if not odd:
        return 0
    i, j, k = triangle[0], triangle[1], triangle[2]
    nx = (corners[j, 1] - corners[i, 1]) * (corners[k, 2] - corners[i, 2])
    nx -= (corners[j, 2] - corners[i, 2]) * (corners[k, 1] - corners[i, 1])
    ny = (corners[j, 2] - corners[i, 2]) * (corners[k, 0] - corners[i, 0])
    ny -= (corners[j, 0] - corners[i, 0]) * (corners[k, 2] - corners[i, 2])
    nz = (corners[j, 0] - corners[i, 0]) * (corners[k, 1] - corners[i, 1])
    nz -= (corners[j, 1] - corners[i, 1]) * (corners[k, 0] - corners[i, 0])
    if nz == 0.0:
        return 0
    height = corners[i, 2] - (nx * (x - corners[i, 0]) + ny * (y - corners[i, 1])) / nz
    if height <= z:
        return 0
    return 1 if nz > 0.0 else -1
