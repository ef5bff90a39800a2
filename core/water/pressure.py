"""Pore pressure of a place: the same suction everywhere, hydrostatic below a water table, or what is known of it."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class UniformSuction:
    """The same `suction`(time) Pa everywhere, at most the `largest_suction`; `varies` tells whether it changes."""

    suction: Callable[[float], float]
    largest_suction: float
    varies: bool = False

    def at(self, position: np.ndarray, time: float = 0.0) -> np.ndarray:
        """Pressure (n,) Pa at positions (n, d) m."""
        return np.full(len(position), -self.suction(time))


@dataclass(frozen=True)
class Hydrostatic:
    """Pressure as of water at rest below a table; above, suction up to `largest_suction`.

    `table`(positions (n, d) m, time) gives its level (n,) m against gravity above or below them: see `level_table`,
    `line_table`; `weight` rho_w g N/m^3; `up` (d,) the unit vector against gravity.
    """

    table: Callable[[np.ndarray, float], np.ndarray]
    weight: float
    up: np.ndarray
    largest_suction: float = 0.0
    varies = True

    def at(self, position: np.ndarray, time: float = 0.0) -> np.ndarray:
        """Pressure (n,) Pa at positions (n, d) m."""
        depth = self.table(position, time) - (position * self.up).sum(axis=1)
        return np.maximum(self.weight * depth, -self.largest_suction)


@dataclass(frozen=True)
class GivenPressure:
    """Pressures that are known at the start, `begin`(positions (n, d) m) Pa; a point keeps its own, wherever it goes.

    `up` (d,) is the unit vector against gravity, and no place sucks by more than `largest_suction` Pa.
    """

    begin: Callable[[np.ndarray], np.ndarray]
    up: np.ndarray
    largest_suction: float
    varies = False

    def at(self, position: np.ndarray, time: float = 0.0) -> np.ndarray:
        """Pressure (n,) Pa at positions (n, d) m at the start."""
        return self.begin(position)


Profile = UniformSuction | Hydrostatic | GivenPressure


def level_table(level: Callable[[float], float]) -> Callable[[np.ndarray, float], np.ndarray]:
    """A water table of the same `level`(time) m everywhere."""
    return lambda position, time: np.full(len(position), level(time))


def line_table(corners: np.ndarray, up: np.ndarray) -> Callable[[np.ndarray, float], np.ndarray]:
    """A water table through `corners` (k, 2) m, in the order in which they lie `across` gravity; level beyond them."""
    places, levels = across(corners, up), (corners * up).sum(axis=1)
    return lambda position, time: np.interp(across(position, up), places, levels)


def across(position: np.ndarray, up: np.ndarray) -> np.ndarray:
    """How far positions (n, 2) m lie to the side, (n,) m."""
    return position[:, 0] * up[1] - position[:, 1] * up[0]


class FreeWater:
    """Water at rest around the bodies, up to `level`(time) m against gravity.

    Its pressure on their surface has the resultant and moment of a force -grad p per volume of what is below the
    level, and of the same pressure p in all pores: `add_force` adds the one, and the pore water takes the other from
    its own, so that no surface need be found and water at rest inside and outside exerts nothing but buoyancy. The
    part of a point's cell that is below the level counts.
    """

    def __init__(self, level: Callable[[float], float], weight: float, up: np.ndarray):
        self.level = level
        self.weight = weight
        self.up = up

    def pressure(self, p, time: float) -> np.ndarray:
        """Mean pressure (owned,) Pa over the cells of the points."""
        size, part = self._submerged(p, time)
        depth = self.level(time) - (p.position[: p.owned] * self.up).sum(axis=1)
        return self.weight * np.where(part < 1.0, 0.5 * size * part * part, depth)

    def add_force(self, p, time: float, dt: float) -> None:
        """Add buoyancy to the external force."""
        _, part = self._submerged(p, time)
        p.external_force[: p.owned] += (self.weight * part * p.present_volume())[:, None] * self.up

    def _submerged(self, p, time):
        """Size of the points' cells (owned,) m, and the part of them below the level."""
        size = p.present_volume() ** (1.0 / p.dimension)
        depth = self.level(time) - (p.position[: p.owned] * self.up).sum(axis=1)
        return size, np.clip(depth / size + 0.5, 0.0, 1.0)
