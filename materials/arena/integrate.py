"""Advance of one row over a strain increment: substeps, error control, damage and overstress.

The deviators of a step stay in the plane of the initial deviator s and the strain deviator e, so a row is
integrated as seven scalars (I1, u, w, evp, p, X_eff, fluid content), whatever the number of stored components.

A plastic substep is a two-stage diagonally implicit Runge-Kutta step (Alexander 1977) whose stages are
returns to the surface, with moduli frozen at the mean of both ends; the ends come from a first return over
the whole substep, whose difference to the final result also is the error that controls the step.
"""

import math

from periporo.core.numerics.jit import inlined
from periporo.materials.arena.elasticity import fluid_stiffens, moduli, pore_fluid
from periporo.materials.arena.pores import harden
from periporo.materials.arena.returns import backward_euler, crossing, let_go, strained_pores
from periporo.materials.arena.surface import holds, is_clear, share_of_limit, weakened_surface

_GAMMA = 1.0 - math.sqrt(0.5)  # stage length that makes the two stages second order and L-stable
_EXTRAPOLATION = (1.0 - 2.0 * _GAMMA) / _GAMMA  # from the end of stage one to where stage two starts
_PREDICTOR_SHARE = 0.003  # the first return's remaining error is about the square of its tolerance
_STAGE_TOLERANCE = 1e-6
_ON_SURFACE = 1e-7
_MODULUS_CHANGE = 0.2  # largest relative change of K in a substep
_COMPACTION_SHARE = 0.1  # largest share of the remaining compaction in a substep
_SMALLEST_STEP = 1e-9
_MAX_SUBSTEPS = 5000  # so that no row holds up a run


@inlined
def _norm(i1, u, w):
    return math.sqrt(i1 * i1 / 3.0 + u * u + w * w)


@inlined
def _error(low, high, scale):
    """Difference of two results: effective stress and pore pressure, each relative to its size."""
    effective = high[0] + 3.0 * high[4]
    size = _norm(effective, high[1], high[2]) + scale
    gap = _norm(effective - low[0] - 3.0 * low[4], high[1] - low[1], high[2] - low[2])
    return gap / size + abs(high[4] - low[4]) / (size + high[4])


@inlined
def _two_stages(c, y_stage, y, bulk, shear, coupling, state, tr, e1, e2, guess):
    """Second-order plastic step with frozen moduli; `guess` is the plastic volume of the whole step.

    One return over the share gamma, extrapolation to 1 - gamma, and one more return over the share gamma.
    Where the pores leave no room for the extrapolation the second return takes the whole step.
    """
    share = _GAMMA
    one = backward_euler(
        c, y_stage, bulk, shear, coupling, state, share * tr, share * e1, share * e2, share * guess, _STAGE_TOLERANCE
    )
    g = _EXTRAPOLATION
    x = one[3] - state[3]
    base = state
    if (1.0 + g) * x < 0.5 * (c.p3 - state[3]):
        guess = x
        evp = one[3] + g * x
        content = one[6] + g * (one[6] - state[6])
        p, _, strength, _ = harden(c, evp, content, 0.0, max(one[4] + g * (one[4] - state[4]), 0.0))
        base = (
            one[0] + g * (one[0] - state[0]),
            one[1] + g * (one[1] - state[1]),
            one[2] + g * (one[2] - state[2]),
            evp,
            p,
            strength,
            content,
        )
    else:
        share = 1.0
    return backward_euler(
        c, y, bulk, shear, coupling, base, share * tr, share * e1, share * e2, guess, _STAGE_TOLERANCE
    )


@inlined
def _aging_share(control, y, shear, start, end, tr, e1, e2):
    """Share of a substep's time that damages: |plastic strain increment| / |strain increment|, at most 1.

    Less where it ends on the cap near the shear limit, and nothing beyond, unless the cap counts, too.
    """
    weight = 1.0 if control.damage_on_cap else share_of_limit(y, end[0] + 3.0 * end[4], end[5])
    if weight == 0.0:
        return 0.0
    u = start[1] + 2.0 * shear * e1 - end[1]
    w = start[2] + 2.0 * shear * e2 - end[2]
    plastic = _norm(end[3] - start[3], u / (2.0 * shear), w / (2.0 * shear))
    total = _norm(tr, e1, e2)
    return weight * min(plastic / total, 1.0) if total > 0.0 else 0.0


