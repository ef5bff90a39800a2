"""Viscoplastic modified Cam-Clay with linear elasticity and, for unsaturated soil, suction bonding.

Yield function f = q^2/M^2 + p (p - p_c) with p < 0 and p_c < 0 in compression (Menon & Song 2022, eq. 40),
associated flow of Perzyna's kind (eq. 43) and backward Euler. The exponent of their eqs. 72, 75 and 84-86
has the wrong sign (compaction would soften): here p_c = p_c,n exp(-dev/(lambda - kappa)) with dev the
plastic volumetric strain, tension positive.
"""

import math
from functools import cached_property
from typing import ClassVar, Self

import numpy as np
from pydantic import Field, model_validator

from periporo.core.numerics.tensors import dimension_of, equivalent_shear, filled, mean
from periporo.core.points.material import BONDING, OPENED, StateField
from periporo.materials.base import MaterialParameters, units
from periporo.materials.cam_clay_return import advance, bonded_size, bonding_exponents
from periporo.materials.friction import FrictionAngles, angles_of_cone, shown

_PRESSURE, _DENSITY, _NUMBER, _VISCOSITY = units("Pa", "kg/m^3", "1", "Pa^3 s")

PRECONSOLIDATION = StateField("preconsolidation", "Pa", merge="log_mean")
DISSIPATION = StateField("dissipation", "J/m^3")
_LARGEST_PLANE_SLOPE = 1.0  # M of 35 degrees in plane strain: soils at the critical state have less


class CamClay(MaterialParameters):
    """Modified Cam-Clay; the state is p_c < 0 in Pa, followed by the columns that were asked for."""

    grain_density: float = Field(gt=0, description="density of the grains", json_schema_extra=_DENSITY)
    porosity: float = Field(ge=0, lt=1, description="initial porosity", json_schema_extra=_NUMBER)
    bulk_modulus: float | None = Field(None, gt=0, description="constant bulk modulus K", json_schema_extra=_PRESSURE)
    shear_modulus: float | None = Field(
        None, gt=0, description="constant shear modulus mu", json_schema_extra=_PRESSURE
    )
    poisson_ratio: float | None = Field(
        None, gt=-1, lt=0.5, description="in place of the moduli: K is the pressure over swelling_index",
        json_schema_extra=_NUMBER,
    )  # fmt: skip
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
    preoverburden: float = Field(
        0.0, ge=0, description="pressure once borne and gone, added to |p_c|: overconsolidation fades with depth",
        json_schema_extra=_PRESSURE,
    )  # fmt: skip
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
        constant = self.bulk_modulus is not None, self.shear_modulus is not None
        if constant[0] != constant[1] or constant[0] == (self.poisson_ratio is not None):
            raise ValueError(
                "give bulk_modulus and shear_modulus, which are constant, or poisson_ratio alone, with which K is the "
                "pressure over swelling_index"
            )
        if self.poisson_ratio is not None and self.swelling_index == 0:
            raise ValueError("swelling_index is 0, but the bulk modulus is to be the pressure over it")
        if self.preoverburden > 0 and self.preconsolidation is not None:
            raise ValueError("give preoverburden, which adds to the initial stress, or preconsolidation, not both")
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
        """`preconsolidation`, then `bonding` if unsaturated, then `dissipation` if reported, then `opened`."""
        return (
            (PRECONSOLIDATION,)
            + ((BONDING,) if self.unsaturated else ())
            + ((DISSIPATION,) if self.report_dissipation else ())
            + (OPENED,)
        )

    def for_unsaturated(self, initial_bonding: float = 0.0) -> "UnsaturatedCamClay":
        """The same soil with a state column `bonding` that a pore-water process writes."""
        return UnsaturatedCamClay(**self.model_dump(), initial_bonding=initial_bonding)

    def weakened(self, factor: float) -> Self:
        """The law with the critical state slope divided by `factor`; what soil remembers, p_c, stays.

        At given pressure, and undrained, soil then has the strength over `factor` at its critical state.
        """
        return self.model_copy(update={"critical_state_slope": self.critical_state_slope / factor})

    def initial_state(self, stress, ids, volume):
        """State (n, k) of rows at `stress` (n, 4|6) Pa.

        The overconsolidation ratio multiplies the p_c of the ellipse through the stress, p + q^2/(M^2 p), so
        that a ratio of 1 is at yield for every stress ratio; `preoverburden` is added. Tension starts at the floor.
        """
        state = np.zeros((len(stress), len(self.state_fields)))
        if self.preconsolidation is not None:
            size = np.full(len(stress), self.preconsolidation)
        else:
            p, q = mean(stress), equivalent_shear(stress)
            pressure = np.where(p < 0, -p, np.inf)
            through_stress = np.where(p < 0, -p, 0.0) + (q / self.critical_state_slope) ** 2 / pressure
            size = self.overconsolidation_ratio * through_stress + self.preoverburden
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
        advance(self._numbers[None], dt, stress, strain_increment, state, *self._columns)

    @property
    def _columns(self) -> tuple[int, int]:
        """Those of bonding and dissipation, -1 where there is none."""
        return 1 if self.unsaturated else -1, 1 + self.unsaturated if self.report_dissipation else -1

    @cached_property
    def _numbers(self) -> np.ndarray:
        """What the return needs to know of the parameters (12,): see `advance`."""
        first, second, swelling = self.bulk_modulus, self.shear_modulus, 0.0
        if self.poisson_ratio is not None:
            ratio = 1.5 * (1.0 - 2.0 * self.poisson_ratio) / (1.0 + self.poisson_ratio)
            first, second, swelling = 0.0, ratio, self.swelling_index
        return np.array([
            first, second, 6.0 / self.critical_state_slope**2, 4.0 * self.viscosity, self.minimum_preconsolidation,
            1.0 / (self.compression_index - self.swelling_index), *self._bonding_parameters(), swelling,
        ])  # fmt: skip

    @classmethod
    def of_rows(cls, laws, components):
        """What answers for rows of which each has one of the `laws`."""
        return _CamClayRows(laws)

    def _bonding_parameters(self) -> tuple[float, ...]:
        return (
            self.bonding_coefficient,
            self.bonding_exponent,
            self.reference_specific_volume,
            self.compression_index,
            self.swelling_index,
        )

    def tension_limit(self, stress, state):
        """Largest mean stress (n,) Pa, beyond which rows open: with the strength of loose soil they still touch."""
        return filled(len(stress), -self.minimum_preconsolidation)

    def elastic_moduli(self, stress, state):
        """Constant moduli, or those of the present pressure, two (n,) arrays in Pa."""
        if self.poisson_ratio is not None:
            return _moduli(self._numbers[None], stress)
        n = len(stress)
        return filled(n, self.bulk_modulus), filled(n, self.shear_modulus)

    def friction_angles(self, dimension: int) -> FrictionAngles:
        """The angles of the critical state in each kind of test; the same in both dimensions."""
        return angles_of_cone(self.critical_state_slope / math.sqrt(3.0))

    def doubts(self, stress, state) -> dict[str, str]:
        """What looks wrong about the parameters in the dimension of the rows, by subject."""
        angles = self.friction_angles(dimension_of(stress))
        in_plane = dimension_of(stress) == 2 and not self.critical_state_slope <= _LARGEST_PLANE_SLOPE
        if not in_plane and angles.compression is not None:
            return {}
        if in_plane:
            advice = "in plane strain M = sqrt(3) sin(phi) gives the angle phi"
            known = "" if angles.compression is None else f", {shown(angles.compression)} in triaxial compression"
            acting = f"acts as {shown(angles.plane_strain)} in plane strain{known}"
        else:
            acting, advice = "has no limit in triaxial compression", "M = 6 sin(phi)/(3 - sin(phi)) stays below 3"
        return {"friction": f"critical_state_slope {self.critical_state_slope:g} {acting}; {advice}"}

    def yield_surface(self, stress_row, state_row):
        """Points (p, q) in Pa of the yield ellipse of one row's state, for drawing."""
        size = -state_row[0]
        if self.unsaturated:
            b1, b2 = bonding_exponents(state_row[1], *self._bonding_parameters())
            size = bonded_size(size, b1, b2)
        angle = np.linspace(0.0, np.pi, 181)
        return -0.5 * size * (1 + np.cos(angle)), 0.5 * self.critical_state_slope * size * np.sin(angle)


