"""Pore fluid and crush curve of Arena: functions of the volumetric plastic strain alone.

`evp` is the volumetric plastic strain, positive in compaction. Pore pressure, porosity, saturation and
hydrostatic compressive strength follow from it in closed form; nothing is integrated.
"""

import math

from periporo.core.numerics.jit import inlined, kernel
from periporo.materials.arena.constants import unpack_pores
from periporo.materials.arena.power import power

AIR_EXPONENT = 1.4  # gamma of air; K_a = gamma (p + p_r), p is the gauge pressure
ATMOSPHERE = 101325.0  # p_r, Pa
WATER_BULK_MODULUS = 2.21e9  # K_w0 at the reference pressure, Pa
WATER_SLOPE = 6.029  # dK_w/dp
WATER_REFERENCE = 1e-4  # Pa


@inlined
def water_bulk_modulus(p):
    """Tangent bulk modulus of water K_w, Pa, at the gauge pressure `p`."""
    return WATER_BULK_MODULUS + WATER_SLOPE * (p - WATER_REFERENCE)


@inlined
def air_volume(c, p):
    """Volume of the air relative to the start: adiabatic compression from the initial pressure."""
    return power((p + ATMOSPHERE) / (c.pressure + ATMOSPHERE), -1.0 / AIR_EXPONENT)


@inlined
def water_volume(c, p):
    """Volume of the water relative to the start, and its tangent stiffness -V dp/dV, Pa."""
    stiffness = water_bulk_modulus(p)
    if c.logarithmic_water:
        return power(stiffness / water_bulk_modulus(c.pressure), -1.0 / WATER_SLOPE), stiffness
    rise = p - c.pressure
    return math.exp(-rise / stiffness), stiffness * stiffness / (stiffness - WATER_SLOPE * rise)


@inlined
def _air_pressure(c, volume):
    return (c.pressure + ATMOSPHERE) * power(volume, -AIR_EXPONENT) - ATMOSPHERE


@inlined
def _water_pressure(c, volume):
    initial = water_bulk_modulus(c.pressure)
    if c.logarithmic_water:
        return c.pressure + initial * (power(volume, -WATER_SLOPE) - 1.0) / WATER_SLOPE
    strain = -math.log(volume)
    return c.pressure + strain * initial / (1.0 - WATER_SLOPE * strain)


@inlined
def _mixed_pressure(c, volume, guess):
    """Root of (1-S0) V_air(p) + S0 V_water(p) = volume: pressure, compressibility, saturation.

    Newton on a falling convex function: from the left it cannot overshoot. A guess that is far off is
    replaced by the larger of the roots without water and without air, which both lie left.
    """
    p = guess
    far = True
    for _ in range(60):
        air = (1.0 - c.saturation) * air_volume(c, p)
        water_share, stiffness = water_volume(c, p)
        water = c.saturation * water_share
        compressibility = air / (AIR_EXPONENT * (p + ATMOSPHERE)) + water / stiffness
        step = (air + water - volume) / compressibility
        if far and abs(step) > 0.5 * (p + ATMOSPHERE):
            far = False
            p = max(0.0, _air_pressure(c, volume / (1.0 - c.saturation)))
            if volume < c.saturation:
                p = max(p, _water_pressure(c, volume / c.saturation))
            continue
        p = max(p + step, 0.0)
        if abs(step) <= 1e-7 * (p + ATMOSPHERE):
            break
    return p, compressibility, water / (air + water)


@inlined
def harden(c, evp, guess):
    """State of the pores at `evp`.

    Returns pore pressure and its slope in `evp`, the strength X_eff (tension positive, effective I1) and
    its slope, Pa. `guess` is a pressure near the result; only a partly saturated soil uses it.
    """
    shrink = math.exp(-evp)
    growth = math.expm1(-evp)
    volume = 1.0 + growth / c.phi0
    p = dp = 0.0
    saturation = c.saturation
    ds = 0.0
    if volume < c.open_volume:
        if c.saturation == 0.0:
            p = _air_pressure(c, volume)
            dp = AIR_EXPONENT * (p + ATMOSPHERE) * shrink / (c.phi0 * volume)
        elif c.saturation == 1.0:
            p = _water_pressure(c, volume)
            dp = water_volume(c, p)[1] * shrink / (c.phi0 * volume)
        else:
            p, compressibility, saturation = _mixed_pressure(c, volume, guess)
            dp = shrink / (c.phi0 * compressibility)
            stiffness = water_volume(c, p)[1] if c.p1_sat != 1.0 else 1.0
            ds = saturation * (1.0 - saturation) * (1.0 / (AIR_EXPONENT * (p + ATMOSPHERE)) - 1.0 / stiffness)
    else:
        saturation = c.open_saturation
    crush = dcrush = 0.0
    if evp > 0.0:
        ratio = -growth * (1.0 - c.phi0) / (c.phi0 * volume)  # phi0/phi - 1 without cancellation
        porosity = c.phi0 * volume / shrink
        crush = c.p1 * power(ratio, c.inverse_p2)
        dcrush = crush * c.inverse_p2 / ratio * c.phi0 * (1.0 - porosity) / (porosity * porosity)
    factor = 1.0 - (1.0 - c.p1_sat) * saturation
    drained = c.minimum_strength - c.p0 + crush
    strength = -(c.p0 + factor * drained)
    return p, dp, strength, -(factor * dcrush - (1.0 - c.p1_sat) * ds * dp * drained)


@inlined
def porosity_at(c, evp):
    """Porosity at the volumetric plastic strain `evp` (incompressible grains)."""
    return -math.expm1(evp + math.log1p(-c.phi0)) if evp < c.p3 else 0.0


@inlined
def saturation_at(c, p):
    """Water's share of the pore volume at pore pressure `p`."""
    if c.saturation == 0.0 or c.saturation == 1.0:
        return c.saturation
    air = (1.0 - c.saturation) * air_volume(c, p)
    water = c.saturation * water_volume(c, p)[0]
    return water / (air + water)


@kernel
def fill_pores(pores, evp, pressure, porosity, saturation):
    """Fill `porosity` and `saturation` (n,) from the volumetric plastic strain and pore pressure (n,)."""
    c = unpack_pores(pores)
    for b in range(evp.shape[0]):
        porosity[b] = porosity_at(c, evp[b])
        saturation[b] = saturation_at(c, pressure[b])
