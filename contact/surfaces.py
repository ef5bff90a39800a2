"""Rigid analytic obstacles: how far a point is from their surface, and which way out of them.

Every obstacle is solid: a gap is negative inside. Edges and corners are round to a point that comes from
outside, so that the gap is continuous and its gradient is the normal.
"""

from typing import Protocol

import numpy as np

from periporo.core.numerics.cells import HEXAHEDRON, LINE, POLY_LINE, POLYGON, QUAD, Outline
from periporo.core.numerics.jit import kernel

_AROUND = 64  # sides of a circle that is drawn


class Surface(Protocol):
    """Geometry of a rigid obstacle."""

    def gap(self, position: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Distance (n,) m of each position (n, d) to the surface, negative inside, and outward normal (n, d)."""

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Lower and upper corner (d,) m of a box that holds it, infinite where it has no end."""

    def outline(self, middle: np.ndarray, size: float) -> Outline:
        """How it is drawn; what has no end, as far as `size` m around `middle` (d,)."""


class Plane:
    """Half-space behind the plane through `point` with outward `normal` (of any length)."""

    def __init__(self, point, normal):
        self.point = np.asarray(point, float)
        normal = np.asarray(normal, float)
        self.normal = normal / np.sqrt((normal**2).sum())

    def gap(self, position):
        """See `Surface.gap`."""
        gap, normal = np.empty(len(position)), np.empty(position.shape)
        _plane_gap(position, self.point, self.normal, gap, normal)
        return gap, normal

    def bounds(self):
        """See `Surface.bounds`."""
        return unbounded(len(self.point))

    def outline(self, middle, size):
        """See `Surface.outline`."""
        center = middle - ((middle - self.point) @ self.normal) * self.normal
        if len(center) == 2:
            along = np.array([-self.normal[1], self.normal[0]])
            return np.array([center - size * along, center + size * along]), [(LINE, (0, 1))]
        first, second = np.linalg.qr(np.column_stack([self.normal, np.eye(3)]))[0][:, 1:3].T
        corners = [a * first + b * second for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
        return center + size * np.array(corners), [(QUAD, range(4))]


class Box:
    """Solid box from `lower` to `upper`; points stay outside."""

    def __init__(self, lower, upper):
        self.lower, self.upper = np.asarray(lower, float), np.asarray(upper, float)

    def gap(self, position):
        """See `Surface.gap`; edges and corners are round."""
        gap, normal = np.empty(len(position)), np.zeros(position.shape)
        _box_gap(position, self.lower, self.upper, gap, normal)
        return gap, normal

    def bounds(self):
        """See `Surface.bounds`."""
        return self.lower, self.upper

    def outline(self, middle, size):
        """See `Surface.outline`."""
        corners = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]])
        d = len(self.lower)
        chosen = corners[: 2**d, :d]
        return np.where(chosen, self.upper, self.lower), [(QUAD if d == 2 else HEXAHEDRON, range(2**d))]


