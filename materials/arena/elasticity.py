"""Elastic moduli of Arena: drained, density-scaled, and Biot-Gassmann with the pore fluid."""

import math
from typing import NamedTuple

from periporo.core.jit import inlined, kernel
from periporo.materials.arena.pores import (
    AIR_EXPONENT,
    ATMOSPHERE,
    saturation_at,
    water_bulk_modulus,
)

GRAIN_BULK_MODULUS = 40e9  # K_s0, Pa
GRAIN_SLOPE = 4.0  # n_s = dK_s/dp
GRAIN_REFERENCE = 101325.0  # Pa


class Elasticity(NamedTuple):
    """Constants of the elastic law that kernels read; see `Arena` for the parameters behind them."""

    b0: float
    b1: float
    b2: float
    b3: float
    b4: float
    constant_shear: float
    nu1: float
    nu2: float
    density_factor: float
    scale_total: bool
    poisson_in_tension: bool
    keep_fluid: bool
    disaggregation: bool


@inlined
def drained(m, p):
    """Unscaled drained K, G and grain modulus K_s, Pa, at mean effective pressure `p` (compression > 0)."""
    if p > 0.0:
        grain = GRAIN_BULK_MODULUS + GRAIN_SLOPE * (p - GRAIN_REFERENCE)
        y = m.b3 * p / (m.b1 * grain - m.b2 * p)  # elastic strain to the power b4, eq. 89
        z = m.b2 * y + m.b3
        bulk = m.b0 + m.b1 * m.b3 * m.b4 * y ** (1.0 - 1.0 / m.b4) / (z * z)
        bulk *= grain * grain / (grain - GRAIN_SLOPE * p)
    else:
        grain = GRAIN_BULK_MODULUS
        bulk = m.b0 * grain
        if not m.poisson_in_tension:
            return bulk, m.constant_shear, grain
    poisson = m.nu1
    if m.nu2 != 0.0:
        poisson += m.nu2 * math.exp(-bulk / grain)
    shear = m.constant_shear
    if poisson > 0.0:
        shear = 1.5 * bulk * (1.0 - 2.0 * poisson) / (1.0 + poisson)
    return bulk, shear, grain


@inlined
def fluid_stiffens(m, c, i1, p, compressing):
    """Whether the pore fluid adds to the bulk modulus at effective I1 and pore pressure `p`.

    At I1 = 0 itself the side is the one that the strain increment enters.
    """
    if c.saturation == 0.0:
        return False
    return i1 < 0.0 or (m.keep_fluid and p > 0.0) or (i1 == 0.0 and compressing)


@inlined
def moduli(m, c, i1, p, evp, compressing):
    """Tangent bulk and shear modulus, Pa, at effective I1, pore pressure `p` and plastic strain `evp`."""
    bulk, shear, grain = drained(m, -i1 / 3.0)
    if not m.scale_total:
        bulk *= m.density_factor
        shear *= m.density_factor
    if fluid_stiffens(m, c, i1, p, compressing):
        porosity = 1.0 - (1.0 - c.phi0) * math.exp(evp)
        water = saturation_at(c, p)
        compressibility = water / water_bulk_modulus(p)
        if water < 1.0:
            compressibility += (1.0 - water) / (AIR_EXPONENT * (p + ATMOSPHERE))
        biot = 1.0 - bulk / grain
        bulk += biot * biot / (biot / grain + porosity * (compressibility - 1.0 / grain))
    if m.scale_total:
        bulk *= m.density_factor
        shear *= m.density_factor
    if m.disaggregation:
        loosening = max(math.exp(evp - c.p3), 1e-5)
        bulk *= loosening
        shear *= loosening
    return bulk, shear


@kernel
def fill_moduli(m, c, i1, p, evp, bulk, shear):
    """Fill `bulk` and `shear` (n,) Pa from effective I1, pore pressure and plastic strain (n,)."""
    for b in range(i1.shape[0]):
        bulk[b], shear[b] = moduli(m, c, i1[b], p[b], evp[b], True)
