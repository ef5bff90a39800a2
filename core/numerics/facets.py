"""How a ball meets a surface of triangles: the nearest way out of all the places that it must not be in.

A ball of radius r may be wherever no triangle is closer to its middle x than r. Its overlap is the shortest way u to
such a place, and k u^2 / 2 the energy of a spring that holds it off: the force k u is continuous over seams and edges.
What is near is seen as half-spaces, one for each place c of the surface that is nearest to x in some direction:

    m . u >= r - g,   m = (x - c) / |x - c|, g = |x - c| outside; m is the normal of a triangle right below x,

g being negative behind a triangle. A place is left out if a half-space that is nearer already keeps it away,
m_j . (x - c) >= g_j: so a seam in a plane, and an edge that sticks out, count once, and an edge that runs in counts as
its two faces. What is near is looked at again from x + u until u is the same. Triangles are found by scanning whatever
may be in reach, once for each half-space.

Kernels of `core.numerics.heights` (rasters) and `core.numerics.meshes` bring the triangles. Arrays of a scan: `way`
(MOST, 3) and `gap` (MOST,) m are the half-spaces; `best` (11,) the nearest place so far: x - c, |x - c|, the distance s
of x from the plane of its triangle, the normal, how far away the nearest is at most, whether others are as near, and
what counts.
"""

import numpy as np

from periporo.core.numerics.jit import inlined

MOST = 6
"""Half-spaces that are looked at; more than three hold a point only in the tip of a pyramid."""
LOOKS = 10
"""Times that one looks again from where the way out has led."""
TOUCHING = 1.25
"""Reaches within which one that has been led out still sees what it was led out of."""
PLAIN = 0.5
"""Reaches above which one place that is in reach cannot hide another, whatever the angle between their faces."""
TOLERANCE = 1e-9
"""Of lengths, over the radius of the ball."""
_ALONE, _EQUAL, _CHOSEN = 0.0, 1.0, 2.0  # the nearest place; one of several; the one of these that is wanted
_ANY, _BESIDE, _IN_FRONT = 0.0, 1.0, 2.0  # any place counts; that one is behind a border; only those in front count


@inlined
def nearest_place(x, y, z, ax, ay, az, bx, by, bz, cx, cy, cz):
    """Place of the triangle a, b, c that is nearest to a point, and on what of it.

    That is -1 inside, 0, 1, 2 on the edges ab, bc, ca, and 3, 4, 5 at the corners (Ericson 2005, section 5.1.5).
    """
    ux, uy, uz = bx - ax, by - ay, bz - az
    vx, vy, vz = cx - ax, cy - ay, cz - az
    d1 = ux * (x - ax) + uy * (y - ay) + uz * (z - az)
    d2 = vx * (x - ax) + vy * (y - ay) + vz * (z - az)
    if d1 <= 0.0 and d2 <= 0.0:
        return ax, ay, az, 3
    d3 = ux * (x - bx) + uy * (y - by) + uz * (z - bz)
    d4 = vx * (x - bx) + vy * (y - by) + vz * (z - bz)
    if d3 >= 0.0 and d4 <= d3:
        return bx, by, bz, 4
    wc = d1 * d4 - d3 * d2
    if wc <= 0.0 and d1 >= 0.0 and d3 <= 0.0:
        t = d1 / (d1 - d3)
        return ax + t * ux, ay + t * uy, az + t * uz, 0
    d5 = ux * (x - cx) + uy * (y - cy) + uz * (z - cz)
    d6 = vx * (x - cx) + vy * (y - cy) + vz * (z - cz)
    if d6 >= 0.0 and d5 <= d6:
        return cx, cy, cz, 5
    wb = d5 * d2 - d1 * d6
    if wb <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
        t = d2 / (d2 - d6)
        return ax + t * vx, ay + t * vy, az + t * vz, 2
    wa = d3 * d6 - d5 * d4
    if wa <= 0.0 and d4 >= d3 and d5 >= d6:
        t = (d4 - d3) / ((d4 - d3) + (d5 - d6))
        return bx + t * (cx - bx), by + t * (cy - by), bz + t * (cz - bz), 1
    total = wa + wb + wc
    v, w = wb / total, wc / total
    return ax + v * ux + w * vx, ay + v * uy + w * vy, az + v * uz + w * vz, -1


