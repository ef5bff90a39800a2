"""Viscoplastic modified Cam-Clay with linear elasticity and, for unsaturated soil, suction bonding.

Yield function f = q^2/M^2 + p (p - p_c) with p < 0 and p_c < 0 in compression (Menon & Song 2022, eq. 40),
associated flow of Perzyna's kind (eq. 43) and backward Euler. The exponent of their eqs. 72, 75 and 84-86
has the wrong sign (compaction would soften): here p_c = p_c,n exp(-dev/(lambda - kappa)) with dev the
plastic volumetric strain, tension positive.
"""

import math
from typing import ClassVar, Self

import numpy as np
from pydantic import Field, model_validator

from periporo.core.jit import inlined, kernel
from periporo.core.tensors import equivalent_shear, mean
from periporo.materials.base import MaterialParameters
from periporo.materials.protocol import StateField

_KILOPASCAL = 1e3
_PRESSURE, _DENSITY, _NUMBER, _VISCOSITY = ({"unit": u} for u in ("Pa", "kg/m^3", "1", "Pa^3 s"))
_YIELD_TOLERANCE = 1e-11  # of p_c^2: a row that was returned before is not returned again
_NEWTON_TOLERANCE = 1e-5  # of the stress: the last, quadratic step then leaves about its square

PRECONSOLIDATION = StateField("preconsolidation", "Pa", merge="log_mean")
BONDING = StateField("bonding", "1")
DISSIPATION = StateField("dissipation", "J/m^3")


