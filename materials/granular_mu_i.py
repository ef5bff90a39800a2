"""Dry grains that flow: elastic up to a friction that grows with the inertial number.

mu(I) = mu_s + (mu_2 - mu_s)/(1 + I_0/I), I = gamma' d/sqrt(P/rho_s), with the rate of shear gamma' = sqrt(2 D':D') of
the plastic flow, the pressure P and the grains' diameter d and density rho_s (Jop, Forterre & Pouliquen 2006). Flow
keeps its volume. Backward Euler of the elastic, plastic law is a quadratic equation (Dunatunga & Kamrin 2015).
"""

import math
from typing import ClassVar, Self

import numpy as np
from pydantic import Field, model_validator

from periporo.core.numerics import algebra as la
from periporo.core.numerics.algebra import DIMENSION, LANES
from periporo.core.numerics.elasticity import add_elastic
from periporo.core.numerics.jit import inlined, kernel
from periporo.core.numerics.tensors import dimension_of, filled
from periporo.core.points.material import OPENED, StateField
from periporo.materials.base import MaterialParameters, units
from periporo.materials.friction import FrictionAngles, angles_of_cone

_PRESSURE, _DENSITY, _NUMBER, _LENGTH = units("Pa", "kg/m^3", "1", "m")

DISSIPATION = StateField("dissipation", "J/m^3")


class GranularMuI(MaterialParameters):
    """Cohesionless grains whose friction grows with the inertial number from `static_friction` to `largest_friction`.

    Frictions are ratios of shear stress sqrt(J2) to pressure, those of the tangent in plane shear at constant volume.
    """

    density: float = Field(gt=0, description="dry bulk density", json_schema_extra=_DENSITY)
    grain_density: float = Field(gt=0, description="density of the grains rho_s", json_schema_extra=_DENSITY)
    grain_diameter: float = Field(gt=0, le=10, description="diameter of the grains d", json_schema_extra=_LENGTH)
    bulk_modulus: float = Field(gt=0, description="bulk modulus K", json_schema_extra=_PRESSURE)
    shear_modulus: float = Field(gt=0, description="shear modulus mu", json_schema_extra=_PRESSURE)
    static_friction: float = Field(gt=0, le=2, description="mu_s, without flow", json_schema_extra=_NUMBER)
    largest_friction: float = Field(gt=0, le=2, description="mu_2, of fast flow", json_schema_extra=_NUMBER)
    inertial_number: float = Field(
        gt=0, description="I_0, at which friction is halfway in between", json_schema_extra=_NUMBER
    )
    report_dissipation: bool = Field(False, description="keep the plastic work of the last step in the state")

    exchanges_stress: ClassVar[bool] = True  # stress is all that it remembers

    @model_validator(mode="after")
    def _in_order(self):
        if self.largest_friction < self.static_friction:
            raise ValueError(
                f"largest_friction ({self.largest_friction:g}) must be at least static_friction "
                f"({self.static_friction:g}): faster flow has no less friction"
            )
        if self.density > self.grain_density:
            raise ValueError(
                f"density ({self.density:g}) must not exceed grain_density ({self.grain_density:g}): it is that of "
                "grains with pores"
            )
        return self

    @classmethod
    def example(cls) -> Self:
        """Glass beads of half a millimetre (Jop, Forterre & Pouliquen 2006)."""
        return cls(
            density=1500.0, grain_density=2500.0, grain_diameter=5e-4, bulk_modulus=10e6, shear_modulus=5e6,
            static_friction=math.tan(math.radians(20.9)), largest_friction=math.tan(math.radians(32.76)),
            inertial_number=0.279,
        )  # fmt: skip

    @property
    def state_fields(self) -> tuple[StateField, ...]:
        """`dissipation` if it is reported, and `opened`."""
        return (DISSIPATION, OPENED) if self.report_dissipation else (OPENED,)

    def weakened(self, factor: float) -> Self:
        """The law with both frictions divided by `factor`."""
        names = ("static_friction", "largest_friction")
        return self.model_copy(update={name: getattr(self, name) / factor for name in names})

    def friction_angles(self, dimension: int) -> FrictionAngles:
        """The angles of its cone without flow."""
        return angles_of_cone(self.static_friction)

    def initial_state(self, stress, ids, volume):
        """Closed, nothing dissipated: zeros."""
        return np.zeros((len(stress), len(self.state_fields)))

    def compute_stress(self, stress, strain_increment, state, dt):
        """Advance `stress` (n, 4|6) Pa by `strain_increment` in place over `dt` s."""
        _advance(*self._numbers(dt), stress, strain_increment, state, self.report_dissipation, _dim_of(stress))

    def _numbers(self, dt: float) -> tuple[float, ...]:
        """What the return needs to know of the parameters: see `_advance`."""
        slowness = self.inertial_number * self.shear_modulus * dt / (
            self.grain_diameter * math.sqrt(self.grain_density)
        )  # fmt: skip
        return self.bulk_modulus, self.shear_modulus, self.static_friction, self.largest_friction, slowness

    @classmethod
    def of_rows(cls, laws, components):
        """What answers for rows of which each has one of the `laws`."""
        return _GranularRows(laws)

    def tension_limit(self, stress, state):
        """Largest mean stress (n,) Pa of the rows, beyond which they open: none."""
        return np.zeros(len(stress))

    def elastic_moduli(self, stress, state):
        """Constant moduli, two (n,) arrays in Pa."""
        n = len(stress)
        return filled(n, self.bulk_modulus), filled(n, self.shear_modulus)

    def yield_surface(self, stress_row, state_row):
        """Points (p, q) in Pa of the cone without flow, to beyond the given stress."""
        p = np.array([0.0, min(1.5 * float(np.mean(stress_row[:3])), -1.0)])
        return p, -math.sqrt(3.0) * self.static_friction * p


