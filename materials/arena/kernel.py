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
from periporo.materials.arena.pores import harden
from periporo.materials.arena.returns import strained_pores
from periporo.materials.arena.state import (
    CONTENT,
    DISSIPATION,
    EVP,
    LENGTH,
    OPENED,
    PLASTIC,
    PRESSURE,
    STATIC,
    STRENGTH,
    TIME,
    surface_of,
)
from periporo.materials.arena.surface import holds, shear_limit
from periporo.materials.arena.tensor_rows import basis, combine, plus, product, shares, split, store

_OFFERED = 6.0  # twice the largest dilation over y.opening and the slope, for a shear strain of 1


@inlined
def _elastic_step(m, c, y, control, state, tr, ss, se, ee):
    """Moduli, effective I1, pore pressure, strength and content after an increment that stays elastic.

    All are zero if it does not, or not at the tolerance. The moduli are those of mid-step, from the value and the slope
    at the start: one power a row.
    """
    none = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
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
    return bulk, shear, end, p, strength, content


@inlined
def _is_overstressed(stress, state, row, static_column, components):
    """Whether the stress of a row differs from its quasi-static stress; not before it first yields."""
    overstressed = False
    for k in range(components):
        overstressed |= stress[row, k] != state[row, static_column + k]
    return overstressed


@inlined
def _faded(stress, state, row, static_column, components, memory, new, opened):
    """The overstress: the old one fades, the new one, six numbers, comes on top; soil that is open has none."""
    if opened > 0.0:
        return 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    if memory == 0.0:
        return new
    over, yz, xz = static_column, 0.0, 0.0
    if components == 6:
        yz = memory * (stress[row, 4] - state[row, over + 4])
        xz = memory * (stress[row, 5] - state[row, over + 5])
    return (
        new[0] + memory * (stress[row, 0] - state[row, over]),
        new[1] + memory * (stress[row, 1] - state[row, over + 1]),
        new[2] + memory * (stress[row, 2] - state[row, over + 2]),
        new[3] + memory * (stress[row, 3] - state[row, over + 3]),
        new[4] + yz,
        new[5] + xz,
    )


@inlined
def _is_still(increment, row, components):
    """Whether a row has no strain increment."""
    still = True
    for k in range(components):
        still &= increment[row, k] == 0.0
    return still


@inlined
def _rate_time(control, dt, tr, ee):
    """Time step over relaxation time T1 rate^-T2 (eq. 83), infinite in quasi-static relaxation."""
    if dt == math.inf:
        return math.inf
    rate = math.sqrt(tr * tr / 3.0 + ee) / dt
    return dt * rate**control.relaxation_power / control.relaxation_time


@inlined
def _viscous_work(row, bulk, shear, pressure, stress, state, static, components, new):
    """Work per volume of the overstress: on the plastic strain, less what it stores, of the mean of both ends.

    With the overstress o, static effective stress s and plastic strain e it is o:e - (s + o):C^-1:do. `new` holds what
    comes to the row: static stress, overstress, plastic strain, each six numbers; `pressure` the pore pressure before
    and after.
    """
    on_strain = stored = trace = change_trace = 0.0
    pore = 0.5 * (pressure[0] + pressure[1])
    for k in range(components):
        old_static = state[row, static + k]
        old, now = stress[row, k] - old_static, new[1][k]
        over, change = 0.5 * (old + now), now - old
        effective = 0.5 * (old_static + new[0][k]) + over + (pore if k < 3 else 0.0)
        weight = 1.0 if k < 3 else 2.0
        on_strain += weight * over * new[2][k]
        stored += weight * effective * change
        if k < 3:
            trace += effective
            change_trace += change
    mean_part = trace * change_trace / 3.0
    return on_strain - mean_part / (3.0 * bulk) - (stored - mean_part) / (2.0 * shear)


