"""Elastic moduli of Arena: drained, density-scaled, and Biot-Gassmann with the pore fluid."""

import math

from periporo.core.numerics.jit import inlined, kernel
from periporo.materials.arena.constants import unpack_elasticity, unpack_pores
from periporo.materials.arena.pores import (
    air_bulk_modulus,
    fluid_saturation,
    water_bulk_modulus,
)
from periporo.materials.arena.power import power

_LEAST_EFFECTIVE = 0.9  # of K_d, by which Q may exceed B^2 M


@inlined
def drained_bulk(m, p):
    """Unscaled drained K, dK/dp, and grain modulus K_s, Pa, at mean effective pressure `p` > 0 in compression."""
    if p <= 0.0:
        return m.b0 * m.grain, 0.0, m.grain
    # eqs 86, 88, 89 with b2 y + b3 = b1 b3 K_s / d and K_s - n_s p = constant inserted
    grain = m.grain + m.grain_slope * (p - m.grain_reference)
    d = m.b1 * grain - m.b2 * p
    y = m.b3 * p / d  # elastic strain to the power b4
    curve = m.curve * power(y, m.exponent) * d
    d_slope = m.b1 * m.grain_slope - m.b2
    bulk = (m.b0 * grain * grain + curve * d) * m.inverse_grain
    slope = 2.0 * m.b0 * grain * m.grain_slope + curve * (m.exponent * d / p + (2.0 - m.exponent) * d_slope)
    return bulk, slope * m.inverse_grain, grain


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

    At I1 = 0 itself the side is the one that the strain increment enters. Air alone counts only where elastic strain
    changes its pressure.
    """
    if c.saturation == 0.0 and not c.elastic_pressure:
        return False
    return i1 < 0.0 or (m.keep_fluid and p > 0.0) or (i1 == 0.0 and compressing)


@inlined
def pore_fluid(c, p, evp, content):
    """Porosity and compressibility 1/K_f (1/Pa, eq. 93) of the air-water mixture; zeros for a dry soil."""
    if c.saturation == 0.0 and not c.elastic_pressure:
        return 0.0, 0.0
    growth = math.exp(evp)
    porosity = 1.0 - (1.0 - c.phi0) * growth
    water = fluid_saturation(c, porosity / (growth * content), p)
    return porosity, water / water_bulk_modulus(c, p) + (1.0 - water) / air_bulk_modulus(c, p)


@inlined
def scaled_moduli(m, c, fluid, p, bulk, grain, evp, stiffened):
    """Bulk and shear modulus, Pa, from the unscaled drained `bulk`: density, pore fluid, disaggregation.

    The others are zero unless elastic strain changes the pore pressure. Then it rises by Q = B M times the elastic
    compression (Biot's modulus M = 1/[phi/K_f + (B - phi)/K_s]), and `bulk` is that of the effective stress,
    K - Q with Gassmann's K = K_d + B^2 M, so that Skempton's coefficient is Q/K. The third number is the compression's
    share in the pores: what a unit of it takes from their volume, relative to that. The fourth is Q, Pa. At some GPa
    the fluid becomes as stiff as the grains, and Q stays below K by a tenth of K_d: effective stress is to rise.
    """
    shear = drained_shear(m, p, bulk, grain)
    if not m.scale_total:
        bulk *= m.density_factor
    coupling = rise = 0.0
    if stiffened or c.elastic_pressure:
        drained = bulk
        biot = 1.0 - drained / grain
        modulus = 1.0 / (biot / grain + fluid[0] * (fluid[1] - 1.0 / grain))
        if stiffened:
            bulk += biot * biot * modulus
        if c.elastic_pressure:
            rise = min(biot * modulus, drained * _LEAST_EFFECTIVE + biot * biot * modulus)
            coupling = rise * fluid[1]
            if stiffened:
                bulk -= rise
            else:
                rise = 0.0
    if m.scale_total:
        bulk *= m.density_factor
    shear *= m.density_factor
    if m.disaggregation:
        loosening = max(math.exp(evp - c.p3), 1e-5)
        bulk *= loosening
        shear *= loosening
    return bulk, shear, coupling, rise


@inlined
def moduli(m, c, fluid, i1, p, evp, compressing):
    """The four results of `scaled_moduli` at effective I1, pore pressure `p` and plastic strain `evp`.

    `fluid` is the result of `pore_fluid` at the same pressure and strain.
    """
    mean = -i1 / 3.0
    bulk, _, grain = drained_bulk(m, mean)
    stiffened = fluid_stiffens(m, c, i1, p, compressing)
    return scaled_moduli(m, c, fluid, mean, bulk, grain, evp, stiffened)


@kernel
def fill_moduli(elasticity, pores, i1, p, evp, content, bulk, shear):
    """Fill `bulk` and `shear` (n,) Pa of the total stress from effective I1, pore pressure, plastic strain, content."""
    _fill(elasticity, pores, i1, p, evp, content, bulk, shear)


@inlined
def _fill(elasticity, pores, i1, p, evp, content, bulk, shear):
    m = unpack_elasticity(elasticity)
    c = unpack_pores(pores)
    for b in range(i1.shape[0]):
        fluid = pore_fluid(c, p[b], evp[b], content[b])
        effective, shear[b], _, rise = moduli(m, c, fluid, i1[b], p[b], evp[b], True)
        bulk[b] = effective + rise


@kernel
def fill_each_moduli(elasticity, pores, i1, p, evp, content, bulk, shear):
    """`fill_moduli` where rows have constants of their own, (n, ...) arrays."""
    for b in range(i1.shape[0]):
        own = slice(b, b + 1)
        _fill(elasticity[b], pores[b], i1[own], p[own], evp[own], content[own], bulk[own], shear[own])