class CamClay(MaterialParameters):
    """Modified Cam-Clay; the state is p_c < 0 in Pa, followed by the columns that were asked for."""

    grain_density: float = Field(gt=0, description="density of the grains", json_schema_extra=_DENSITY)
    porosity: float = Field(ge=0, lt=1, description="initial porosity", json_schema_extra=_NUMBER)
    bulk_modulus: float = Field(gt=0, description="bulk modulus K", json_schema_extra=_PRESSURE)
    shear_modulus: float = Field(gt=0, description="shear modulus mu", json_schema_extra=_PRESSURE)
    critical_state_slope: float = Field(
        gt=0, description="M, the ratio q/|p| at the critical state", json_schema_extra=_NUMBER
    )
    compression_index: float = Field(
        gt=0, description="lambda, volumetric strain per ln p of virgin loading", json_schema_extra=_NUMBER
    )
    swelling_index: float = Field(
        ge=0, description="kappa, volumetric strain per ln p of unloading", json_schema_extra=_NUMBER
    )
    viscosity: float = Field(
        0.0, ge=0, description="eta of the flow rule, 0 for rate-independent", json_schema_extra=_VISCOSITY
    )
    overconsolidation_ratio: float = Field(
        1.0, ge=1, description="|p_c| over that of the initial stress at yield", json_schema_extra=_NUMBER
    )
    preconsolidation: float | None = Field(
        None, gt=0, description="initial |p_c|, in place of the ratio", json_schema_extra=_PRESSURE
    )
    minimum_preconsolidation: float = Field(
        1.0, gt=0, description="floor of |p_c|, the strength of loose soil", json_schema_extra=_PRESSURE
    )
    reference_specific_volume: float = Field(
        2.76, gt=0, description="N, specific volume at 1 kPa, for bonding", json_schema_extra=_NUMBER
    )
    bonding_coefficient: float = Field(
        0.185, ge=0, description="c1 of the bonding by suction", json_schema_extra=_NUMBER
    )
    bonding_exponent: float = Field(
        1.42, ge=0, description="c2 of the bonding by suction", json_schema_extra=_NUMBER
    )
    report_dissipation: bool = Field(False, description="keep the plastic work of the last step in the state")

    unsaturated: ClassVar[bool] = False

    @model_validator(mode="after")
    def _indices_in_order(self):
        if not self.compression_index > self.swelling_index:
            raise ValueError(
                f"compression_index ({self.compression_index:g}) must exceed swelling_index "
                f"({self.swelling_index:g}): their difference is the plastic compressibility"
            )
        return self

    @classmethod
    def example(cls) -> Self:
        """The soil of Menon & Song (2022, section 4.2)."""
        return cls(
            grain_density=2200.0,
            porosity=0.2,
            bulk_modulus=25e6,
            shear_modulus=15e6,
            critical_state_slope=1.1,
            compression_index=0.12,
            swelling_index=0.04,
            viscosity=1e3,
            overconsolidation_ratio=1.25,
        )

    @property
    def density(self) -> float:
        """Dry bulk density, kg/m^3."""
        return self.grain_density * (1.0 - self.porosity)

    @property
    def state_fields(self) -> tuple[StateField, ...]:
        """`preconsolidation`, then `bonding` if unsaturated, then `dissipation` if reported."""
        return (
            (PRECONSOLIDATION,)
            + ((BONDING,) if self.unsaturated else ())
            + ((DISSIPATION,) if self.report_dissipation else ())
        )

    def for_unsaturated(self, initial_bonding: float = 0.0) -> "UnsaturatedCamClay":
        """The same soil with a state column `bonding` that a pore-water process writes."""
        return UnsaturatedCamClay(**self.model_dump(), initial_bonding=initial_bonding)

    def initial_state(self, stress, ids, volume):
        """State (n, k) of rows at `stress` (n, 4|6) Pa.

        The overconsolidation ratio multiplies the p_c of the ellipse through the stress, p + q^2/(M^2 p), so
        that a ratio of 1 is at yield for every stress ratio. Tension starts at the floor.
        """
        state = np.zeros((len(stress), len(self.state_fields)))
        if self.preconsolidation is not None:
            size = np.full(len(stress), self.preconsolidation)
        else:
            p, q = mean(stress), equivalent_shear(stress)
            pressure = np.where(p < 0, -p, np.inf)
            through_stress = np.where(p < 0, -p, 0.0) + (q / self.critical_state_slope) ** 2 / pressure
            size = self.overconsolidation_ratio * through_stress
        state[:, 0] = -np.maximum(size, self.minimum_preconsolidation)
        if self.unsaturated:
            state[:, 1] = self.initial_bonding
        return state

    def compute_stress(self, stress, strain_increment, state, dt):
        """Advance `stress` (n, 4|6) Pa and `state` (n, k) by `strain_increment` in `dt` > 0 s, in place.

        An infinite `dt`, like no viscosity, gives the rate-independent limit.
        """
        if not dt > 0:
            raise ValueError(f"the time step must be positive (infinite: rate-independent limit), not {dt}")
        _advance(
            self.bulk_modulus,
            self.shear_modulus,
            self.critical_state_slope,
            self.viscosity / dt,
            self.minimum_preconsolidation,
            self._bonding_parameters(),
            stress,
            strain_increment,
            state,
            1 if self.unsaturated else -1,
            len(self.state_fields) - 1 if self.report_dissipation else -1,
        )

    def _bonding_parameters(self) -> tuple[float, ...]:
        return (
            self.bonding_coefficient,
            self.bonding_exponent,
            self.reference_specific_volume,
            self.compression_index,
            self.swelling_index,
        )

    def elastic_moduli(self, stress, state):
        """Constant moduli, two (n,) arrays in Pa."""
        n = len(stress)
        return np.full(n, self.bulk_modulus), np.full(n, self.shear_modulus)

    def yield_surface(self, stress_row, state_row):
        """Points (p, q) in Pa of the yield ellipse of one row's state, for drawing."""
        size = -state_row[0]
        if self.unsaturated:
            b1, b2 = bonding_exponents(state_row[1], *self._bonding_parameters())
            size = _bonded_size(size, b1, b2)
        angle = np.linspace(0.0, np.pi, 181)
        return -0.5 * size * (1 + np.cos(angle)), 0.5 * self.critical_state_slope * size * np.sin(angle)