@inlined
def _start(c, m, y_all, strength, columns, stress, increment, state, b, components):
    """What a step of row b begins with.

    Its trace and deviators, their products, the row's seven numbers but the deviator's, its surface with factors and
    damage time, and the opened strain. Soil that is open expands into its gap, by the pressure that it bears and by
    what it may dilate in shear.
    """
    tr, e = split(increment, b, 0, components)
    if columns[STATIC] >= 0:
        i1, s = split(state, b, columns[STATIC], components)
    else:
        i1, s = split(stress, b, 0, components)
    ee = product(e, e)
    p = state[b, PRESSURE]
    row = (i1, 0.0, 0.0, state[b, EVP], p, state[b, STRENGTH] + 3.0 * p, state[b, CONTENT])
    y, factors, growth = surface_of(y_all, strength, columns, state, b)
    opened = state[b, OPENED]
    if opened > 0.0:
        filled = max(y.peak - i1 - 3.0 * p, 0.0) / (m.b0 * m.grain * m.density_factor)
        filled = min(filled - _OFFERED * y.opening * shear_limit(y, y.peak)[1] * math.sqrt(ee), opened)
        tr += filled
        opened -= filled
    return tr, e, s, product(s, s), product(s, e), ee, row, y, factors, growth, opened


def _elastic_rows(elasticity, pores, surface, strengths, controls, columns, stress, increment, state, dt, rows, left):
    """Advance those of the `rows` (first, end) that stay elastic; the numbers of the others come into `left` (n,).

    Their count is returned.
    """
    m, c, control = unpack_elasticity(elasticity), unpack_pores(pores), unpack_control(controls)
    y_all, strength = unpack_surface(surface), unpack_strength(strengths)
    components, static_column, dissipation = stress.shape[1], columns[STATIC], columns[DISSIPATION]
    found = 0
    for b in range(rows[0], rows[1]):
        if state[b, STRENGTH] == 0.0:
            continue  # a row without state: a bond that is longer than the horizon still
        if _is_still(increment, b, components):  # the two follow from evp: make them exact, e.g. for newborn rows
            p, _, x, _ = harden(c, state[b, EVP], state[b, CONTENT], 0.0, state[b, PRESSURE])
            state[b, PRESSURE] = p
            state[b, STRENGTH] = x - 3.0 * p
        tr, e, s, ss, se, ee, row, y, _, _, opened = _start(
            c, m, y_all, strength, columns, stress, increment, state, b, components
        )
        bulk = shear = effective = p = after = content = 0.0
        if control.fixed_substeps == 0.0:
            bulk, shear, effective, p, after, content = _elastic_step(m, c, y, control, row, tr, ss, se, ee)
        if not shear > 0.0:
            left[found] = b
            found += 1
            continue
        state[b, OPENED] = opened
        if c.elastic_pressure:
            state[b, PRESSURE], state[b, CONTENT] = p, content
            state[b, STRENGTH] = after - 3.0 * p
        work = 0.0
        static = combine(effective - 3.0 * p, s, 1.0, e, 2.0 * shear)
        if static_column >= 0:
            memory = 0.0
            if _is_overstressed(stress, state, b, static_column, components):
                memory = math.exp(-_rate_time(control, dt, tr, ee))
            none = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
            over = _faded(stress, state, b, static_column, components, memory, none, opened)
            if dissipation >= 0:
                pressure, added = (row[4], p), (static, over, none)
                work = _viscous_work(b, bulk, shear, pressure, stress, state, static_column, components, added)
            store(state, b, static_column, components, static)
            static = plus(static, over)
        store(stress, b, 0, components, static)
        if dissipation >= 0:
            state[b, dissipation] = work
    return found


