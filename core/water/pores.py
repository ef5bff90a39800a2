"""What water meets in the ground, and how much of it is there at the start."""

from dataclasses import dataclass

import numpy as np

from periporo.core.water.pressure import GivenPressure, Profile, UniformSuction
from periporo.core.water.retention import FULL, Retention

_STEPS = 32  # of the integral of saturation over a height, where pressures are given at points
_NODES = 513  # of the integral of saturation over the height of growing suction


@dataclass(frozen=True)
class Pores:
    """What the water meets: `porosity` at the start, `retention` and factor of Bishop (`core.water.bishop`) of each.

    The water has `density` kg/m^3 at zero pressure and the `bulk_modulus` Pa.
    """

    porosity: np.ndarray
    retention: list[Retention]
    factors: np.ndarray
    density: float
    bulk_modulus: float

    def initial_saturation(self, material: int, pressure) -> np.ndarray:
        """S (n,) of a `material` at the start under `pressure` (n,) Pa."""
        pressure = np.asarray(pressure, float)
        porosity = np.full(len(pressure), self.porosity[material])
        return self.retention[material].saturation(-pressure, porosity, np.ones(len(pressure)))

    def mass_below(self, profile: Profile, material: int, position: np.ndarray, level: np.ndarray) -> np.ndarray:
        """Mass of water per area (n,) kg/m^2 in a `material` at the start, between a fixed level and `level` (n,) m.

        In columns through `position` (n, d) m.
        """
        level = np.asarray(level, float)
        full = self.density * self.porosity[material]
        if isinstance(profile, UniformSuction):
            return full * self.initial_saturation(material, profile.at(position[:1])) * level
        if isinstance(profile, GivenPressure):
            return full * self._filled_height(profile, material, position, level)
        table = profile.table(position, 0.0)
        below = np.minimum(level, table) - table
        above = np.maximum(level - table, 0.0)
        growing = profile.largest_suction / profile.weight
        nodes = np.linspace(0.0, growing, _NODES)
        filled = self.initial_saturation(material, -profile.weight * nodes)
        sums = np.append(0.0, np.cumsum(0.5 * (filled[1:] + filled[:-1]) * np.diff(nodes)))
        return full * (below + np.interp(above, nodes, sums) + filled[-1] * np.maximum(above - growing, 0.0))

    def _filled_height(self, profile: GivenPressure, material: int, position, level):
        """Height (n,) m of water above the level of `position` (n, d), by the trapezium rule."""
        rise = level - (position * profile.up).sum(axis=1)
        if self.retention[material].kind == FULL:
            return rise
        filled = np.zeros(len(level))
        for node in np.linspace(0.0, 1.0, _STEPS + 1):
            pressure = profile.at(position + (node * rise)[:, None] * profile.up)
            share = 0.5 if node in (0.0, 1.0) else 1.0
            filled += share / _STEPS * self.initial_saturation(material, pressure)
        return rise * filled
