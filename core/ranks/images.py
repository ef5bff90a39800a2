"""Images: copies of points behind planes of symmetry, and beyond the seams of periodic axes.

An image is a row of the points behind the ghosts, a copy of an owned point or of a ghost of the same rank: what is near
the image of a point behind a mirror is nearer to the point itself, and space is not divided along periodic axes. So
images need no messages. Places are reflected, or shifted by a period; components of vectors and tensors change their
sign for each time that they count along the axis of a mirror.

The `sheet` of a row says which image it is: for each axis, by how many periods it is ahead less how many its point has
been taken back when it left the cell, or 1 or 2 behind the lower or upper mirror; the last column is 1 for mirror
images. A bond across a seam goes on when one end is taken back, since the difference of the sheets stays. Both ends of
it must compute the same bits: places along a periodic axis are multiples of a unit, so that their sums and differences
are exact.
"""

import math
from collections.abc import Mapping
from itertools import product
from typing import NamedTuple

import numpy as np

from periporo.core.points.particles import SHEET, Field, Particles
from periporo.errors import InputError, Problem

_UNITS = 2.0**51  # of a length, in which places along a periodic axis are counted


class _Way(NamedTuple):
    """How an image comes about: x' = sign x + shift along each axis, and its `sheet`."""

    sign: tuple[float, ...]
    shift: np.ndarray
    sheet: np.ndarray


class Images:
    """Images of the points of a rank.

    `mirrors` maps an axis and the side of the soil, 1 above the plane or -1 below it, to the place of the plane, m;
    `periods` maps a periodic axis to the ends of the cell, m.
    """

    def __init__(
        self, particles: Particles, mirrors: Mapping[tuple[int, int], float], periods: Mapping[int, tuple[float, float]]
    ):
        d = particles.dimension
        self.mirrors = dict(mirrors)
        self._units = {a: 2.0 ** math.ceil(math.log2(max(map(abs, ends)))) / _UNITS for a, ends in periods.items()}
        self.periods = {a: (self._snapped(a, low), self._snapped(a, up)) for a, (low, up) in periods.items()}
        self._ways = [_way(parts) for parts in product(*map(self._along, range(d))) if any(p[0] for p in parts)]
        between = [up - self.mirrors[a, 1] for (a, side), up in mirrors.items() if side < 0 and (a, 1) in mirrors]
        cells = [upper - lower for lower, upper in self.periods.values()]
        self._widths = {key: min(w) for key, w in (("symmetry", between), ("periodic", cells)) if w}
        self._copies: list[tuple[_Way, np.ndarray, slice]] = []  # which rows have which image, and where it is
        particles.add_field(Field(SHEET, d + 1, "", dtype=np.int64))

    @property
    def rows(self) -> np.ndarray:
        """Rows of the points that have an image."""
        return np.unique(np.concatenate([np.empty(0, np.int64), *(rows for _, rows, _ in self._copies)]))

    def _along(self, axis):
        """What may happen along an axis: (sheet, sign, shift, whether it is a mirror's)."""
        yield 0, 1.0, 0.0, 0
        for side, sheet in ((1, 1), (-1, 2)):
            if (axis, side) in self.mirrors:
                yield sheet, -1.0, 2.0 * self.mirrors[axis, side], 1
        if axis in self.periods:
            period = self.periods[axis][1] - self.periods[axis][0]
            yield from ((1, 1.0, period, 0), (-1, 1.0, -period, 0))

    def find(self, p: Particles, reach: float) -> int:
        """Find the images within `reach` m of the box of the owned points, of all rows there are; how many.

        Raises InputError, on all ranks alike, where a point would meet a second image of another.
        """
        for key, width in self._widths.items():
            if not width > reach:
                message = f"{width:.4g} m are too narrow: points act on each other over {reach:.4g} m; make it wider"
                raise InputError("scene", [Problem((key,), message)])
        self._copies, start = [], p.total
        x = p.position
        own = x[: p.owned][np.isfinite(x[: p.owned]).all(axis=1)]
        if not len(own):
            return 0
        lower, upper = own.min(axis=0) - reach, own.max(axis=0) + reach
        for way in self._ways:
            place = x * way.sign[: p.dimension] + way.shift
            rows = np.flatnonzero(((place > lower) & (place < upper)).all(axis=1))
            if len(rows):
                self._copies.append((way, rows, slice(start, start + len(rows))))
                start += len(rows)
        return start - p.total

    def fill(self, p: Particles, names: tuple[str, ...]) -> None:
        """Refresh the images' rows of the named fields."""
        for name in names:
            array, field = getattr(p, name), p.fields[name]
            for way, rows, images in self._copies:
                copied = array[rows]
                if name == SHEET:
                    copied += way.sheet
                elif field.axes is not None:
                    copied *= [math.prod(way.sign[a] for a in axes) for axes in field.axes]
                if field.place:
                    copied += way.shift
                array[images] = copied

    def settle(self, position: np.ndarray) -> None:
        """Round places (n, d) m to units."""
        for axis in self.periods:
            position[:, axis] = self._snapped(axis, position[:, axis])

    def take_back(self, p: Particles) -> None:
        """Take owned points that have left the cell back to where they come in again."""
        for axis, (lower, upper) in self.periods.items():
            laps = self._laps(axis, p.position[: p.owned, axis])
            if laps.any():
                p.sheet[: p.owned, axis] -= laps.astype(np.int64)
                for field in p.fields.values():
                    if field.place:
                        getattr(p, field.name)[: p.owned, axis] -= laps * (upper - lower)

    def within(self, position: np.ndarray) -> np.ndarray:
        """Where in the scene proper the places (n, d) m are repeated, (n, d) m."""
        position = position.copy()
        for (axis, side), plane in self.mirrors.items():
            position[:, axis] = plane + side * np.abs(position[:, axis] - plane)
        for axis, (lower, upper) in self.periods.items():
            position[:, axis] -= self._laps(axis, position[:, axis]) * (upper - lower)
        return position

    def _laps(self, axis, x):
        lower, upper = self.periods[axis]
        laps = np.floor((x - lower) / (upper - lower))
        return np.where(np.isfinite(laps), laps, 0.0)

    def deepest(self, p: Particles) -> tuple[float, np.ndarray]:
        """How far (m) behind a mirror the deepest owned point is, and where (d,) m; minus infinity without any."""
        found = -np.inf, np.zeros(p.dimension)
        for (axis, side), place in self.mirrors.items():
            depth = side * (place - p.position[: p.owned, axis])
            known = np.where(np.isfinite(depth), depth, -np.inf)
            if known.max(initial=-np.inf) > found[0]:
                found = float(known.max()), p.position[int(known.argmax())].copy()
        return found

    def _snapped(self, axis, x):
        return np.round(x / self._units[axis]) * self._units[axis]


def _way(parts) -> _Way:
    sheet, sign, shift, mirrored = zip(*parts, strict=True)
    out_of_plane = (1.0,) * (3 - len(sign))  # zz of tensors
    return _Way((*sign, *out_of_plane), np.array(shift), np.array([*sheet, any(mirrored)], np.int64))