@inlined
def _plastic_substep(m, c, control, strength, y, factors, growth, dt, start, state, tr, e1, e2):
    """One substep that yields, from the moduli `start`.

    Returns the new state, the strain by which the row opened, the mean moduli used, the error, the new growth time.
    """
    accuracy = _PREDICTOR_SHARE * math.sqrt(control.tolerance)
    k0, g0, c0, _ = start
    first = backward_euler(c, y, k0, g0, c0, state, tr, e1, e2, 0.0, accuracy)
    fluid = pore_fluid(c, first[4], first[3], first[6])
    k1, g1, c1, _ = moduli(m, c, fluid, first[0] + 3.0 * first[4], first[4], first[3], tr < 0.0)
    bulk = 0.5 * (k0 + k1)
    shear = 0.5 * (g0 + g1)
    coupling = 0.5 * (c0 + c1)
    x = first[3] - state[3]
    y_stage = y_end = y
    if control.damage:
        rise = dt * _aging_share(control, y, g0, state, first, tr, e1, e2)
        y_stage = weakened_surface(strength, factors, growth + _GAMMA * rise)
        y_end = weakened_surface(strength, factors, growth + rise)
    end = _two_stages(c, y_stage, y_end, bulk, shear, coupling, state, tr, e1, e2, x)
    if control.damage:
        growth += dt * _aging_share(control, y_end, shear, state, end, tr, e1, e2)
    error = _error(first, end, control.stress_scale) / control.tolerance
    change = abs(k1 - k0) / (_MODULUS_CHANGE * max(k0, k1))
    compaction = (end[3] - state[3]) / (_COMPACTION_SHARE * (c.p3 - state[3]))
    end, gap = let_go(c, y_end, state, end)
    return end, gap, (bulk, shear, coupling, 0.0), max(error, change * change, compaction), growth


@inlined
def mean_moduli(m, c, fluid, state, start, tr):
    """Moduli at the middle of an elastic step that starts with the moduli `start` and the pore `fluid`."""
    effective = state[0] + 3.0 * state[4]
    middle = effective + 1.5 * start[0] * tr
    if effective * middle < 0.0:
        middle = 0.0  # on the side of the start; a kink in between is split off by the caller
    p, _, content = strained_pores(c, start[2], state, 0.5 * tr)
    if start[2] > 0.0:
        fluid = pore_fluid(c, p, state[3], content)
    return moduli(m, c, fluid, middle, p, state[3], effective < 0.0 or (effective == 0.0 and tr < 0.0))


@inlined
def _kink_share(m, c, k0, state, tr):
    """Share of an elastic step up to the jump of K at I1_eff = 0 of a wet soil; 1 if it meets none."""
    i1 = state[0] + 3.0 * state[4]
    rise = 3.0 * k0 * tr
    if c.saturation == 0.0 or i1 * (i1 + rise) >= 0.0:
        return 1.0
    if fluid_stiffens(m, c, i1, state[4], False) == fluid_stiffens(m, c, -i1, state[4], False):
        return 1.0
    beyond = 1e-9 * abs(i1) + 1e-15 * (abs(state[0]) + 3.0 * state[4])
    return min((abs(i1) + beyond) / abs(rise), 1.0)


@inlined
def _elastic_part(m, c, y, fluid, state, start, tr, e1, e2, inside):
    """Elastic move up to the first event, the jump of K at I1_eff = 0 or the yield surface.

    `start` are the moduli at the start, `inside` tells whether it is clear of the surface. Returns the new state, the
    share of the increment that was used (0: the row yields at once), and the stress that the change of moduli makes.
    """
    share = _kink_share(m, c, start[0], state, tr)
    hit = False
    i1 = state[0] + 3.0 * state[4]
    for _ in range(2):
        bulk, shear, coupling, _ = mean_moduli(m, c, fluid, state, start, share * tr)
        di1 = 3.0 * bulk * share * tr
        p, strength, content = strained_pores(c, coupling, state, share * tr)
        du = 2.0 * shear * share * e1
        dw = 2.0 * shear * share * e2
        u = state[1] + du
        w = state[2] + dw
        if hit or holds(y, i1 + di1, 0.5 * (u * u + w * w), strength):
            break
        if not inside:
            return state, 0.0, 0.0
        hit = True
        share *= crossing(y, i1, di1, state[1], du, state[2], dw, strength)
    gap = share * _norm(3.0 * (bulk - start[0]) * tr, 2.0 * (shear - start[1]) * e1, 2.0 * (shear - start[1]) * e2)
    new = (i1 + di1 - 3.0 * p, u, w, state[3], p, strength, content)
    return (new if coupling > 0.0 else (state[0] + di1, u, w, state[3], p, strength, content)), share, gap


@inlined
def _relax(control, over, push, memory, rate_time):
    """Overstress after a substep in which the plastic strain would have added `push` (eq. 136)."""
    decay = math.exp(-rate_time)
    gain = -math.expm1(-rate_time) / rate_time if rate_time > 0.0 else 1.0
    return (
        decay * over[0] + gain * push[0],
        decay * over[1] + gain * push[1],
        decay * over[2] + gain * push[2],
    ), decay * memory