class _GranularRows:
    """Rows with a law each."""

    def __init__(self, laws):
        self._law = laws[0]
        self._numbers = np.array([law._numbers(1.0) for law in laws])

    def compute_stress(self, stress, strain_increment, state, dt):
        _advance_each(self._numbers, dt, stress, strain_increment, state, self._law.report_dissipation, _dim_of(stress))

    def tension_limit(self, stress, state):
        return self._law.tension_limit(stress, state)

    def elastic_moduli(self, stress, state):
        return self._numbers[:, 0].copy(), self._numbers[:, 1].copy()


def _dim_of(stress) -> tuple[float, ...]:
    return DIMENSION[dimension_of(stress)]


@kernel
def _advance(bulk, shear, least, largest, slowness, stress, strain_increment, state, reports, dim):
    """Hooke's law and return of all rows; see `_return_lane`."""
    like = la.zero_symmetric(dim)
    tile = np.ones((len(like) + 1) * LANES)
    for base in range(0, stress.shape[0], LANES):
        count = min(LANES, stress.shape[0] - base)
        for k in range(count):
            add_elastic(bulk, shear, base + k, stress, strain_increment)
            la.to_lane(tile, 0, k, la.symmetric_at(stress, base + k, 0, dim))
        for k in range(LANES):
            _return_lane(least, largest, slowness, k, tile, dim)
        for k in range(count):
            la.store(stress, base + k, 0, la.from_lane(tile, 0, k, like))
            if reports:
                state[base + k, 0] = tile[len(like) * LANES + k] / shear


@kernel
def _advance_each(numbers, dt, stress, strain_increment, state, reports, dim):
    """`_advance` where rows have `numbers` (n, 5) of their own, with the slowness of a time step of 1 s."""
    like = la.zero_symmetric(dim)
    tile = np.ones((len(like) + 4) * LANES)
    for base in range(0, stress.shape[0], LANES):
        count = min(LANES, stress.shape[0] - base)
        for k in range(count):
            own = numbers[base + k]
            add_elastic(own[0], own[1], base + k, stress, strain_increment)
            la.to_lane(tile, 0, k, la.symmetric_at(stress, base + k, 0, dim))
            la.to_lane(tile, len(like) + 1, k, (own[2], own[3], dt * own[4]))
        for k in range(LANES):
            least, largest, slowness = la.from_lane(tile, len(like) + 1, k, (0.0, 0.0, 0.0))
            _return_lane(least, largest, slowness, k, tile, dim)
        for k in range(count):
            la.store(stress, base + k, 0, la.from_lane(tile, 0, k, like))
            if reports:
                state[base + k, 0] = tile[len(like) * LANES + k] / numbers[base + k, 1]


@inlined
def _return_lane(least, largest, slowness, k, tile, dim):
    """Return the trial stress in lane k; G times the plastic work behind it.

    `slowness` times sqrt(P) is G dt times the rate of shear at which I = I_0. With S = sqrt(J2) of the trial, a =
    slowness sqrt(P) and t = sqrt(J2) after the step, t = P mu(I) and G gamma' dt = S - t give t^2 - (S + mu_2 P + a) t
    + S mu_2 P + a mu_s P = 0.
    """
    s = la.from_lane(tile, 0, k, la.zero_symmetric(dim))
    p = (s[0] + s[1] + s[2]) / 3.0
    j2 = 0.5 * ((s[0] - p) ** 2 + (s[1] - p) ** 2 + (s[2] - p) ** 2)
    for c in range(3, len(s)):
        j2 += tile[c * LANES + k] ** 2
    root, pressure = math.sqrt(j2), 0.0 if p > 0.0 else -p
    slow = slowness * math.sqrt(pressure)
    least_root, largest_root = least * pressure, largest * pressure
    total, product = root + largest_root + slow, root * largest_root + slow * least_root
    new = 2.0 * product / (total + math.sqrt(max(total * total - 4.0 * product, 0.0)))
    new = least_root if slow == math.inf else new
    scale = new / root if root > least_root else 1.0
    scale = 0.0 if p > 0.0 else scale
    tile[len(s) * LANES + k] = scale * (1.0 - scale) * root * root
    for c in range(len(s)):
        old, mean = tile[c * LANES + k], p if c < 3 else 0.0
        returned = scale * (old - mean) + (0.0 if p > 0.0 else mean)
        tile[c * LANES + k] = old if scale == 1.0 else returned
