"""The water that a point holds, and its pressure: one monotone scalar equation.

w = phi V S(-p) (1 + p/K_w), with the volume of the grains (1 - phi) V constant. Full pores answer with
p = K_w (w/(phi V) - 1); others with the suction of the retention curve. At p = 0 the two meet; the compressibility of
the water keeps the slope positive where the curve is flat.
"""

import numpy as np

from periporo.core.numerics import algebra as la
from periporo.core.numerics.jit import inlined, kernel
from periporo.core.water.bishop import factor_of
from periporo.core.water.retention import FULL, saturation_of, saturations

_CONVERGED = 1e-14  # of the volume, in the equation for the pressure
_MOST_ITERATIONS = 200
_FIRST_SUCTION = 1e3  # Pa
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(24)


def follow_volume(p, gradient, dt: float) -> None:
    """Let `pore_dilation` of the owned points take the volume ratio of a step of `dt` s with `gradient` (n, >= d^2)."""
    _follow_volume(p.owned, dt, gradient, p.share, p.pore_dilation, p.dim)


@kernel
def _follow_volume(owned, dt, gradient, share, dilation, dim):
    for i in range(owned):
        if share[i, 1] > 0.0:
            dilation[i] *= 1.0 / la.determinant_minus(la.scaled(la.matrix_at(gradient, i, 0, dim), dt))


def porosities(initial, dilation) -> np.ndarray:
    """phi (n,) where it was `initial` (n,), and the volume is `dilation` (n,) times that of then; pores close at 0."""
    return np.maximum(1.0 - (1.0 - initial) / dilation, 0.0)


@inlined
def porosity_of(initial, dilation):
    """The same of one point."""
    value = 1.0 - (1.0 - initial) / dilation
    return value if value > 0.0 or np.isnan(value) else 0.0


@kernel
def fill_content(owned, material, initial_porosity, volume, dilation, bulk, curves, pressure, saturation, content):
    """w m^3 and S of the owned points under their `pressure`."""
    for i in range(owned):
        m = material[i]
        porosity = porosity_of(initial_porosity[m], dilation[i])
        saturation[i], _ = saturation_of(curves, m, -pressure[i], porosity, dilation[i])
        content[i] = porosity * dilation[i] * volume[i] * saturation[i] * (1.0 + pressure[i] / bulk)


@kernel
def fill_pressure(owned, material, initial_porosity, volume, dilation, bulk, curves, content, saturation, pressure):
    """p Pa and S of the owned points that hold `content` m^3 of water."""
    for i in range(owned):
        m = material[i]
        porosity = porosity_of(initial_porosity[m], dilation[i])
        filled = content[i] / (porosity * dilation[i] * volume[i])
        if filled >= 1.0 or curves[m, 0] == FULL or np.isnan(filled):
            saturation[i], pressure[i] = 1.0, bulk * (filled - 1.0)
        else:
            s = _suction(curves, m, bulk, filled, -pressure[i], porosity, dilation[i])
            saturation[i], _ = saturation_of(curves, m, s, porosity, dilation[i])
            pressure[i] = -s


@inlined
def _suction(curves, m, bulk, filled, guess, porosity, ratio):
    """Suction at which S (1 - s/K_w) is `filled`, by Newton's method within a bracket that halves."""
    low, high = 0.0, bulk
    s = guess if 0.0 < guess < high else min(_FIRST_SUCTION, 0.5 * high)
    for _ in range(_MOST_ITERATIONS):
        value, slope = saturation_of(curves, m, s, porosity, ratio)
        excess = value * (1.0 - s / bulk) - filled
        if abs(excess) <= _CONVERGED:
            break
        if excess > 0.0:
            low = s
        else:
            high = s
        s -= excess / (slope * (1.0 - s / bulk) - value / bulk)
        if not low < s < high:
            s = 0.5 * (low + high) if low > 0.0 else 0.1 * high
        if high - low <= 1e-15 * high:
            break
    return s


def pore_stiffness(rows, material, initial_porosity, bulk: float, curves, factors, pressure, dilation) -> np.ndarray:
    """Rate of chi p with a volumetric strain of compression at constant w, (n,) Pa, of the points `rows`."""
    result = np.empty(len(rows))
    _fill_stiffness(rows, material, initial_porosity, bulk, curves, factors, pressure, dilation, result)
    return result


@kernel
def _fill_stiffness(rows, material, initial_porosity, bulk, curves, factors, pressure, dilation, result):
    for r in range(rows.shape[0]):
        i = rows[r]
        porosity = porosity_of(initial_porosity[material[i]], dilation[i])
        s, slope = saturation_of(curves, material[i], -pressure[i], porosity, dilation[i])
        chi, chi_slope = factor_of(factors, material[i], -pressure[i], s, slope)
        squeezed = 1.0 + pressure[i] / bulk
        rate = s * squeezed / (porosity * (s / bulk - slope * squeezed))  # of p
        result[r] = rate * max(chi - pressure[i] * chi_slope, 0.0)


def stored_energy(material, initial_porosity, bulk: float, curves, pressure, dilation, volume) -> np.ndarray:
    """Energy (n,) J of the water of points beyond that of full pores without pressure.

    In the volume V_p of the pores: what compresses the water, K_w V_p [(1 + x) ln(1 + x) - x] S with x = p/K_w, to the
    fourth order, and what air has taken the place of water against, V_p times the integral of s dS.
    """
    suction, x = np.maximum(-pressure, 0.0), pressure / bulk
    porosity = porosities(initial_porosity[material], dilation)
    saturation = saturations(curves, material, suction, porosity, dilation)
    energy = bulk * saturation * x * x * (0.5 - x / 6.0 + x * x / 12.0)
    if (saturation < 1.0).any():
        held = np.zeros(len(pressure))
        for node, weight in zip(0.5 * (1.0 + _NODES), 0.5 * _WEIGHTS, strict=True):
            held += weight * saturations(curves, material, node * suction, porosity, dilation)
        energy += suction * (held - saturation)
    return volume * dilation * porosity * energy
