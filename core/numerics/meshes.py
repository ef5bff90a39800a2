"""A surface of triangles anywhere in space, found through a tree of boxes.

Node k of the tree has the children 2 k and 2 k + 1, each with half of its triangles on one side of a plane; the last
half are leaves with a few triangles each, which stand in the order of the leaves.
"""

from dataclasses import dataclass

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

_LEAF = 4  # triangles


@dataclass(frozen=True)
class TriangleTree:
    """`corners` (n, 3) m, `triangles` (m, 3) rows of them, counterclockwise seen from outside, `borders` (m,) with the
    bits of `core.numerics.facets.offer`; `boxes` (2 leaves, 2, 3) m: lower and upper corners of the nodes."""

    corners: np.ndarray
    triangles: np.ndarray
    borders: np.ndarray
    boxes: np.ndarray


def plant(corners: np.ndarray, triangles: np.ndarray, borders: np.ndarray) -> TriangleTree:
    """The tree over `triangles` (m, 3) with the given `corners` (n, 3) and `borders` (m,), m > 0."""
    leaves = 1 << max(int(np.ceil(np.log2(len(triangles) / _LEAF))), 0)
    order = np.arange(len(triangles))
    _halve(corners[triangles].mean(axis=1), order, leaves)
    triangles, borders = np.ascontiguousarray(triangles[order], np.int64), np.ascontiguousarray(borders[order])
    boxes = np.empty((2 * leaves, 2, 3))
    boxes[:, 0], boxes[:, 1] = np.inf, -np.inf
    _grow(corners, triangles, boxes)
    return TriangleTree(np.ascontiguousarray(corners), triangles, borders, boxes)