@inlined
def begin(best, bound):
    """Look for the nearest place anew, which lies at most `bound` m away, if anything is known of it."""
    best[3], best[4], best[8], best[9], best[10] = np.inf, 0.0, bound, _ALONE, _ANY


@inlined
def must_look_again(best):
    """Whether the place that was found does not stand.

    If others are as near one must choose among them, for which it is may not depend on the order in which triangles are
    offered; and who is behind the plane beside a border is behind nothing, so that only what it is in front of counts.
    """
    if best[9] == _EQUAL:
        best[8], best[3], best[4], best[9] = best[3], np.inf, 0.0, _CHOSEN
        return True
    if best[10] == _BESIDE:
        best[3], best[4], best[8], best[9], best[10] = np.inf, 0.0, np.inf, _ALONE, _IN_FRONT
        return True
    return False


@inlined
def offer(x, y, z, ax, ay, az, bx, by, bz, cx, cy, cz, open_edge, reach, radius, way, gap, count, best):
    """Take a triangle for `best` if its place is the nearest that `count` half-spaces do not keep away.

    It is looked for within `radius`, and all but the first within `reach`. `open_edge` has the bit 1 << k if the
    feature k (see `nearest_place`) is a border of the surface: who is behind the plane beside it is behind nothing.
    """
    small = TOLERANCE * reach
    for j in range(count):  # what keeps all corners away keeps away what lies between them
        a = (x - ax) * way[j, 0] + (y - ay) * way[j, 1] + (z - az) * way[j, 2]
        b = (x - bx) * way[j, 0] + (y - by) * way[j, 1] + (z - bz) * way[j, 2]
        c = (x - cx) * way[j, 0] + (y - cy) * way[j, 1] + (z - cz) * way[j, 2]
        if min(min(a, b), c) >= gap[j] - 0.5 * small:
            return
    px, py, pz, feature = nearest_place(x, y, z, ax, ay, az, bx, by, bz, cx, cy, cz)
    wx, wy, wz = x - px, y - py, z - pz
    square = wx * wx + wy * wy + wz * wz
    farthest = min(radius, best[8] + small)
    if not square < radius * radius or square > farthest * farthest:
        return
    for j in range(count):
        if wx * way[j, 0] + wy * way[j, 1] + wz * way[j, 2] >= gap[j] - small:
            return
    distance = np.sqrt(square)
    nx = (by - ay) * (cz - az) - (bz - az) * (cy - ay)
    ny = (bz - az) * (cx - ax) - (bx - ax) * (cz - az)
    nz = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
    length = np.sqrt(nx * nx + ny * ny + nz * nz)
    nx, ny, nz = nx / length, ny / length, nz / length
    s = (x - ax) * nx + (y - ay) * ny + (z - az) * nz
    below = distance - abs(s) <= small  # the point is right above or below
    if count == 0:
        if s < 0.0 and best[10] == _IN_FRONT:
            return
    else:
        if s < 0.0 and not (below and gap[0] < 0.0):
            return
        if (s if below else distance) >= reach:
            return
    if best[9] == _CHOSEN:  # the steepest of those that are equally near, and the first of these
        if distance > best[8] + small or (best[3] < np.inf and abs(s) <= abs(best[4])):
            return
    else:
        best[9] = _ALONE if distance < best[3] - small else _EQUAL
        if distance >= best[3]:
            return
        best[8] = distance
    if count == 0 and best[10] != _IN_FRONT:
        best[10] = _BESIDE if s < 0.0 and feature >= 0 and (open_edge >> feature) & 1 else _ANY
    best[0], best[1], best[2], best[3], best[4] = wx, wy, wz, distance, s
    best[5], best[6], best[7] = nx, ny, nz


@inlined
def accept(best, reach, way, gap, count):
    """Make a half-space of the nearest place; how many there are then: `count` itself if nothing was found."""
    distance, s = best[3], best[4]
    if not distance < np.inf:
        return count
    if distance - abs(s) <= TOLERANCE * reach:
        way[count, 0], way[count, 1], way[count, 2] = best[5], best[6], best[7]
        gap[count] = s
        return count + 1
    sign = 1.0 if s >= 0.0 else -1.0
    for a in range(3):
        way[count, a] = sign * best[a] / distance
    gap[count] = sign * distance
    return count + 1


