"""Stress at the start: geostatic, from the weight of what lies above, or uniform.

Above a point is what a ray against gravity meets: the layers of its body up to the local surface, and those of
bodies that rest on it without a gap. The vertical stress is that weight, the horizontal one K0 times it. In wet soil
that is the total stress, from which sigma_bar = sigma + S p I follows: with the weight of grains, of water in the pores
and of free water above, and K0 between the stresses that are left without a pressure p > 0 in the pores.
"""

import numpy as np

from periporo.core.numerics.tensors import INDEX_PAIRS, component_count
from periporo.core.water.pore_water import PoreWater
from periporo.io.geometry.lattice import Lattice
from periporo.io.geometry.layers import layer_of
from periporo.io.geometry.shapes import inside_polygon
from periporo.io.schema.bodies import Box, Cylinder, Disc, Mesh, Points, Polygon, Raster, Sphere

Spans = list[tuple[np.ndarray, np.ndarray]]


def uniform_stress(components, dimension: int):
    """Function of positions (n, d) m that gives the same stress (n, 4|6) Pa everywhere."""
    row = np.array([getattr(components, c) for c in ("xx", "yy", "zz", "xy", "yz", "xz")])[: component_count(dimension)]
    return lambda position: np.tile(row, (len(position), 1))


class GeostaticStress:
    """Total stress at the start as a function of positions (n, d) m.

    `lattices` are the bodies, `density` (materials,) kg/m^3 that of the dry soil, `gravity` (d,) m/s^2 not zero. With a
    `surface` (level along the direction opposite to gravity, m) the soil of each body's top layer reaches up to there.
    `water` is what is in the pores at the start, and free water around.
    """

    def __init__(self, lattices, density, gravity, K0, surface=None, water: PoreWater | None = None):
        self.strength = float(np.sqrt((gravity**2).sum()))
        self.up = -gravity / self.strength
        self.profiles = [_Profile(lattice, self.up, density, water) for lattice in lattices]
        self.K0 = K0
        self.surface = surface
        self.water = water
        self._tolerance = 1e-6 * lattices[0].spacing

    def __call__(self, position: np.ndarray) -> np.ndarray:
        """Stress (n, 4|6) Pa."""
        level = _along(position, self.up)
        weight, top = self._weight(position, level)
        vertical = -self.strength * weight
        pressure = np.zeros(len(position))
        if self.water is not None:
            pressure = np.maximum(self.water.profile.at(position), 0.0)
            if self.water.free is not None:
                vertical -= self.water.free.weight * np.maximum(self.water.free.level(0.0) - (level + top), 0.0)
        vertical += pressure
        stress = np.zeros((len(position), component_count(position.shape[1])))
        up = np.append(self.up, 0.0) if position.shape[1] == 2 else self.up
        for c, (a, b) in enumerate(INDEX_PAIRS[: stress.shape[1]]):
            stress[:, c] = vertical * ((1.0 - self.K0) * up[a] * up[b] + (self.K0 if a == b else 0.0))
            stress[:, c] -= pressure if a == b else 0.0
        return stress

    def cover(self, position: np.ndarray) -> np.ndarray:
        """Height (n,) m of the soil above positions (n, d) m, up to the surface."""
        return self._weight(position, _along(position, self.up))[1]

    def _weight(self, position, level):
        """Mass above per area, (n,) kg/m^2, and how far up that reaches, (n,) m."""
        weight = np.zeros(len(position))
        top = np.zeros(len(position))  # how far up the weight has been counted
        found = np.zeros(len(position), bool)
        spans = [(profile, *span) for profile in self.profiles for span in profile.spans(position)]
        for _ in spans:  # from one body to the one on top of it
            before = top.copy()
            for profile, begin, end in spans:
                meets = (begin <= top + self._tolerance) & (end > top)
                first = meets & ~found
                found |= meets
                if self.surface is not None:
                    end = np.where(first, np.maximum(self.surface - level, 0.0), top)
                added = profile.mass_below(position, level + end) - profile.mass_below(position, level + top)
                weight[meets] += added[meets]
                top[meets] = end[meets]
            if (top == before).all():
                break
        return weight, top


class _Profile:
    """One body: where a ray against gravity leaves it, and its layers."""

    def __init__(self, lattice: Lattice, up, density, water):
        self._lattice = lattice
        self._up = up
        self._density, self._water = density, water
        edges = [above for above, _ in lattice.layers]
        materials = [lattice.material, *(m for _, m in lattice.layers)]
        self._layers = list(zip([-np.inf, *edges], [*edges, np.inf], materials, strict=True))
        if isinstance(lattice.body.shape, Points | Mesh):
            self._columns = _Columns(lattice, up)

    def mass_below(self, position, level):
        """Mass per area (n,) between a fixed level and `level` (n,) in columns through `position` (n, d), kg/m^2."""
        mass = np.zeros(len(level))
        for lower, upper, material in self._layers:
            mass += self._mass_of_layer(material, position, np.clip(level, lower, upper))
            if np.isfinite(lower):
                mass -= self._mass_of_layer(material, position, np.full(len(level), lower))
        return mass

    def _mass_of_layer(self, material, position, level):
        """The same if there is but this material."""
        mass = self._density[material] * level
        if self._water is not None:
            mass += self._water.pores.mass_below(self._water.profile, material, position, level)
        return mass

    def spans(self, position) -> Spans:
        """Distances (n,) along the ray between which it is inside: start and end, end < start where it misses."""
        shape, up = self._lattice.body.shape, self._up
        match shape:
            case Box():
                return [_slab(position, up, self._lattice.lower, self._lattice.upper)]
            case Disc() | Sphere():
                return [_round(position - np.array(shape.center), up, shape.radius)]
            case Cylinder():
                return [_cylinder(position, up, shape, self._lattice.lower, self._lattice.upper)]
            case Polygon():
                return _polygon(position, up, shape)
            case Points() | Mesh():
                return [self._columns.span(position)]
            case Raster():
                return [_layer(position, layer_of(shape))]