def _plastic_rows(elasticity, pores, surface, strengths, controls, columns, stress, increment, state, dt, left, count):
    """Advance the rows with the first `count` numbers in `left`; those whose update fails stay as they were.

    Their numbers come to the front of `left`, their count is returned.
    """
    m, c, control = unpack_elasticity(elasticity), unpack_pores(pores), unpack_control(controls)
    y_all, strength = unpack_surface(surface), unpack_strength(strengths)
    components, static_column = stress.shape[1], columns[STATIC]
    plastic_column, dissipation = columns[PLASTIC], columns[DISSIPATION]
    failures = 0
    for k in range(count):
        b = left[k]
        tr, e, s, ss, se, ee, row, y, factors, growth, opened = _start(
            c, m, y_all, strength, columns, stress, increment, state, b, components
        )
        before = row[4]
        u0, e1, e2 = basis(ss, se, ee)
        row = (row[0], u0, 0.0, row[3], row[4], row[5], row[6])
        row, growth, push, memory, spent, used, fine = advance(
            m, c, y, strength, factors, control, row, growth, dt, tr, e1, e2
        )
        if not fine:
            left[failures] = b
            failures += 1
            continue
        state[b, EVP], state[b, PRESSURE], state[b, CONTENT] = row[3], row[4], row[6]
        state[b, STRENGTH] = row[5] - 3.0 * row[4]
        if columns[TIME] >= 0:
            state[b, columns[TIME]] = growth
        opened += spent[5]
        state[b, OPENED] = opened
        s_share, e_share = shares(row[1], row[2], u0, e1, e2)
        static = combine(row[0], s, s_share, e, e_share)
        s_share, e_share = shares(spent[1], spent[2], u0, e1, e2)
        strain, work = combine(spent[0], s, s_share, e, e_share), spent[4]
        if plastic_column >= 0:
            for a in range(components):
                state[b, plastic_column + a] += strain[a]
            state[b, columns[LENGTH]] += spent[3]
        if static_column >= 0:
            s_share, e_share = shares(push[1], push[2], u0, e1, e2)
            new = combine(push[0], s, s_share, e, e_share)
            over = _faded(stress, state, b, static_column, components, memory, new, opened)
            if dissipation >= 0:
                pressure, added = (before, row[4]), (static, over, strain)
                work += _viscous_work(b, used[0], used[1], pressure, stress, state, static_column, components, added)
            store(state, b, static_column, components, static)
            static = plus(static, over)
        store(stress, b, 0, components, static)
        if dissipation >= 0:
            state[b, dissipation] = work
    return failures


# The same loops for many rows that share their constants, and within the loop over rows that do not
_advance_elastic, _advance_plastic = kernel(_elastic_rows), kernel(_plastic_rows)
_advance_own_elastic, _advance_own_plastic = inlined(_elastic_rows), inlined(_plastic_rows)


def update_rows(constants, columns, stress, increment, state, dt):
    """Advance `stress` (n, 4|6) and `state` (n, k) in place by `increment` (n, 4|6) over `dt` s.

    `constants` are those of elasticity, pores, surface, strength and control as arrays; `columns` tell the state's
    optional columns. A row whose update fails keeps its start state; the numbers of those rows are returned.
    """
    left, rows = np.empty(len(stress), np.int64), (0, len(stress))
    found = _advance_elastic(*constants, columns, stress, increment, state, dt, rows, left)
    return left[: _advance_plastic(*constants, columns, stress, increment, state, dt, left, found)]


@kernel
def update_each(elasticity, pores, surface, strengths, controls, columns, stress, increment, state, dt, failed):
    """`update_rows` where rows have constants of their own, (n, ...) arrays; `failed` (n,) tells whose update fails."""
    left = np.empty(1, np.int64)
    for b in range(stress.shape[0]):
        e, c, y, s, k = elasticity[b], pores[b], surface[b], strengths[b], controls[b]
        found = _advance_own_elastic(e, c, y, s, k, columns, stress, increment, state, dt, (b, b + 1), left)
        failed[b] = _advance_own_plastic(e, c, y, s, k, columns, stress, increment, state, dt, left, found) > 0
