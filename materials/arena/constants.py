"""The model's constants as kernels read them: named tuples inside, plain arrays at the border.

Numba inspects a tuple field by field at each call, which takes longer than updating a thousand rows; an
array costs nothing. `pack` makes the array, the `unpack_` functions restore the names in the kernel.
"""

from typing import NamedTuple

import numpy as np

from periporo.core.numerics.jit import inlined

STRESS_FLOOR = 1000.0
"""Accuracy is relative to the stress plus this, Pa (or plus p0 if that is less)."""


class Elasticity(NamedTuple):
    """Constants of the elastic law; see `ArenaParameters` for their meaning."""

    grain: float  # bulk modulus at the reference pressure, Pa
    grain_slope: float
    grain_reference: float
    inverse_grain: float  # of K_s - n_s p, which is constant
    b0: float
    b1: float
    b2: float
    b3: float
    curve: float  # b4 / (b1 b3)
    exponent: float  # 1 - 1 / b4
    constant_shear: float
    nu1: float
    nu2: float
    density_factor: float
    scale_total: bool
    poisson_in_tension: bool
    keep_fluid: bool
    disaggregation: bool


class Pores(NamedTuple):
    """Constants of the pore space and of the crush curve."""

    phi0: float
    saturation: float
    pressure: float
    logarithmic_water: bool
    open_volume: float  # pore volume over its initial value at which the fluid is free of pressure
    open_saturation: float  # water's share then
    p0: float
    p1: float  # scaled by the density
    inverse_p2: float
    p3: float
    p1_sat: float
    minimum_strength: float
    air_exponent: float
    atmosphere: float
    water: float  # bulk modulus at the reference pressure, Pa
    water_slope: float
    water_reference: float
    elastic_pressure: bool  # whether elastic strain changes the pore pressure, too


class Surface(NamedTuple):
    """Coefficients of the yield surface and of the flow rule."""

    a1: float
    a2: float
    a3: float
    a4: float
    peak: float
    cap_ratio: float
    flow: float  # 3/2 BETA^2, where soil compacts
    opening: float  # the same where it dilates


class Strength(NamedTuple):
    """The four parameters that damage and variability change, intact and failed."""

    peak: float
    fslope: float
    stren: float
    yslope: float
    failed_peak: float
    failed_fslope: float
    failed_stren: float
    failed_yslope: float
    growth_speed: float
    time_at_failure: float
    cap_ratio: float
    flow: float
    opening: float


class Control(NamedTuple):
    """Accuracy of the integration and the rate dependence."""

    tolerance: float
    fixed_substeps: float
    stress_scale: float
    relaxation_time: float  # T1
    relaxation_power: float  # T2
    damage: bool
    damage_on_cap: bool


def pack(constants: NamedTuple) -> np.ndarray:
    """The fields of one of the tuples as an array; flags become 0 and 1."""
    return np.array(constants, dtype=float)


@inlined
def unpack_elasticity(a):
    """`Elasticity` from its array."""
    flags = (a[14] != 0.0, a[15] != 0.0, a[16] != 0.0, a[17] != 0.0)
    return Elasticity(
        a[0], a[1], a[2], a[3], a[4], a[5], a[6], a[7], a[8], a[9], a[10], a[11], a[12], a[13], *flags
    )  # fmt: skip


@inlined
def unpack_pores(a):
    """`Pores` from its array."""
    return Pores(
        a[0], a[1], a[2], a[3] != 0.0, a[4], a[5], a[6], a[7], a[8], a[9], a[10], a[11], a[12], a[13], a[14], a[15],
        a[16], a[17] != 0.0,
    )  # fmt: skip


@inlined
def unpack_surface(a):
    """`Surface` from its array."""
    return Surface(a[0], a[1], a[2], a[3], a[4], a[5], a[6], a[7])


@inlined
def unpack_strength(a):
    """`Strength` from its array."""
    return Strength(a[0], a[1], a[2], a[3], a[4], a[5], a[6], a[7], a[8], a[9], a[10], a[11], a[12])


@inlined
def unpack_control(a):
    """`Control` from its array."""
    return Control(a[0], a[1], a[2], a[3], a[4], a[5] != 0.0, a[6] != 0.0)