def _along(position, direction):
    """Component (n,) along `direction`; not by BLAS, whose last bit depends on n."""
    return (position * direction).sum(axis=1)


def _slab(position, up, lower, upper):
    begin, end = np.full(len(position), -np.inf), np.full(len(position), np.inf)
    for a in range(len(up)):
        low, high = lower[a] - position[:, a], upper[a] - position[:, a]
        if up[a] == 0.0:
            outside = (low > 0.0) | (high < 0.0)
            begin[outside], end[outside] = np.inf, -np.inf
            continue
        first, last = np.minimum(low / up[a], high / up[a]), np.maximum(low / up[a], high / up[a])
        begin, end = np.maximum(begin, first), np.minimum(end, last)
    return begin, end


def _round(relative, up, radius):
    along, square = _along(relative, up), _along(relative, relative)
    reach = np.sqrt(np.maximum(radius**2 - square + along**2, 0.0))
    misses = square - along**2 > radius**2
    return np.where(misses, np.inf, -along - reach), np.where(misses, -np.inf, -along + reach)


def _cylinder(position, up, shape, lower, upper):
    axis = np.eye(3)["xyz".index(shape.axis)]
    across, direction = (position - np.array(shape.base)) * (1.0 - axis), up * (1.0 - axis)
    length = float(np.sqrt((direction**2).sum()))
    begin, end = _slab(position, up, lower, upper)
    if length == 0.0:
        outside = _along(across, across) > shape.radius**2
        return np.where(outside, np.inf, begin), np.where(outside, -np.inf, end)
    first, last = _round(across, direction / length, shape.radius)
    return np.maximum(begin, first / length), np.minimum(end, last / length)


def _layer(position, layer):
    base, thickness = layer.ground.at(position), layer.thickness(position)
    below, above = base - position[:, 2], base + thickness - position[:, 2]
    misses = ~(thickness > 0.0) | np.isnan(base)
    return np.where(misses, np.inf, below), np.where(misses, -np.inf, above)


def _polygon(position, up, shape) -> Spans:
    """Between an odd and the next even crossing of its edges the ray is inside."""
    corners, n = np.array(shape.vertices), len(position)
    begin, end = np.full(n, -np.inf), np.full(n, np.inf)
    if len(up) == 3:
        lower, upper = (np.array([-np.inf, -np.inf, z]) for z in shape.extrude)
        upper[:2] = np.inf
        begin, end = _slab(position, up, lower, upper)
        if up[0] == up[1] == 0.0:
            outside = ~inside_polygon(corners, position)
            return [(np.where(outside, np.inf, begin), np.where(outside, -np.inf, end))]
    crossings = []
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        edge = b - a
        turn = up[0] * edge[1] - up[1] * edge[0]
        if turn == 0.0:
            continue
        # side of the ray on which each corner lies: half-open, so that a corner counts once
        sides = [up[0] * (c[1] - position[:, 1]) - up[1] * (c[0] - position[:, 0]) >= 0.0 for c in (a, b)]
        x, y = a[0] - position[:, 0], a[1] - position[:, 1]
        crossings.append(np.where(sides[0] != sides[1], (x * edge[1] - y * edge[0]) / turn, np.inf))
    ordered = np.sort(np.stack(crossings), axis=0)
    pairs = zip(ordered[::2], ordered[1::2], strict=False)
    return [
        (np.maximum(first, begin), np.where(np.isinf(last), -np.inf, np.minimum(last, end))) for first, last in pairs
    ]


class _Columns:
    """The top of a cloud of points above any place: columns one spacing wide, linear between their middles."""

    def __init__(self, lattice, up):
        self._up = up
        self._spacing = lattice.spacing
        position = np.concatenate([x for _, x, *_ in lattice.chunks()])
        self._across = np.linalg.qr(np.column_stack([up, np.eye(len(up))]))[0][:, 1:].T
        place = np.stack([_along(position, t) for t in self._across], axis=1)
        self._origin = place.min(axis=0)
        column = np.rint((place - self._origin) / self._spacing).astype(np.int64)
        self._tops = np.full(column.max(axis=0) + 1, -np.inf)
        np.maximum.at(self._tops, tuple(column.T), _along(position, up) + 0.5 * self._spacing)

    def span(self, position):
        """From the place itself to the top above it."""
        place = (np.stack([_along(position, t) for t in self._across], axis=1) - self._origin) / self._spacing
        low = np.floor(place).astype(np.int64)
        weights, tops = [], []
        for corner in np.ndindex((2,) * place.shape[1]):
            index = low + corner
            inside = ((index >= 0) & (index < self._tops.shape)).all(axis=1)
            top = np.where(inside, self._tops[tuple(np.clip(index, 0, np.array(self._tops.shape) - 1).T)], -np.inf)
            weight = np.prod(np.maximum(1.0 - np.abs(place - index), 1e-9), axis=1)
            weights.append(np.where(np.isinf(top), 0.0, weight))
            tops.append(np.where(np.isinf(top), 0.0, top))
        total = sum(weights)
        top = sum(w * t for w, t in zip(weights, tops, strict=True)) / np.where(total > 0.0, total, 1.0)
        end = np.where(total > 0.0, top - _along(position, self._up), -np.inf)
        return np.zeros(len(position)), end
