"""Pore fluid and crush curve of Arena: functions of the volumetric plastic strain and of the fluid in the pores.

`evp` is the volumetric plastic strain, positive in compaction. `content` is the volume that the fluid would take at the
initial fluid pressure, over the initial volume of the soil: its porosity where the pores have not been drained. Where
elastic strain changes the pore pressure, too, `content` grows by what elastic compression takes from the pores. Pore
pressure, porosity, saturation and hydrostatic strength follow in closed form; nothing is integrated.
"""

import math

from periporo.core.numerics.jit import inlined, kernel
from periporo.materials.arena.constants import unpack_pores
from periporo.materials.arena.power import power


@inlined
def water_bulk_modulus(c, p):
    """Tangent bulk modulus of water K_w, Pa, at the gauge pressure `p`."""
    return c.water + c.water_slope * (p - c.water_reference)


@inlined
def air_bulk_modulus(c, p):
    """Adiabatic bulk modulus of air, Pa, at the gauge pressure `p`."""
    return c.air_exponent * (p + c.atmosphere)


@inlined
def air_volume(c, p):
    """Volume of the air relative to the start: adiabatic compression from the initial pressure."""
    return power((p + c.atmosphere) / (c.pressure + c.atmosphere), -1.0 / c.air_exponent)


@inlined
def water_volume(c, p):
    """Volume of the water relative to the start, and its tangent stiffness -V dp/dV, Pa."""
    stiffness = water_bulk_modulus(c, p)
    if c.logarithmic_water:
        return power(stiffness / water_bulk_modulus(c, c.pressure), -1.0 / c.water_slope), stiffness
    rise = p - c.pressure
    return math.exp(-rise / stiffness), stiffness * stiffness / (stiffness - c.water_slope * rise)


@inlined
def _air_pressure(c, volume):
    return (c.pressure + c.atmosphere) * power(volume, -c.air_exponent) - c.atmosphere


@inlined
def _water_pressure(c, volume):
    initial = water_bulk_modulus(c, c.pressure)
    if c.logarithmic_water:
        return c.pressure + initial * (power(volume, -c.water_slope) - 1.0) / c.water_slope
    strain = -math.log(volume)
    return c.pressure + strain * initial / (1.0 - c.water_slope * strain)


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
        compressibility = air / air_bulk_modulus(c, p) + water / stiffness
        step = (air + water - volume) / compressibility
        if far and abs(step) > 0.5 * (p + c.atmosphere):
            far = False
            p = max(0.0, _air_pressure(c, volume / (1.0 - c.saturation)))
            if volume < c.saturation:
                p = max(p, _water_pressure(c, volume / c.saturation))
            continue
        p = max(p + step, 0.0)
        if abs(step) <= 1e-7 * (p + c.atmosphere):
            break
    return p, compressibility, water / (air + water)


@inlined
def _fluid(c, volume, guess):
    """Pressure, tangent stiffness -V dp/dV, saturation and its slope in p of fluid of that `volume` (1 at the start).

    The stiffness is 0 where the pores are wider than the fluid that is free of pressure.
    """
    if volume >= c.open_volume:
        return 0.0, 0.0, c.open_saturation * c.open_volume / volume, 0.0
    if c.saturation == 0.0:
        p = _air_pressure(c, volume)
        return p, air_bulk_modulus(c, p), 0.0, 0.0
    if c.saturation == 1.0:
        p = _water_pressure(c, volume)
        return p, water_volume(c, p)[1], 1.0, 0.0
    p, compressibility, saturation = _mixed_pressure(c, volume, guess)
    slope = 0.0
    if c.p1_sat != 1.0:
        slope = saturation * (1.0 - saturation) * (1.0 / air_bulk_modulus(c, p) - 1.0 / water_volume(c, p)[1])
    return p, volume / compressibility, saturation, slope


@inlined
def harden(c, evp, content, coupling, guess):
    """State of the pores at `evp` with the fluid `content`.

    Returns pore pressure and its slope in `evp`, the strength X_eff (tension positive, effective I1) and
    its slope, Pa. `guess` is a pressure near the result; only a partly saturated soil uses it. Along a given total
    strain, plastic compaction gives back the elastic one: then `content` falls by `coupling` times its own size.
    """
    shrink = math.exp(-evp)
    growth = math.expm1(-evp)
    pores = c.phi0 + growth  # their volume over the initial volume
    p, stiffness, saturation, ds = _fluid(c, pores / content, guess)
    dp = stiffness * (shrink / pores - coupling)
    crush = dcrush = 0.0
    if evp > 0.0:
        ratio = -growth * (1.0 - c.phi0) / pores  # phi0/phi - 1 without cancellation
        porosity = pores / shrink
        crush = c.p1 * power(ratio, c.inverse_p2)
        dcrush = crush * c.inverse_p2 / ratio * c.phi0 * (1.0 - porosity) / (porosity * porosity)
    factor = 1.0 - (1.0 - c.p1_sat) * saturation
    drained = c.minimum_strength - c.p0 + crush
    strength = -(c.p0 + factor * drained)
    return p, dp, strength, -(factor * dcrush - (1.0 - c.p1_sat) * ds * dp * drained)


@inlined
def pore_volume(c, evp):
    """Volume of the pores over the initial volume of the soil, apart from elastic strain."""
    return c.phi0 + math.expm1(-evp)


@inlined
def porosity_at(c, evp):
    """Porosity at the volumetric plastic strain `evp` (incompressible grains)."""
    return -math.expm1(evp + math.log1p(-c.phi0)) if evp < c.p3 else 0.0


@inlined
def fluid_saturation(c, volume, p):
    """Water's share of pores of that `volume` (1 at the start) at pore pressure `p`; without, they may be wider."""
    if c.saturation == 0.0:
        return 0.0
    if volume >= c.open_volume:
        return c.open_saturation * c.open_volume / volume
    if c.saturation == 1.0:
        return 1.0
    return c.saturation * water_volume(c, p)[0] / volume


@kernel
def fill_pores(pores, evp, content, pressure, porosity, saturation):
    """Fill `porosity` and `saturation` (n,) from plastic strain, fluid content and pore pressure (n,)."""
    c = unpack_pores(pores)
    for b in range(evp.shape[0]):
        porosity[b] = porosity_at(c, evp[b])
        saturation[b] = fluid_saturation(c, pore_volume(c, evp[b]) / content[b], pressure[b])