@inlined
def radius_of_others(gap, reach, seen, radius):
    """Within which places beside the nearest are looked for, if that is at `gap` m."""
    if gap >= 0.0:
        return seen  # nothing is right above
    return TOUCHING * reach if gap > -TOUCHING * reach else radius


@inlined
def improve(way, gap, count, reach, u, need, new):
    """Make u (3,) the shortest way from x to where the half-spaces end that were seen from x + u; whether it was that.

    `need` (MOST,) and `new` (3,) are scratch.
    """
    for j in range(count):
        need[j] = reach - gap[j] + way[j, 0] * u[0] + way[j, 1] * u[1] + way[j, 2] * u[2]
    _way_out(way, need, count, TOLERANCE * reach, new)
    moved = 0.0
    for a in range(3):
        moved += (new[a] - u[a]) ** 2
        u[a] = new[a]
    return moved < (1e-7 * reach) ** 2


@inlined
def _keeps(u, way, need, count, small):
    """Whether the displacement u leaves all half-spaces."""
    left = True
    for k in range(count):
        left = left and u[0] * way[k, 0] + u[1] * way[k, 1] + u[2] * way[k, 2] >= need[k] - small
    return left


@inlined
def _by_two(i, j, way, need, u):
    """Fill u, the shortest way to the line where two half-spaces end; whether both press."""
    c = way[i, 0] * way[j, 0] + way[i, 1] * way[j, 1] + way[i, 2] * way[j, 2]
    determinant = 1.0 - c * c
    if determinant < 1e-10:
        return False
    p, q = (need[i] - c * need[j]) / determinant, (need[j] - c * need[i]) / determinant
    for a in range(3):
        u[a] = p * way[i, a] + q * way[j, a]
    return p >= 0.0 and q >= 0.0


@inlined
def _by_three(i, j, k, way, need, u):
    """Fill u, the way to the point where three half-spaces end; whether all press."""
    # columns of the inverse of the matrix of normals are crosses of two, over the volume that the three span
    volume = 0.0
    for a in range(3):
        b, c = (a + 1) % 3, (a + 2) % 3
        volume += way[i, a] * (way[j, b] * way[k, c] - way[j, c] * way[k, b])
    if volume * volume < 1e-10:
        return False
    for a in range(3):
        b, c = (a + 1) % 3, (a + 2) % 3
        u[a] = (
            need[i] * (way[j, b] * way[k, c] - way[j, c] * way[k, b])
            + need[j] * (way[k, b] * way[i, c] - way[k, c] * way[i, b])
            + need[k] * (way[i, b] * way[j, c] - way[i, c] * way[j, b])
        ) / volume
    pressing = True  # u = p way_i + q way_j + r way_k with none below zero
    for first, second in ((j, k), (k, i), (i, j)):
        share = 0.0
        for a in range(3):
            b, c = (a + 1) % 3, (a + 2) % 3
            share += u[a] * (way[first, b] * way[second, c] - way[first, c] * way[second, b])
        pressing = pressing and share / volume >= 0.0
    return pressing


@inlined
def _way_out(way, need, count, small, u):
    """Fill u (3,) m, the shortest displacement with way_j . u >= need_j for all.

    Where there is none, as between two walls, the sum of what each asks for.
    """
    deepest = 0
    for j in range(1, count):
        if need[j] > need[deepest]:
            deepest = j
    for a in range(3):
        u[a] = max(need[deepest], 0.0) * way[deepest, a]
    if _keeps(u, way, need, count, small):
        return
    for i in range(count):
        for j in range(i + 1, count):
            if _by_two(i, j, way, need, u) and _keeps(u, way, need, count, small):
                return
    for i in range(count):
        for j in range(i + 1, count):
            for k in range(j + 1, count):
                if _by_three(i, j, k, way, need, u) and _keeps(u, way, need, count, small):
                    return
    for a in range(3):
        u[a] = 0.0
        for j in range(count):
            u[a] += max(need[j], 0.0) * way[j, a]
