"""Pore pressure as a function of place: the same suction everywhere, or hydrostatic below a water table."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class UniformSuction:
    """The same `suction` Pa everywhere."""

    suction: float
    varies = False

    @property
    def largest_suction(self) -> float:
        """Of all places, Pa."""
        return self.suction

    def at(self, position: np.ndarray) -> np.ndarray:
        """Pressure (n,) Pa at positions (n, d) m."""
        return np.full(len(position), -self.suction)


@dataclass(frozen=True)
class Hydrostatic:
    """Pressure as of water at rest below a table; above, suction up to `largest_suction`.

    The table goes through `corners` (k, d) m, in the order in which they lie across gravity, and level beyond them: one
    corner is a level table. `weight` rho_w g N/m^3; `up` (d,) the unit vector against gravity.
    """

    corners: np.ndarray
    weight: float
    up: np.ndarray
    largest_suction: float = 0.0
    varies = True

    def table(self, position: np.ndarray) -> np.ndarray:
        """Level (n,) m of the table, against gravity, above or below positions (n, d) m."""
        levels = (self.corners * self.up).sum(axis=1)
        if len(levels) == 1:
            return np.full(len(position), levels[0])
        return np.interp(self.across(position), self.across(self.corners), levels)

    def across(self, position: np.ndarray) -> np.ndarray:
        """How far positions (n, 2) m lie to the side, m."""
        return position[:, 0] * self.up[1] - position[:, 1] * self.up[0]

    def at(self, position: np.ndarray) -> np.ndarray:
        """Pressure (n,) Pa at positions (n, d) m."""
        depth = self.table(position) - (position * self.up).sum(axis=1)
        return np.maximum(self.weight * depth, -self.largest_suction)


Profile = UniformSuction | Hydrostatic


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
