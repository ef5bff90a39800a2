"""The compiled loop over rows: elastic rows leave early, the others are integrated in substeps."""

import math

import numpy as np

from periporo.core.numerics.jit import inlined, kernel
from periporo.materials.arena.constants import (
    unpack_control,
    unpack_elasticity,
    unpack_pores,
    unpack_strength,
    unpack_surface,
)
from periporo.materials.arena.elasticity import (
    drained_bulk,
    fluid_stiffens,
    pore_fluid,
    scaled_moduli,
)
from periporo.materials.arena.integrate import advance
from periporo.materials.arena.pores import harden, pore_volume
from periporo.materials.arena.returns import strained_pores
from periporo.materials.arena.surface import holds, squared_limit, weakened_surface

EVP, PRESSURE, STRENGTH, CONTENT = 0, 1, 2, 3
"""Columns that every Arena state begins with; the optional ones follow."""


@inlined
def _split(values, row, first, components):
    """Trace and deviator (six numbers) of the tensor in the columns from `first` of one row.

    Written out: loops over four or six components would cost more than the arithmetic.
    """
    xx, yy, zz = values[row, first], values[row, first + 1], values[row, first + 2]
    yz = xz = 0.0
    if components == 6:
        yz, xz = values[row, first + 4], values[row, first + 5]
    trace = xx + yy + zz
    mean = trace / 3.0
    return trace, (xx - mean, yy - mean, zz - mean, values[row, first + 3], yz, xz)