class UnsaturatedCamClay(CamClay):
    """Cam-Clay whose p_c grows with the bonding variable xi in the state column `bonding`."""

    initial_bonding: float = Field(0.0, ge=0, description="xi at the start", json_schema_extra=_NUMBER)

    unsaturated: ClassVar[bool] = True


@inlined
def bonding_exponents(bonding, c1, c2, specific_volume, compression, swelling):
    """b1, b2 of |p_c,bonded| = exp(b1) |p_c|^b2 in kPa (Borja 2004; Gallipoli et al. 2003).

    The virgin line of bonded soil is v = c (N - lambda ln|p|) with c = 1 - c1 (1 - exp(c2 xi)); that both p_c
    lie on one swelling line of slope kappa gives b1 = N (c - 1)/(lambda c - kappa) and b2 = (lambda - kappa)/
    (lambda c - kappa).
    """
    c = 1.0 + c1 * math.expm1(c2 * bonding)
    slope = compression * c - swelling
    return specific_volume * (c - 1.0) / slope, (compression - swelling) / slope


@inlined
def _bonded_size(size, b1, b2):
    return _KILOPASCAL * math.exp(b1) * (size / _KILOPASCAL) ** b2


@inlined
def _exponential(y):
    """exp(y): the series where it is exact to rounding, for most steps are small and it is faster."""
    if abs(y) < 1e-2:
        return 1.0 + y * (1.0 + y / 2.0 * (1.0 + y / 3.0 * (1.0 + y / 4.0 * (1.0 + y / 5.0 * (1.0 + y / 6)))))
    return math.exp(y)


@inlined
def _overstressed_scale(w, radius_squared, size_squared, overstress):
    """Root of w^3 B + (V - P^2) w - V by Newton, started where w^2 B >= P^2.

    The cubic is convex and increases there: after the first step the iterates fall monotonically.
    """
    constant = overstress - size_squared
    for _ in range(100):
        square = w * w * radius_squared
        step = (w * (square + constant) - overstress) / (3.0 * square + constant)
        w -= step
        if abs(step) <= 1e-6 * w:
            break
    return w


@inlined
def _shear_scale(guess, u, u_slope, a2, size, hardening, overstress):
    """q/q_trial = w <= 1 on the (overstressed) yield surface, and dw/dx; see `_return_to_yield`."""
    radius_squared = u * u + a2
    size_squared = size * size
    if radius_squared <= size_squared:
        return 1.0, 0.0
    if overstress == 0.0:
        inverse = 1.0 / math.sqrt(radius_squared)
        w = size * inverse
        return w, -inverse * (hardening + w * inverse * u * u_slope)
    if not guess * abs(guess) * radius_squared > size_squared:
        guess = size / math.sqrt(radius_squared)
    w = _overstressed_scale(guess, radius_squared, size_squared, overstress)
    square = w * w
    curvature = 3.0 * square * radius_squared + overstress - size_squared
    return w, -2.0 * w * (size * hardening + square * u * u_slope) / curvature


