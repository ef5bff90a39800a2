"""Columns of Arena's state, its yield surface in a row, and the state at the start."""

import math

from periporo.core.numerics.jit import inlined, kernel
from periporo.materials.arena.constants import unpack_pores, unpack_strength, unpack_surface
from periporo.materials.arena.pores import harden, pore_volume
from periporo.materials.arena.surface import holds, squared_limit, weakened_surface

EVP, PRESSURE, STRENGTH, CONTENT, OPENED = 0, 1, 2, 3, 4
"""Columns that every Arena state begins with; the optional ones follow."""

TIME, FACTOR, FACTORS, STATIC, PLASTIC, LENGTH, DISSIPATION = 0, 1, 2, 3, 4, 5, 6
"""Entries of `columns`: where the state has the damage time, the first of the strength factors, how many of these there
are, the quasi-static stress, the plastic strain, its length, the dissipation; -1 for what it lacks."""


@inlined
def surface_of(y, strength, columns, state, row):
    """Yield surface of a row, its strength factors (4) and its damage time, which is negative without damage.

    `y` is the surface of a row without damage and variability.
    """
    growth = state[row, columns[TIME]] if columns[TIME] >= 0 else -1.0
    factors = (1.0, 1.0, 1.0, 1.0)
    first = columns[FACTOR]
    if first >= 0:
        factor = state[row, first]
        factors = (factor, factor, factor, factor)
        if columns[FACTORS] == 4:
            factors = (factor, state[row, first + 1], state[row, first + 2], state[row, first + 3])
    if columns[TIME] >= 0 or first >= 0:
        return weakened_surface(strength, factors, growth), factors, growth
    return y, factors, growth


@inlined
def _enclosing_strain(c, y, ratio, i1, j2):
    """Smallest volumetric plastic strain whose surface holds the stress (effective I1, J2); NaN if none does.

    The surface is that of a strength X_eff `ratio` times smaller than the strain's: the soil is overconsolidated.
    """
    low = 0.0
    _, _, x, dx = harden(c, low, c.phi0, 0.0, c.pressure)
    while True:  # in steps over which the surface moves by less than its own length
        evp = low + min(1e-7 + 0.1 * low, 0.1 * (y.peak - x) / (1.0 - dx))
        if evp >= 0.999 * c.p3 or i1 > y.peak:
            return math.nan
        _, _, x, dx = harden(c, evp, pore_volume(c, evp), 0.0, c.pressure)
        if holds(y, i1, j2, x / ratio):
            break
        low = evp
    high = evp
    for _ in range(60):
        evp = 0.5 * (low + high)
        _, _, x, _ = harden(c, evp, pore_volume(c, evp), 0.0, c.pressure)
        if holds(y, i1, j2, x / ratio):
            high = evp
        else:
            low = evp
    return high


@kernel
def fill_initial(pores, surface, strengths, columns, ratio, i1, j2, state):
    """Fill the leading columns of `state` (n, k) for rows of given total I1 and J2 (n,).

    Their pores hold fluid at the initial pressure: they were consolidated drained, by `ratio` times the effective
    stress. The plastic strain is NaN where no yield surface holds the stress.
    """
    c = unpack_pores(pores)
    y_all = unpack_surface(surface)
    strength = unpack_strength(strengths)
    for b in range(state.shape[0]):
        y, _, _ = surface_of(y_all, strength, columns, state, b)
        evp = 0.0
        effective = i1[b] + 3.0 * c.pressure
        _, _, x, _ = harden(c, evp, c.phi0, 0.0, c.pressure)
        if not holds(y, effective, (1.0 - 1e-9) * j2[b], x / ratio):
            evp = _enclosing_strain(c, y, ratio, effective, j2[b])
        content = pore_volume(c, evp)
        p, _, x, _ = harden(c, evp, content, 0.0, c.pressure)
        state[b, EVP] = evp
        state[b, PRESSURE] = p
        state[b, STRENGTH] = x - 3.0 * p
        state[b, CONTENT] = content


@kernel
def fill_yield(surface, strengths, columns, i1, j2, state, peak, excess):
    """Fill each row's current PEAKI1 `peak` and its distance `excess` (n,) beyond the yield surface.

    The distance is a share of the surface's length: along sqrt J2 within its range of I1, along I1 beyond.
    """
    y_all = unpack_surface(surface)
    strength = unpack_strength(strengths)
    for b in range(state.shape[0]):
        y, _, _ = surface_of(y_all, strength, columns, state, b)
        peak[b] = y.peak
        pressure = state[b, PRESSURE]
        nose = state[b, STRENGTH] + 3.0 * pressure
        effective = i1[b] + 3.0 * pressure
        beyond = max(nose - effective, effective - y.peak)
        limit = math.sqrt(max(squared_limit(y, min(max(effective, nose), y.peak), nose), 0.0))
        excess[b] = max(beyond, math.sqrt(j2[b]) - limit) / (y.peak - nose)