@inlined
def _spend(spent, start, end, gap, shear, e1, e2):
    """Add a plastic substep to `spent`: plastic strain (trace, u, w), its length, its work, and the opened strain.

    The work is that of the effective stress on the plastic strain and on the opening.
    """
    compacted = end[3] - start[3]
    u = e1 + (start[1] - end[1]) / (2.0 * shear)
    w = e2 + (start[2] - end[2]) / (2.0 * shear)
    mean = (start[0] + 3.0 * start[4] + end[0] + 3.0 * end[4]) / 6.0
    work = 0.5 * ((start[1] + end[1]) * u + (start[2] + end[2]) * w) - mean * (compacted - gap)
    length = _norm(compacted, u, w)
    return spent[0] - compacted, spent[1] + u, spent[2] + w, spent[3] + length, spent[4] + work, spent[5] + gap


@inlined
def advance(m, c, y, strength, factors, control, state, growth, dt, tr, e1, e2):
    """Advance `state` by a strain increment over `dt` s.

    Returns the state, the growth time of damage, the new overstress (I1, u, w), the share that is left of
    the old one, what was `spent` (see `_spend`), the last moduli, and whether all went well.
    """
    over = (0.0, 0.0, 0.0)
    spent = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    used = (0.0, 0.0, 0.0, 0.0)
    viscous = control.relaxation_time > 0.0 and dt < math.inf
    memory = 1.0 if viscous else 0.0
    per_step = 0.0  # time step over relaxation time, dt / (T1 rate^-T2)
    if viscous:
        rate = _norm(tr, e1, e2) / dt
        per_step = dt * rate**control.relaxation_power / control.relaxation_time
    adaptive = control.fixed_substeps == 0.0
    largest = 1.0 if adaptive else 1.0 / control.fixed_substeps
    h = largest
    done = 0.0
    substeps = 0
    while done < 1.0:
        h = min(h, 1.0 - done)
        if 1.0 - done - h < 1e-12:
            h = 1.0 - done
        dtr, d1, d2 = h * tr, h * e1, h * e2
        i1 = state[0] + 3.0 * state[4]
        if control.damage:
            y = weakened_surface(strength, factors, growth)
        fluid = pore_fluid(c, state[4], state[3], state[6])
        start = moduli(m, c, fluid, i1, state[4], state[3], tr < 0.0)
        push = (0.0, 0.0, 0.0)
        inside = is_clear(y, i1, 0.5 * (state[1] ** 2 + state[2] ** 2), state[5], _ON_SURFACE)
        new, share, gap = _elastic_part(m, c, y, fluid, state, start, dtr, d1, d2, inside)
        error = gap_opened = 0.0
        new_growth = growth
        used = start
        plastic = share == 0.0
        if not plastic:
            size = _norm(new[0] + 3.0 * new[4], new[1], new[2]) + control.stress_scale
            error = gap / (size * control.tolerance)
        else:
            share = 1.0
            substep_time = h * dt if dt < math.inf else 0.0
            new, gap_opened, used, error, new_growth = _plastic_substep(
                m, c, control, strength, y, factors, growth, substep_time, start, state, dtr, d1, d2
            )
            if viscous:
                trial, _, _ = strained_pores(c, used[2], state, dtr)
                push = (
                    state[0] + 3.0 * used[0] * dtr - 3.0 * (trial - state[4]) - new[0],
                    state[1] + 2.0 * used[1] * d1 - new[1],
                    state[2] + 2.0 * used[1] * d2 - new[2],
                )
        substeps += 1
        if not math.isfinite(new[0] + new[1] + new[2] + new[3] + new[4]) or substeps > _MAX_SUBSTEPS:
            if not adaptive or h <= _SMALLEST_STEP or substeps > _MAX_SUBSTEPS:
                return state, growth, over, memory, spent, used, False
            h *= 0.25
            continue
        if adaptive and error > 1.0 and h > _SMALLEST_STEP:
            h *= max(0.9 / math.sqrt(error), 0.1)
            continue
        if plastic:
            spent = _spend(spent, state, new, gap_opened, used[1], d1, d2)
        state = new
        growth = new_growth
        if viscous:
            over, memory = _relax(control, over, push, memory, share * h * per_step)
        done += share * h
        h = min(share * h * min(0.9 / math.sqrt(error + 1e-4), 5.0), 1.0) if share == 1.0 and adaptive else h
        h = min(h, largest)
    return state, growth, over, memory, spent, used, True
