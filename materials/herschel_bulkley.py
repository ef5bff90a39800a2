"""Mud and debris: elastic up to a yield stress, then a fluid whose shear stress grows with a power of its rate.

sqrt(J2) = tau_y + k gamma'^n with gamma' = sqrt(2 D':D') of the flow (Herschel & Bulkley 1926); n = 1 is Bingham's
fluid. Flow keeps its volume. Backward Euler of the elastic, viscoplastic law leaves one unknown, the rate.
"""

import math
from typing import ClassVar, Self

import numpy as np
from pydantic import Field, model_validator

from periporo.core.numerics.elasticity import elastic_trial
from periporo.core.numerics.jit import inlined, kernel
from periporo.core.numerics.tensors import filled
from periporo.core.points.material import OPENED, StateField
from periporo.materials.base import MaterialParameters, units

_PRESSURE, _DENSITY, _NUMBER, _CONSISTENCY = units("Pa", "kg/m^3", "1", "Pa s^n")

DISSIPATION = StateField("dissipation", "J/m^3")
_ENOUGH = 1e-12  # of the rate


class HerschelBulkley(MaterialParameters):
    """Mud whose shear stress sqrt(J2) is `yield_stress` + `consistency` times the rate of shear to the `exponent`.

    In plane shear that is the shear stress, and the rate that of the angle.
    """

    density: float = Field(gt=0, description="density of the mud", json_schema_extra=_DENSITY)
    bulk_modulus: float = Field(gt=0, description="bulk modulus K", json_schema_extra=_PRESSURE)
    shear_modulus: float = Field(gt=0, description="shear modulus mu below yield", json_schema_extra=_PRESSURE)
    yield_stress: float = Field(ge=0, description="tau_y, shear stress without flow", json_schema_extra=_PRESSURE)
    consistency: float = Field(
        ge=0, description="k, viscosity for exponent 1", json_schema_extra=_CONSISTENCY
    )
    exponent: float = Field(
        1.0, ge=0.1, le=3, description="n, below 1 for mud that thins in shear", json_schema_extra=_NUMBER
    )
    tension_cutoff: float = Field(0.0, ge=0, description="largest mean stress", json_schema_extra=_PRESSURE)
    report_dissipation: bool = Field(False, description="keep the plastic work of the last step in the state")

    exchanges_stress: ClassVar[bool] = True  # stress is all that it remembers

    @model_validator(mode="after")
    def _has_strength(self):
        if self.yield_stress == 0 and self.consistency == 0:
            raise ValueError("yield_stress and consistency are both 0: the material would have no strength")
        return self

    @classmethod
    def example(cls) -> Self:
        """A mud that thins in shear."""
        return cls(
            density=1500.0, bulk_modulus=5e6, shear_modulus=1e6, yield_stress=200.0, consistency=20.0, exponent=0.5
        )

    @property
    def state_fields(self) -> tuple[StateField, ...]:
        """`dissipation` if it is reported, and `opened`."""
        return (DISSIPATION, OPENED) if self.report_dissipation else (OPENED,)

    def weakened(self, factor: float) -> Self:
        """The law with the yield stress divided by `factor`; what the rate adds stays."""
        return self.model_copy(update={"yield_stress": self.yield_stress / factor})

    def _numbers(self) -> tuple[float, ...]:
        """K, mu, tau_y, k, n and the largest mean stress: (6,)."""
        elastic = self.bulk_modulus, self.shear_modulus
        return *elastic, self.yield_stress, self.consistency, self.exponent, self.tension_cutoff

    @classmethod
    def of_rows(cls, laws, components):
        """What answers for rows of which each has one of the `laws`."""
        return _Rows(np.array([law._numbers() for law in laws]), laws[0].report_dissipation)

    def initial_state(self, stress, ids, volume):
        """Closed, nothing dissipated: zeros."""
        return np.zeros((len(stress), len(self.state_fields)))

    def compute_stress(self, stress, strain_increment, state, dt):
        """Advance `stress` (n, 4|6) Pa by `strain_increment` in place over `dt` s."""
        _advance(np.array([self._numbers()]), dt, stress, strain_increment, state, self.report_dissipation)

    def tension_limit(self, stress, state):
        """Largest mean stress (n,) Pa of the rows, beyond which they open."""
        return filled(len(stress), self.tension_cutoff)

    def elastic_moduli(self, stress, state):
        """Constant moduli, two (n,) arrays in Pa."""
        n = len(stress)
        return filled(n, self.bulk_modulus), filled(n, self.shear_modulus)

    def yield_surface(self, stress_row, state_row):
        """Points (p, q) in Pa of the strength without flow, to beyond the given stress."""
        q = math.sqrt(3.0) * self.yield_stress
        limit, p = self.tension_cutoff, float(np.mean(stress_row[:3]))
        return np.array([limit, limit, min(1.5 * p, limit - q)]), np.array([0.0, q, q])


class _Rows:
    """Rows with `numbers` (n, 6) of their own."""

    def __init__(self, numbers, reports):
        self._numbers, self._reports = numbers, reports

    def compute_stress(self, stress, strain_increment, state, dt):
        _advance(self._numbers, dt, stress, strain_increment, state, self._reports)

    def tension_limit(self, stress, state):
        return self._numbers[:, 5].copy()

    def elastic_moduli(self, stress, state):
        return self._numbers[:, 0].copy(), self._numbers[:, 1].copy()


@inlined
def _rate(excess, stiffness, consistency, exponent):
    """The root g of stiffness g + consistency g^exponent = excess > 0, by Newton's method that comes from one side."""
    if exponent == 1.0 or consistency == 0.0:
        return excess / (stiffness + consistency)
    share = 1.0 if exponent > 1.0 else 0.5  # convex: from above; concave: from below
    g = (share * excess / consistency) ** (1.0 / exponent)
    if stiffness * g > share * excess:
        g = share * excess / stiffness
    for _ in range(100):
        viscous = consistency * g**exponent
        step = (stiffness * g + viscous - excess) / (stiffness + exponent * viscous / g)
        g -= step
        if abs(step) <= _ENOUGH * g:
            break
    return g


@kernel
def _advance(numbers, dt, stress, strain_increment, state, reports):
    """Hooke's law and return of all rows; `numbers` (n, 6) of each row, or (1, 6) of all, are those of the law."""
    for b in range(stress.shape[0]):
        n = numbers[b if numbers.shape[0] > 1 else 0]
        bulk, shear, strength, consistency, exponent, limit = n[0], n[1], n[2], n[3], n[4], n[5]
        p_trial, j2 = elastic_trial(bulk, shear, 0.5, b, stress, strain_increment)
        root = new_root = math.sqrt(j2)
        p = limit if p_trial > limit else p_trial
        if root > strength:
            new_root = strength
            if consistency > 0.0 and dt < math.inf:
                new_root = root - shear * dt * _rate(root - strength, shear * dt, consistency, exponent)
        if reports:
            state[b, 0] = p * (p_trial - p) / bulk + new_root * (root - new_root) / shear
        if p != p_trial or new_root != root:
            scale = new_root / root if root > 0.0 else 0.0
            for c in range(stress.shape[1]):
                stress[b, c] = scale * (stress[b, c] - (p_trial if c < 3 else 0.0)) + (p if c < 3 else 0.0)