@inlined
def _product(a, b):
    """a:b of two tensors."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + 2.0 * (a[3] * b[3] + a[4] * b[4] + a[5] * b[5])


@inlined
def _combine(trace, s, s_share, e, e_share):
    """trace/3 I + s_share s + e_share e, six numbers."""
    mean = trace / 3.0
    return (
        mean + s_share * s[0] + e_share * e[0],
        mean + s_share * s[1] + e_share * e[1],
        mean + s_share * s[2] + e_share * e[2],
        s_share * s[3] + e_share * e[3],
        s_share * s[4] + e_share * e[4],
        s_share * s[5] + e_share * e[5],
    )


@inlined
def _store(values, row, first, components, tensor):
    """Write six numbers into the columns from `first` of one row, four in plane strain."""
    values[row, first] = tensor[0]
    values[row, first + 1] = tensor[1]
    values[row, first + 2] = tensor[2]
    values[row, first + 3] = tensor[3]
    if components == 6:
        values[row, first + 4] = tensor[4]
        values[row, first + 5] = tensor[5]


@inlined
def _elastic_step(m, c, y, control, state, tr, ss, se, ee):
    """Shear modulus, effective I1, pore pressure, strength and content after an increment that stays elastic.

    All are zero if it does not, or not at the tolerance. The moduli are those of mid-step, from the value and the slope
    at the start: one power a row.
    """
    none = (0.0, 0.0, 0.0, 0.0, 0.0)
    effective = state[0] + 3.0 * state[4]
    mean = -effective / 3.0
    fluid = pore_fluid(c, state[4], state[3], state[6])
    stiffened = fluid_stiffens(m, c, effective, state[4], tr < 0.0)
    start, slope, grain = drained_bulk(m, mean)
    k0, _, coupling, _ = scaled_moduli(m, c, fluid, mean, start, grain, state[3], stiffened)
    half = -0.5 * k0 * tr
    if mean * (mean + 2.0 * half) < 0.0 or (mean == 0.0 and half > 0.0):
        return none  # the slope at the start tells nothing about the other side
    if mean > 0.0:
        grain += m.grain_slope * half
    drained = start + slope * half
    if coupling > 0.0:
        p, _, content = strained_pores(c, coupling, state, 0.5 * tr)
        fluid = pore_fluid(c, p, state[3], content)
    bulk, shear, coupling, _ = scaled_moduli(m, c, fluid, mean + half, drained, grain, state[3], stiffened)
    p, strength, content = strained_pores(c, coupling, state, tr)
    end = effective + 3.0 * bulk * tr
    j2 = max(0.5 * ss + 2.0 * shear * (se + shear * ee), 0.0)
    if not holds(y, end, j2, strength):
        return none
    change = 3.0 * (bulk - k0) * tr
    drift = 2.0 * shear * (drained - start) / drained
    size = end * end / 3.0 + 2.0 * j2 + control.stress_scale * control.stress_scale
    if change * change / 3.0 + drift * drift * ee > control.tolerance * control.tolerance * size:
        return none
    return shear, end, p, strength, content


@inlined
def _basis(ss, se, ee):
    """Coordinates of the deviators s = (u, 0) and e = (e1, e2) in an orthonormal basis of their plane."""
    u = math.sqrt(ss)
    if u == 0.0:
        return 0.0, math.sqrt(ee), 0.0
    e1 = se / u
    rest = ee - e1 * e1
    return u, e1, math.sqrt(rest) if rest > 1e-20 * ee else 0.0


@inlined
def _shares(u, w, u0, e1, e2):
    """Shares of s = (u0, 0) and e = (e1, e2) that make up the deviator (u, w)."""
    if u0 == 0.0:
        return 0.0, u / e1 if e1 != 0.0 else 0.0
    if e2 == 0.0:
        return u / u0, 0.0
    return (u - w * e1 / e2) / u0, w / e2


@inlined
def _is_overstressed(stress, state, row, static_column, components):
    """Whether the stress of a row differs from its quasi-static stress; not before it first yields."""
    overstressed = False
    for k in range(components):
        overstressed |= stress[row, k] != state[row, static_column + k]
    return overstressed


@inlined
def _rate_time(control, dt, tr, ee):
    """Time step over relaxation time T1 rate^-T2 (eq. 83), infinite in quasi-static relaxation."""
    if dt == math.inf:
        return math.inf
    rate = math.sqrt(tr * tr / 3.0 + ee) / dt
    return dt * rate**control.relaxation_power / control.relaxation_time


@kernel
def update_rows(elasticity, pores, surface, strengths, controls, columns, stress, increment, state, dt):
    """Advance `stress` (n, 4|6) and `state` (n, k) in place by `increment` (n, 4|6) over `dt` s.

    `columns` are the state's columns of damage time, strength factor and quasi-static stress, -1 where the
    material has none. A row whose update fails keeps its start state; the numbers of those rows are returned.
    """
    m = unpack_elasticity(elasticity)
    c = unpack_pores(pores)
    y_all = unpack_surface(surface)
    strength = unpack_strength(strengths)
    control = unpack_control(controls)
    components = stress.shape[1]
    time_column, factor_column, static_column = columns[0], columns[1], columns[2]
    viscous = static_column >= 0
    failed, failures = np.empty(0, np.int64), 0
    for b in range(stress.shape[0]):
        if state[b, STRENGTH] == 0.0:
            continue  # a row without state: a bond that is longer than the horizon still
        tr, e = _split(increment, b, 0, components)
        if viscous:
            i1, s = _split(state, b, static_column, components)
        else:
            i1, s = _split(stress, b, 0, components)
        ss = _product(s, s)
        se = _product(s, e)
        ee = _product(e, e)
        if tr == 0.0 and ee == 0.0:  # the two follow from evp: make them exact, e.g. for newborn rows
            p, _, x, _ = harden(c, state[b, EVP], state[b, CONTENT], 0.0, state[b, PRESSURE])
            state[b, PRESSURE] = p
            state[b, STRENGTH] = x - 3.0 * p
        p = state[b, PRESSURE]
        row = (i1, 0.0, 0.0, state[b, EVP], p, state[b, STRENGTH] + 3.0 * p, state[b, CONTENT])
        growth = state[b, time_column] if time_column >= 0 else -1.0
        factor = state[b, factor_column] if factor_column >= 0 else 1.0
        y = y_all
        if time_column >= 0 or factor_column >= 0:
            y = weakened_surface(strength, factor, growth)
        shear = effective = after = content = 0.0
        if control.fixed_substeps == 0.0:
            shear, effective, p, after, content = _elastic_step(m, c, y, control, row, tr, ss, se, ee)
        over_trace = over_s = over_e = 0.0
        if shear > 0.0:
            trace, s_share, e_share = effective - 3.0 * p, 1.0, 2.0 * shear
            memory = 0.0
            if c.elastic_pressure:
                state[b, PRESSURE], state[b, CONTENT] = p, content
                state[b, STRENGTH] = after - 3.0 * p
            if viscous and _is_overstressed(stress, state, b, static_column, components):
                memory = math.exp(-_rate_time(control, dt, tr, ee))
        else:
            u0, e1, e2 = _basis(ss, se, ee)
            row = (i1, u0, 0.0, row[3], row[4], row[5], row[6])
            row, growth, push, memory, fine = advance(
                m, c, y, strength, factor, control, row, growth, dt, tr, e1, e2
            )
            if not fine:
                if failures == len(failed):
                    failed = np.append(failed, np.empty(failures + 8, np.int64))
                failed[failures] = b
                failures += 1
                continue
            trace = row[0]
            s_share, e_share = _shares(row[1], row[2], u0, e1, e2)
            over_trace = push[0]
            over_s, over_e = _shares(push[1], push[2], u0, e1, e2)
            state[b, EVP] = row[3]
            state[b, PRESSURE] = row[4]
            state[b, STRENGTH] = row[5] - 3.0 * row[4]
            state[b, CONTENT] = row[6]
            if time_column >= 0:
                state[b, time_column] = growth
        static = _combine(trace, s, s_share, e, e_share)
        if not viscous:
            _store(stress, b, 0, components, static)
            continue
        over = _combine(over_trace, s, over_s, e, over_e)
        for k in range(components):  # the old overstress fades, the new one comes on top
            old = memory * (stress[b, k] - state[b, static_column + k]) if memory > 0.0 else 0.0
            stress[b, k] = static[k] + over[k] + old
        _store(state, b, static_column, components, static)
    return failed[:failures]


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
    time_column, factor_column = columns[0], columns[1]
    for b in range(state.shape[0]):
        y = y_all
        if time_column >= 0 or factor_column >= 0:
            factor = state[b, factor_column] if factor_column >= 0 else 1.0
            y = weakened_surface(strength, factor, 0.0 if time_column >= 0 else -1.0)
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
    time_column, factor_column = columns[0], columns[1]
    for b in range(state.shape[0]):
        y = y_all
        if time_column >= 0 or factor_column >= 0:
            growth = state[b, time_column] if time_column >= 0 else -1.0
            y = weakened_surface(strength, state[b, factor_column] if factor_column >= 0 else 1.0, growth)
        peak[b] = y.peak
        pressure = state[b, PRESSURE]
        nose = state[b, STRENGTH] + 3.0 * pressure
        effective = i1[b] + 3.0 * pressure
        beyond = max(nose - effective, effective - y.peak)
        limit = math.sqrt(max(squared_limit(y, min(max(effective, nose), y.peak), nose), 0.0))
        excess[b] = max(beyond, math.sqrt(j2[b]) - limit) / (y.peak - nose)
