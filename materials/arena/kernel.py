"""The compiled loop over rows: elastic rows leave early, the others are integrated in substeps."""

import math

import numpy as np

from periporo.core.jit import inlined, kernel
from periporo.materials.arena.elasticity import moduli
from periporo.materials.arena.integrate import advance, mean_moduli
from periporo.materials.arena.pores import harden
from periporo.materials.arena.surface import is_elastic, weakened_surface

EVP, PRESSURE, STRENGTH, FAILURES = 0, 1, 2, 3
"""Columns that every Arena state begins with; the optional ones follow."""


@inlined
def _deviator(values, out):
    """Trace of a tensor's first components `values`; its deviator into `out`."""
    trace = values[0] + values[1] + values[2]
    for k in range(3):
        out[k] = values[k] - trace / 3.0
    for k in range(3, values.shape[0]):
        out[k] = values[k]
    return trace


@inlined
def _product(a, b, components):
    """a:b of two tensors."""
    total = a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
    for k in range(3, components):
        total += 2.0 * a[k] * b[k]
    return total


@inlined
def _combine(out, trace, s, s_share, e, e_share):
    """out = trace/3 I + s_share s + e_share e."""
    for k in range(out.shape[0]):
        out[k] = s_share * s[k] + e_share * e[k]
    for k in range(3):
        out[k] += trace / 3.0


@inlined
def _elastic_moduli_of_step(m, c, y, control, state, tr, ss, se, ee):
    """Moduli of a row that stays elastic over the whole increment at the tolerance, else zeros."""
    effective = state[0] + 3.0 * state[4]
    k0, g0 = moduli(m, c, effective, state[4], state[3], tr < 0.0)
    if c.saturation > 0.0 and effective * (effective + 3.0 * k0 * tr) < 0.0:
        return 0.0, 0.0
    bulk, shear = mean_moduli(m, c, state, k0, tr)
    end = effective + 3.0 * bulk * tr
    j2 = max(0.5 * ss + 2.0 * shear * (se + shear * ee), 0.0)
    if not is_elastic(y, end, j2, state[5], 0.0):
        return 0.0, 0.0
    change = 3.0 * (bulk - k0) * tr
    drift = 2.0 * (shear - g0)
    size = control.tolerance * (math.sqrt(end * end / 3.0 + 2.0 * j2) + control.stress_scale)
    if change * change / 3.0 + drift * drift * ee > size * size:
        return 0.0, 0.0
    return bulk, shear


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
def _rate_time(control, dt, tr, ee):
    """Time step over relaxation time T1 rate^-T2 (eq. 83), infinite in quasi-static relaxation."""
    if dt == math.inf:
        return math.inf
    rate = math.sqrt(tr * tr / 3.0 + ee) / dt
    return dt * rate**control.relaxation_power / control.relaxation_time