@kernel
def _halve(middle, order, leaves):
    """Put rows of `middle` (m, 3) into an `order` in which each node has the half of its parent on one side of a plane.

    The plane lies across the longest side of the box around the parent's middles.
    """
    count, level = order.shape[0], 1
    low, high = np.empty(3), np.empty(3)
    while level < leaves:
        span = leaves // level
        for k in range(level):
            first, last = k * span * count // leaves, (k + 1) * span * count // leaves
            low[:], high[:] = np.inf, -np.inf
            for n in range(first, last):
                for a in range(3):
                    low[a], high[a] = min(low[a], middle[order[n], a]), max(high[a], middle[order[n], a])
            axis = 0
            for a in range(1, 3):
                if high[a] - low[a] > high[axis] - low[axis]:
                    axis = a
            _select(middle, axis, order, first, last, (2 * k + 1) * (span // 2) * count // leaves)
        level *= 2


@inlined
def _select(middle, axis, order, first, last, split):
    """Order rows so that none before `split` lies behind one after it."""
    low, high = first, last - 1
    while low < high:
        pivot = middle[order[(low + high) // 2], axis]
        i, j = low, high
        while i <= j:
            while middle[order[i], axis] < pivot:
                i += 1
            while middle[order[j], axis] > pivot:
                j -= 1
            if i <= j:
                order[i], order[j] = order[j], order[i]
                i += 1
                j -= 1
        if split <= j:
            high = j
        elif split >= i:
            low = i
        else:
            return


@kernel
def _grow(corners, triangles, boxes):
    leaves, count = boxes.shape[0] // 2, triangles.shape[0]
    for leaf in range(leaves):
        for t in range(leaf * count // leaves, (leaf + 1) * count // leaves):
            for c in range(3):
                for a in range(3):
                    x = corners[triangles[t, c], a]
                    boxes[leaves + leaf, 0, a] = min(boxes[leaves + leaf, 0, a], x)
                    boxes[leaves + leaf, 1, a] = max(boxes[leaves + leaf, 1, a], x)
    for node in range(leaves - 1, 0, -1):
        for a in range(3):
            boxes[node, 0, a] = min(boxes[2 * node, 0, a], boxes[2 * node + 1, 0, a])
            boxes[node, 1, a] = max(boxes[2 * node, 1, a], boxes[2 * node + 1, 1, a])


@kernel
def mesh_gap(corners, triangles, borders, boxes, position, reach, within, gap, normal):
    """Fill how far balls of radius `reach` m at `position` (n, 3) are from the surface: gap (n,) m, normal (n, 3).

    As `core.numerics.heights.height_gap`, but infinite wherever nothing is `within`.
    """
    way, gaps, best, u = np.zeros((MOST, 3)), np.zeros(MOST), np.zeros(11), np.zeros(3)
    need, new = np.zeros(MOST), np.zeros(3)
    waiting, apart = np.zeros(128, np.int64), np.zeros(128)
    for n in range(position.shape[0]):
        x, y, z = position[n, 0], position[n, 1], position[n, 2]
        normal[n, 0] = normal[n, 1] = normal[n, 2] = 0.0
        u[0] = u[1] = u[2] = 0.0
        count, gap[n] = 0, np.inf
        for look in range(LOOKS):
            seen = reach if look == 0 else TOUCHING * reach
            y0, y1, y2 = x + u[0], y + u[1], z + u[2]
            count, radius = 0, within if look == 0 else TOUCHING * reach
            while count < MOST:
                begin(best, np.inf)
                while True:
                    _scan(
                        corners, triangles, borders, boxes, y0, y1, y2, seen, radius, way, gaps, count, best, waiting,
                        apart,
                    )  # fmt: skip
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
        if not np.isfinite(x + y + z):
            gap[n] = np.nan


@inlined
def _square(boxes, node, x, y, z):
    """Square of the distance from the box of a node."""
    dx = max(max(boxes[node, 0, 0] - x, x - boxes[node, 1, 0]), 0.0)
    dy = max(max(boxes[node, 0, 1] - y, y - boxes[node, 1, 1]), 0.0)
    dz = max(max(boxes[node, 0, 2] - z, z - boxes[node, 1, 2]), 0.0)
    return dx * dx + dy * dy + dz * dz


@inlined
def _scan(corners, triangles, borders, boxes, x, y, z, reach, radius, way, gap, count, best, waiting, apart):
    """Offer the triangles that may be in reach, of near boxes first; `waiting` and `apart` are scratch (levels,)."""
    leaves, total = boxes.shape[0] // 2, triangles.shape[0]
    small = 2.0 * TOLERANCE * reach
    waiting[0], apart[0], depth = 1, 0.0, 1
    while depth > 0:
        depth -= 1
        node, square = waiting[depth], apart[depth]
        farthest = min(radius, best[8] + small) ** 2
        while node < leaves and square <= farthest:
            near, far = 2 * node, 2 * node + 1
            square, other = _square(boxes, near, x, y, z), _square(boxes, far, x, y, z)
            if other < square:
                near, far, square, other = far, near, other, square
            if other <= farthest:
                waiting[depth], apart[depth] = far, other
                depth += 1
            node = near
        if not square <= farthest:
            continue
        leaf = node - leaves
        for t in range(leaf * total // leaves, (leaf + 1) * total // leaves):
            i, j, k = triangles[t, 0], triangles[t, 1], triangles[t, 2]
            square = 0.0
            for a, place in enumerate((x, y, z)):
                low = min(min(corners[i, a], corners[j, a]), corners[k, a])
                high = max(max(corners[i, a], corners[j, a]), corners[k, a])
                square += max(max(low - place, place - high), 0.0) ** 2
            if square > min(radius, best[8] + small) ** 2:
                continue
            offer(
                x, y, z, corners[i, 0], corners[i, 1], corners[i, 2], corners[j, 0], corners[j, 1], corners[j, 2],
                corners[k, 0], corners[k, 1], corners[k, 2], borders[t], reach, radius, way, gap, count, best,
            )  # fmt: skip


@kernel
def windings(corners, triangles, boxes, position, count):
    """Fill how often the surface lies around each `position` (n, 3): once inside of a closed one, count (n,).

    By what a ray along z crosses above, upwards less downwards. An edge that it meets belongs to one of two triangles.
    """
    leaves, total = boxes.shape[0] // 2, triangles.shape[0]
    waiting = np.zeros(128, np.int64)
    for n in range(position.shape[0]):
        x, y, z = position[n, 0], position[n, 1], position[n, 2]
        waiting[0], depth = 1, 1
        count[n] = 0
        while depth > 0:
            depth -= 1
            node = waiting[depth]
            if not (
                boxes[node, 0, 0] <= x <= boxes[node, 1, 0]
                and boxes[node, 0, 1] <= y <= boxes[node, 1, 1]
                and z <= boxes[node, 1, 2]
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
