"""Mass of rigid solids of uniform density, and the places where they touch others first."""

from dataclasses import dataclass

import numpy as np

_RIM = 24  # places around a circular edge


@dataclass(frozen=True)
class Solid:
    """`volume` (m^3; m^2 in the plane), `centre` (d,) m of mass, `inertia` per density (1, 1) or (3, 3) about it.

    Balls around `places` (n, d) m of the radius `roundness` m touch others; `size` m is its smallest extent.
    """

    volume: float
    centre: np.ndarray
    inertia: np.ndarray
    places: np.ndarray
    size: float
    roundness: float = 0.0

    @property
    def radius(self) -> float:
        """Distance of the farthest place from the centre, m."""
        return float(np.sqrt(((self.places - self.centre) ** 2).sum(axis=1).max())) + self.roundness


def ball(centre: np.ndarray, radius: float) -> Solid:
    """A disc, in the plane, or a sphere."""
    if len(centre) == 2:
        volume = np.pi * radius**2
        return Solid(volume, centre, np.array([[0.5 * volume * radius**2]]), centre[None], 2 * radius, radius)
    volume = 4.0 / 3.0 * np.pi * radius**3
    return Solid(volume, centre, 0.4 * volume * radius**2 * np.eye(3), centre[None], 2 * radius, radius)


def block(lower: np.ndarray, upper: np.ndarray) -> Solid:
    """A rectangle, or a cuboid, along the axes."""
    d, sides = len(lower), upper - lower
    volume, corners = float(np.prod(sides)), np.array(np.meshgrid(*[[0, 1]] * d)).reshape(d, -1).T
    squares = volume * sides**2 / 12.0
    inertia = np.array([[squares.sum()]]) if d == 2 else np.diag(squares.sum() - squares)
    return Solid(volume, 0.5 * (lower + upper), inertia, lower + corners * sides, float(sides.min()))


def polygon(corners: np.ndarray) -> Solid:
    """The inside of a convex polygon (n, 2), counterclockwise.

    >>> square = polygon(np.array([[1.0, 1.0], [2.0, 1.0], [2.0, 2.0], [1.0, 2.0]]))
    >>> square.volume, square.centre.tolist(), round(float(square.inertia[0, 0]), 12) == round(1 / 6, 12)
    (1.0, [1.5, 1.5], True)
    """
    middle = corners.mean(axis=0)
    a = corners - middle
    b = np.roll(a, -1, axis=0)
    cross = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    volume = 0.5 * float(cross.sum())
    centre = ((a + b) * cross[:, None]).sum(axis=0) / (6.0 * volume)
    second = float((cross * ((a * a).sum(axis=1) + (a * b).sum(axis=1) + (b * b).sum(axis=1))).sum()) / 12.0
    inertia = np.array([[second - volume * float(centre @ centre)]])
    return Solid(volume, middle + centre, inertia, corners, float(np.ptp(corners, axis=0).min()))


def revolved(base: np.ndarray, axis: int, profile: np.ndarray) -> Solid:
    """What the profile (n, 2) m, radius and height above `base` (3,) m, makes about an axis (0, 1, 2).

    >>> cylinder = revolved(np.zeros(3), 2, np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 2.0], [0.0, 2.0]]))
    >>> [round(float(v) / np.pi, 12) for v in (cylinder.volume, cylinder.inertia[2, 2])]
    [2.0, 1.0]
    """
    nodes, weights = np.polynomial.legendre.leggauss(4)
    sums = np.zeros(5)  # integrals of r^2 (1, z, z^2), r^4 over the height
    for (r0, z0), (r1, z1) in zip(profile, profile[1:], strict=False):
        share = 0.5 * (nodes + 1.0)
        r, z, w = r0 + share * (r1 - r0), z0 + share * (z1 - z0), 0.5 * weights * (z1 - z0)
        sums[:4] += (w * r**2).sum(), (w * r**2 * z).sum(), (w * r**2 * z**2).sum(), (w * r**4).sum()
    volume, height = np.pi * sums[0], sums[1] / sums[0]
    across = np.pi * (0.25 * sums[3] + sums[2]) - volume * height**2
    inertia = np.full(3, across)
    inertia[axis] = 0.5 * np.pi * sums[3]
    centre = base.copy()
    centre[axis] += height
    return Solid(float(volume), centre, np.diag(inertia), _rims(base, axis, profile),
                 float(min(2.0 * profile[:, 0].max(), np.ptp(profile[:, 1]))))  # fmt: skip


def enclosed(corners: np.ndarray, triangles: np.ndarray) -> Solid:
    """What a closed surface of triangles (m, 3) between corners (n, 3) m is around; the hull of it touches others."""
    import trimesh

    surface = trimesh.Trimesh(corners, triangles, process=False)
    found, hull = surface.mass_properties, surface.convex_hull.vertices
    size = float(np.ptp(corners, axis=0).min())
    return Solid(float(found.volume), np.array(found.center_mass), np.array(found.inertia), np.array(hull), size)


def _rims(base, axis, profile):
    """Places around the edges of a solid of revolution."""
    angle = np.linspace(0.0, 2.0 * np.pi, _RIM, endpoint=False)
    places = []
    for r, z in profile:
        ring = np.zeros((_RIM if r > 0.0 else 1, 3))
        ring[:, (axis + 1) % 3], ring[:, (axis + 2) % 3] = (r * np.cos(angle), r * np.sin(angle)) if r > 0.0 else (0, 0)
        ring[:, axis] = z
        places.append(base + ring)
    return np.concatenate(places)