@kernel
def update_rows(m, c, y_all, strength, control, columns, stress, increment, state, dt):
    """Advance `stress` (n, 4|6) and `state` (n, k) in place by `increment` (n, 4|6) over `dt` s.

    `columns` are the state's columns of damage time, strength factor and quasi-static stress, -1 where the
    material has none. A row whose update fails keeps its start state and is counted in its failure column.
    """
    components = stress.shape[1]
    time_column, factor_column, static_column = columns
    start = np.empty(components)
    s = np.empty(components)
    e = np.empty(components)
    viscous = static_column >= 0
    for b in range(stress.shape[0]):
        tr = _deviator(increment[b], e)
        for k in range(components):
            start[k] = state[b, static_column + k] if viscous else stress[b, k]
        i1 = _deviator(start, s)
        ss = _product(s, s, components)
        se = _product(s, e, components)
        ee = _product(e, e, components)
        if tr == 0.0 and ee == 0.0:  # the two follow from evp: make them exact, e.g. for newborn rows
            p, _, x, _ = harden(c, state[b, EVP], state[b, PRESSURE])
            state[b, PRESSURE] = p
            state[b, STRENGTH] = x - 3.0 * p
        p = state[b, PRESSURE]
        row = (i1, 0.0, 0.0, state[b, EVP], p, state[b, STRENGTH] + 3.0 * p)
        growth = state[b, time_column] if time_column >= 0 else -1.0
        factor = state[b, factor_column] if factor_column >= 0 else 1.0
        y = y_all
        if time_column >= 0 or factor_column >= 0:
            y = weakened_surface(strength, factor, growth)
        bulk = shear = 0.0
        if control.fixed_substeps == 0:
            bulk, shear = _elastic_moduli_of_step(m, c, y, control, row, tr, ss, se, ee)
        over_trace = over_s = over_e = 0.0
        if bulk > 0.0:
            trace, s_share, e_share = i1 + 3.0 * bulk * tr, 1.0, 2.0 * shear
            memory = math.exp(-_rate_time(control, dt, tr, ee)) if viscous else 0.0
        else:
            u0, e1, e2 = _basis(ss, se, ee)
            row = (i1, u0, 0.0, state[b, EVP], p, row[5])
            row, growth, over, memory, fine = advance(
                m, c, y, strength, factor, control, row, growth, dt, tr, e1, e2
            )
            if not fine:
                state[b, FAILURES] += 1.0
                continue
            trace = row[0]
            s_share, e_share = _shares(row[1], row[2], u0, e1, e2)
            over_trace = over[0]
            over_s, over_e = _shares(over[1], over[2], u0, e1, e2)
            state[b, EVP] = row[3]
            state[b, PRESSURE] = row[4]
            state[b, STRENGTH] = row[5] - 3.0 * row[4]
            if time_column >= 0:
                state[b, time_column] = growth
        if not viscous:
            _combine(stress[b], trace, s, s_share, e, e_share)
            continue
        for k in range(components):
            stress[b, k] = memory * (stress[b, k] - start[k]) if memory > 0.0 else 0.0
        _combine(start, over_trace, s, over_s, e, over_e)
        for k in range(components):
            stress[b, k] += start[k]
        _combine(start, trace, s, s_share, e, e_share)
        for k in range(components):
            state[b, static_column + k] = start[k]
            stress[b, k] += start[k]


@inlined
def _enclosing_strain(c, y, i1, j2):
    """Smallest volumetric plastic strain whose surface holds the stress (total I1, J2); NaN if none does."""
    low, step = 0.0, 1e-7
    p = c.pressure
    for _ in range(400):
        evp = low + step
        if evp >= c.p3:
            return math.nan
        p, _, x, _ = harden(c, evp, p)
        if is_elastic(y, i1 + 3.0 * p, j2, x, 0.0):
            break
        low = evp
        step *= 1.1
    high = evp
    for _ in range(60):
        evp = 0.5 * (low + high)
        p, _, x, _ = harden(c, evp, p)
        if is_elastic(y, i1 + 3.0 * p, j2, x, 0.0):
            high = evp
        else:
            low = evp
    return high


@kernel
def fill_initial(c, y_all, strength, columns, i1, j2, state):
    """Fill the leading columns of `state` (n, k) for rows of given total I1 and J2 (n,).

    The failure column is 1 where no yield surface holds the stress.
    """
    time_column, factor_column, _ = columns
    for b in range(state.shape[0]):
        y = y_all
        if time_column >= 0 or factor_column >= 0:
            factor = state[b, factor_column] if factor_column >= 0 else 1.0
            y = weakened_surface(strength, factor, 0.0 if time_column >= 0 else -1.0)
        evp = 0.0
        p, _, x, _ = harden(c, evp, c.pressure)
        if not is_elastic(y, i1[b] + 3.0 * p, j2[b], x, 1e-9):
            evp = _enclosing_strain(c, y, i1[b], j2[b])
            if math.isnan(evp):
                state[b, FAILURES] = 1.0
                continue
            p, _, x, _ = harden(c, evp, p)
        state[b, EVP] = evp
        state[b, PRESSURE] = p
        state[b, STRENGTH] = x - 3.0 * p