class UnsaturatedCamClay(CamClay):
    """Cam-Clay whose p_c grows with the bonding variable xi in the state column `bonding`."""

    initial_bonding: float = Field(0.0, ge=0, description="xi at the start", json_schema_extra=_NUMBER)

    unsaturated: ClassVar[bool] = True


class _CamClayRows:
    """Rows with a law each."""

    def __init__(self, laws):
        self._numbers = np.array([law._numbers for law in laws])
        self._columns = laws[0]._columns

    def compute_stress(self, stress, strain_increment, state, dt):
        if not dt > 0:
            raise ValueError(f"the time step must be positive (infinite: rate-independent limit), not {dt}")
        advance(self._numbers, dt, stress, strain_increment, state, *self._columns)

    def tension_limit(self, stress, state):
        return -self._numbers[:, 4]

    def elastic_moduli(self, stress, state):
        return _moduli(self._numbers, stress)


def _moduli(numbers, stress) -> tuple[np.ndarray, np.ndarray]:
    """Constant moduli, or those of the present pressure, (n,) Pa, of rows with `numbers` (n or 1, 12)."""
    times = len(stress) // max(len(numbers), 1)
    bulk, shear = numbers[:, 0].repeat(times), numbers[:, 1].repeat(times)
    if not numbers[:, 11].any():
        return bulk, shear
    swelling = numbers[:, 11].repeat(times)
    follows = swelling > 0.0
    pressure = np.maximum(-mean(stress), numbers[:, 4])
    bulk = np.where(follows, pressure / np.where(follows, swelling, 1.0), bulk)
    return bulk, np.where(follows, shear * bulk, shear)