class Disc:
    """Solid disc in the plane, or sphere in space; points stay outside."""

    def __init__(self, center, radius):
        self.center, self.radius = np.asarray(center, float), float(radius)

    def gap(self, position):
        """See `Surface.gap`; at the very centre the way out is along the first axis."""
        distance, normal = _radial(position - self.center)
        return distance - self.radius, normal

    def bounds(self):
        """See `Surface.bounds`."""
        return self.center - self.radius, self.center + self.radius

    def outline(self, middle, size):
        """See `Surface.outline`."""
        if len(self.center) == 3:
            angle = np.linspace(0.0, np.pi, _AROUND // 4 + 1)
            points, cells = _revolved(np.column_stack([np.sin(angle), -np.cos(angle)]))
            return self.center + self.radius * points, cells
        return self.center + self.radius * _circle(), [(POLYGON, range(_AROUND))]


class Cylinder:
    """Solid circular cylinder along `axis` (0, 1, 2); `base` is the centre of its lowest end face."""

    def __init__(self, base, axis, radius, height):
        self.base, self.axis = np.asarray(base, float), axis
        self.radius, self.height = float(radius), float(height)

    def gap(self, position):
        """See `Surface.gap`; the rims are round."""
        relative = position - self.base
        along = relative[:, self.axis].copy()
        relative[:, self.axis] = 0.0
        distance, radial = _radial(relative, first=(self.axis + 1) % 3)
        side, end = distance - self.radius, np.maximum(-along, along - self.height)
        axial = np.zeros_like(radial)
        axial[:, self.axis] = np.where(along > 0.5 * self.height, 1.0, -1.0)
        rim = np.sqrt(np.maximum(side, 0.0) ** 2 + np.maximum(end, 0.0) ** 2)
        beside = np.where(rim > 0.0, np.maximum(side, 0.0), side >= end)[:, None]
        beyond = np.where(rim > 0.0, np.maximum(end, 0.0), side < end)[:, None]
        normal = (beside * radial + beyond * axial) / np.where(rim > 0.0, rim, 1.0)[:, None]
        return np.where(rim > 0.0, rim, np.maximum(side, end)), normal

    def bounds(self):
        """See `Surface.bounds`."""
        along = np.arange(3) == self.axis
        lower = self.base - np.where(along, 0.0, self.radius)
        return lower, self.base + np.where(along, self.height, self.radius)

    def outline(self, middle, size):
        """See `Surface.outline`."""
        points = np.tile(self.base, (2 * _AROUND, 1))
        points[:, [(self.axis + 1) % 3, (self.axis + 2) % 3]] += self.radius * np.tile(_circle(), (2, 1))
        points[_AROUND:, self.axis] += self.height
        around = range(_AROUND)
        sides = [(QUAD, (k, (k + 1) % _AROUND, _AROUND + (k + 1) % _AROUND, _AROUND + k)) for k in around]
        return points, [(POLYGON, around), (POLYGON, range(_AROUND, 2 * _AROUND)), *sides]


class Cone:
    """Solid of revolution about the z axis through `tip` (3,) m, with a `profile` (n, 2) m of radii, heights above it.

    The profile begins and ends on the axis. Its edges are round to a point outside.
    """

    def __init__(self, tip, profile):
        self.tip, self.profile = np.asarray(tip, float), np.asarray(profile, float)
        mirrored = self.profile[1:-1] * [-1.0, 1.0]
        # clockwise, so that points stay outside
        self._section = Polyline(np.concatenate([self.profile[::-1], mirrored, self.profile[-1:]]))

    def gap(self, position):
        """See `Surface.gap`: that of the section through the axis."""
        relative = position - self.tip
        height = relative[:, 2].copy()
        relative[:, 2] = 0.0
        distance, radial = _radial(relative)
        gap, flat = self._section.gap(np.column_stack([distance, height]))
        normal = flat[:, :1] * radial
        normal[:, 2] = flat[:, 1]
        return gap, normal

    def bounds(self):
        """See `Surface.bounds`."""
        radius, top = self.profile.max(axis=0)
        side = np.array([radius, radius, 0.0])
        return self.tip - side, self.tip + side + [0.0, 0.0, top]

    def outline(self, middle, size):
        """See `Surface.outline`."""
        points, cells = _revolved(self.profile)
        return points + self.tip, cells


class Polyline:
    """Ground to the right of a polyline in the plane: points stay on the left along its vertices (n, 2).

    An open line goes on forever beyond its ends, along its first and last segment; one whose last vertex is its
    first encloses an obstacle (clockwise) or a basin (counterclockwise).
    """

    def __init__(self, vertices):
        vertices = np.asarray(vertices, float)
        self.start, self.edge = vertices[:-1], np.diff(vertices, axis=0)
        self.closed = bool((vertices[0] == vertices[-1]).all())
        following = np.roll(self.edge, -1, axis=0)
        turn = self.edge[:, 0] * following[:, 1] - self.edge[:, 1] * following[:, 0]
        # in the wedge of a vertex a point is outside if the line turns to the right there
        self.convex = turn <= 0.0

    def gap(self, position):
        """See `Surface.gap`; the nearest segment or vertex counts."""
        gap, normal = np.empty(len(position)), np.empty_like(position)
        _polyline_gap(position, self.start, self.edge, self.convex, self.closed, gap, normal)
        return gap, normal

    def bounds(self):
        """See `Surface.bounds`; a basin has no end."""
        x, y = self.start.T
        if not self.closed or (x * np.roll(y, -1) - np.roll(x, -1) * y).sum() > 0.0:
            return unbounded(2)
        return self.start.min(axis=0), self.start.max(axis=0)

    def outline(self, middle, size):
        """See `Surface.outline`."""
        points = np.concatenate([self.start, [self.start[-1] + self.edge[-1]]])
        if not self.closed:
            for end, edge in ((0, -self.edge[0]), (-1, self.edge[-1])):
                direction = edge / np.sqrt((edge**2).sum())
                points[end] += max(size + (middle - points[end]) @ direction, 0.0) * direction
        return points, [(POLY_LINE, range(len(points)))]


def unbounded(dimension: int) -> tuple[np.ndarray, np.ndarray]:
    """Corners (d,) of a box without end."""
    return np.full(dimension, -np.inf), np.full(dimension, np.inf)


def _revolved(profile):
    """Outline of what the profile (n, 2), radius and height, makes about the z axis."""
    points = np.concatenate([np.column_stack([r * _circle(), np.full(_AROUND, z)]) for r, z in profile])
    ring = np.arange(_AROUND)
    beside = (ring + 1) % _AROUND
    strips = [np.column_stack([k + ring, k + beside, k + _AROUND + beside, k + _AROUND + ring])
              for k in range(0, len(points) - _AROUND, _AROUND)]  # fmt: skip
    return points, [(QUAD, row) for row in np.concatenate(strips)]


def _circle():
    """Points (_AROUND, 2) of the unit circle."""
    angle = np.linspace(0.0, 2.0 * np.pi, _AROUND, endpoint=False)
    return np.column_stack([np.cos(angle), np.sin(angle)])


def _radial(relative, first=0):
    """Length (n,) and direction (n, d) of vectors; along axis `first` where they vanish."""
    distance = np.sqrt((relative**2).sum(axis=1))
    fallback = np.zeros(relative.shape[1])
    fallback[first] = 1.0
    zero = distance == 0.0
    return distance, np.where(zero[:, None], fallback, relative / np.where(zero, 1.0, distance)[:, None])


@kernel
def _box_gap(position, lower, upper, gap, normal):
    """Inside, the way out is through the nearest face; `normal` is zero before."""
    d = position.shape[1]
    for i in range(position.shape[0]):
        square, depth, face = 0.0, np.inf, 0
        for a in range(d):
            x = position[i, a]
            end = lower[a] if x < lower[a] else upper[a] if x > upper[a] else x
            normal[i, a] = x - end
            square += normal[i, a] ** 2
        if square != 0.0:  # outside, or nowhere (NaN)
            gap[i] = np.sqrt(square)
            for a in range(d):
                normal[i, a] /= gap[i]
            continue
        for k in range(2 * d):
            a = k % d
            to_face = position[i, a] - lower[a] if k < d else upper[a] - position[i, a]
            if to_face < depth:
                depth, face = to_face, k
        gap[i] = -depth
        normal[i, face % d] = -1.0 if face < d else 1.0


@kernel
def _plane_gap(position, point, outward, gap, normal):
    for i in range(position.shape[0]):
        gap[i] = 0.0
        for a in range(position.shape[1]):
            gap[i] += (position[i, a] - point[a]) * outward[a]
            normal[i, a] = outward[a]


@kernel
def _polyline_gap(position, start, edge, convex, closed, gap, normal):
    segments = start.shape[0]
    for i in range(position.shape[0]):
        nearest = np.inf
        for s in range(segments):
            ex, ey = edge[s, 0], edge[s, 1]
            rx, ry = position[i, 0] - start[s, 0], position[i, 1] - start[s, 1]
            t = (rx * ex + ry * ey) / (ex * ex + ey * ey)
            vertex = -1  # the segment before the vertex that is nearest, if it is one
            if t < 0.0 and (closed or s > 0):
                t, vertex = 0.0, (s - 1) % segments
            elif t > 1.0 and (closed or s < segments - 1):
                t, vertex = 1.0, s
            ax, ay = rx - t * ex, ry - t * ey
            distance = np.sqrt(ax * ax + ay * ay)
            if distance >= nearest:
                continue
            nearest = distance
            length = np.sqrt(ex * ex + ey * ey)
            if vertex >= 0 and distance > 0.0:
                sign = 1.0 if convex[vertex] else -1.0
                normal[i, 0], normal[i, 1] = sign * ax / distance, sign * ay / distance
            else:
                sign = 1.0 if ex * ry - ey * rx >= 0.0 else -1.0
                normal[i, 0], normal[i, 1] = -ey / length, ex / length
            gap[i] = sign * distance
        if not nearest < np.inf:  # NaN stays visible
            gap[i], normal[i, 0], normal[i, 1] = np.nan, np.nan, np.nan
