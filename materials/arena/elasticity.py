"""Elastic moduli of Arena: drained, density-scaled, and Biot-Gassmann with the pore fluid."""

import math

from periporo.core.numerics.jit import inlined, kernel
from periporo.materials.arena.constants import unpack_elasticity, unpack_pores
from periporo.materials.arena.pores import (
    AIR_EXPONENT,
    ATMOSPHERE,
    water_bulk_modulus,
    water_volume,
)
from periporo.materials.arena.power import power

GRAIN_BULK_MODULUS = 40e9  # K_s0, Pa
GRAIN_SLOPE = 4.0  # n_s = dK_s/dp
GRAIN_REFERENCE = 101325.0  # Pa
_INVERSE_GRAIN = 1.0 / (GRAIN_BULK_MODULUS - GRAIN_SLOPE * GRAIN_REFERENCE)


@inlined
def drained_bulk(m, p):
    """Unscaled drained K, dK/dp, and grain modulus K_s, Pa, at mean effective pressure `p` > 0 in compression."""
    if p <= 0.0:
        return m.b0 * GRAIN_BULK_MODULUS, 0.0, GRAIN_BULK_MODULUS
    # eqs 86, 88, 89 with b2 y + b3 = b1 b3 K_s / d and K_s - n_s p = constant inserted
    grain = GRAIN_BULK_MODULUS + GRAIN_SLOPE * (p - GRAIN_REFERENCE)
    d = m.b1 * grain - m.b2 * p
    y = m.b3 * p / d  # elastic strain to the power b4
    curve = m.curve * power(y, m.exponent) * d
    d_slope = m.b1 * GRAIN_SLOPE - m.b2
    bulk = (m.b0 * grain * grain + curve * d) * _INVERSE_GRAIN
    slope = 2.0 * m.b0 * grain * GRAIN_SLOPE + curve * (m.exponent * d / p + (2.0 - m.exponent) * d_slope)
    return bulk, slope * _INVERSE_GRAIN, grain


@inlined
def drained_shear(m, p, bulk, grain):
    """Unscaled shear modulus, Pa, that belongs to the unscaled drained `bulk` at `p`."""
    if p <= 0.0 and not m.poisson_in_tension:
        return m.constant_shear
    poisson = m.nu1
    if m.nu2 != 0.0:
        poisson += m.nu2 * math.exp(-bulk / grain)
    if poisson <= 0.0:
        return m.constant_shear
    return 1.5 * bulk * (1.0 - 2.0 * poisson) / (1.0 + poisson)


@inlined
def fluid_stiffens(m, c, i1, p, compressing):
    """Whether the pore fluid adds to the bulk modulus at effective I1 and pore pressure `p`.

    At I1 = 0 itself the side is the one that the strain increment enters.
    """
    if c.saturation == 0.0:
        return False
    return i1 < 0.0 or (m.keep_fluid and p > 0.0) or (i1 == 0.0 and compressing)


@inlined
def pore_fluid(c, p, evp):
    """Porosity and compressibility 1/K_f (1/Pa, eq. 93) of the air-water mixture; zeros for a dry soil."""
    if c.saturation == 0.0:
        return 0.0, 0.0
    growth = math.exp(evp)
    porosity = 1.0 - (1.0 - c.phi0) * growth
    if c.saturation == 1.0:
        return porosity, 1.0 / water_bulk_modulus(p)
    water = c.open_saturation
    if p > 0.0:  # then the pore volume is the fluid's
        water = c.saturation * water_volume(c, p)[0] * c.phi0 * growth / porosity
    return porosity, water / water_bulk_modulus(p) + (1.0 - water) / (AIR_EXPONENT * (p + ATMOSPHERE))


@inlined
def scaled_moduli(m, c, fluid, p, bulk, grain, evp, stiffened):
    """Bulk and shear modulus, Pa, from the unscaled drained `bulk`: density, pore fluid, disaggregation."""
    shear = drained_shear(m, p, bulk, grain)
    if not m.scale_total:
        bulk *= m.density_factor
    if stiffened:
        biot = 1.0 - bulk / grain
        bulk += biot * biot / (biot / grain + fluid[0] * (fluid[1] - 1.0 / grain))
    if m.scale_total:
        bulk *= m.density_factor
    shear *= m.density_factor
    if m.disaggregation:
        loosening = max(math.exp(evp - c.p3), 1e-5)
        bulk *= loosening
        shear *= loosening
    return bulk, shear


@inlined
def moduli(m, c, fluid, i1, p, evp, compressing):
    """Tangent bulk and shear modulus, Pa, at effective I1, pore pressure `p` and plastic strain `evp`.

    `fluid` is the result of `pore_fluid` at the same pressure and strain.
    """
    mean = -i1 / 3.0
    bulk, _, grain = drained_bulk(m, mean)
    stiffened = fluid_stiffens(m, c, i1, p, compressing)
    return scaled_moduli(m, c, fluid, mean, bulk, grain, evp, stiffened)


@kernel
def fill_moduli(elasticity, pores, i1, p, evp, bulk, shear):
    """Fill `bulk` and `shear` (n,) Pa from effective I1, pore pressure and plastic strain (n,)."""
    m = unpack_elasticity(elasticity)
    c = unpack_pores(pores)
    for b in range(i1.shape[0]):
        fluid = pore_fluid(c, p[b], evp[b])
        bulk[b], shear[b] = moduli(m, c, fluid, i1[b], p[b], evp[b], True)