@inlined
def _return_to_yield(p_trial, a2, size_start, floor, bulk, c, stiffening, overstress):
    """Plastic volumetric strain x, w = q/q_trial and new size P = |p_c| of a flowing row.

    The unknown is x = dgamma d with d = df/dp = 2 p + P: p = p_trial - K x and P = P_n exp(-x/(lambda -
    kappa)) follow from it without iteration. With u = d + c x, c = 6 mu/M^2 and a = 2 q_trial/M, flow in
    shear is w = d/u, and the yield condition with overstress V = 4 eta/(c dt) is w^2 (u^2 + a^2) = P^2 +
    V (1/w - 1), which gives w(x). What is left is T(x) = w u - d = 0. It is smooth, also at the critical
    state (u = d = x = 0), and nearly linear; its root lies between 0 and the x that takes p to the middle of
    the ellipse.
    """
    x, size, hardening = 0.0, size_start, size_start * stiffening
    low, high = 0.0, (2.0 * p_trial + size_start) / (2.0 * bulk)
    dilates = high > 0.0
    w = 0.0
    for iteration in range(200):
        d = 2.0 * (p_trial - bulk * x) + size
        d_slope = -2.0 * bulk - hardening
        u, u_slope = d + c * x, d_slope + c
        w, w_slope = _shear_scale(w, u, u_slope, a2, size, hardening, overstress)
        residual = (w - 1.0) * d + w * c * x
        step = -residual / (w_slope * u + (w - 1.0) * d_slope + w * c)
        small = _NEWTON_TOLERANCE * min(size, size_start)
        if abs(residual) <= small and abs(step * d_slope) <= small:
            x += step
            w += w_slope * step
            size -= hardening * step * (1.0 - 0.5 * stiffening * step)
            break
        if (residual > 0.0) == dilates:
            high = x
        else:
            low = x
        new = x + step
        if not (new - low) * (new - high) < 0.0 or iteration % 8 == 7:  # Newton may cycle: bisect
            new = 0.5 * (low + high)
        if new == x:
            break
        w += w_slope * (new - x)
        x = new
        size = size_start * _exponential(-stiffening * x)
        hardening = size * stiffening
        if size < floor:
            size, hardening = floor, 0.0
    return x, w, max(size, floor)


@kernel
def _advance(
    bulk,
    shear,
    slope,
    viscosity_rate,
    minimum,
    bonding_parameters,
    stress,
    strain_increment,
    state,
    bonding_column,
    dissipation_column,
):
    components = stress.shape[1]
    c = 6.0 * shear / slope**2
    overstress = 4.0 * viscosity_rate / c
    index = 1.0 / (bonding_parameters[3] - bonding_parameters[4])
    for b in range(stress.shape[0]):
        if dissipation_column >= 0:
            state[b, dissipation_column] = 0.0
        volumetric = strain_increment[b, 0] + strain_increment[b, 1] + strain_increment[b, 2]
        lame = (bulk - 2.0 / 3.0 * shear) * volumetric
        for k in range(3):
            stress[b, k] += lame + 2.0 * shear * strain_increment[b, k]
        p_trial = (stress[b, 0] + stress[b, 1] + stress[b, 2]) / 3.0
        square = (stress[b, 0] - p_trial) ** 2 + (stress[b, 1] - p_trial) ** 2 + (stress[b, 2] - p_trial) ** 2
        for k in range(3, components):
            stress[b, k] += 2.0 * shear * strain_increment[b, k]
            square += 2.0 * stress[b, k] ** 2
        q_squared = 1.5 * square

        unbonded = minimum if -state[b, 0] < minimum else -state[b, 0]  # keeps NaN, unlike max
        size, floor, stiffening = unbonded, minimum, index
        if bonding_column >= 0 and state[b, bonding_column] != 0.0:
            b1, b2 = bonding_exponents(state[b, bonding_column], *bonding_parameters)
            size, floor = _bonded_size(unbonded, b1, b2), _bonded_size(minimum, b1, b2)
            stiffening = index * b2
        if not q_squared / slope**2 + p_trial * (p_trial + size) > _YIELD_TOLERANCE * size * size:
            continue

        x, w, new_size = _return_to_yield(
            p_trial, 4.0 * q_squared / slope**2, size, floor, bulk, c, stiffening, overstress
        )
        p = p_trial - bulk * x
        for k in range(3):
            stress[b, k] = p + w * (stress[b, k] - p_trial)
        for k in range(3, components):
            stress[b, k] *= w
        if stiffening == index:
            state[b, 0] = -new_size
        else:
            state[b, 0] = -max(unbonded * math.exp(-index * x), minimum)
        if dissipation_column >= 0:
            state[b, dissipation_column] = p * x + w * (1.0 - w) * q_squared / (3.0 * shear)
