"""Return of a trial stress to the yield surface: one scalar equation in the volumetric plastic strain.

Unknown x = increment of the volumetric plastic strain (compaction positive). Pore pressure and strength
are functions of it, so hardening is exact and no closest-point search is needed:
I1_eff(x) = I1_trial + 3 K x + 3 p(x), sqrt J2 = F(I1_eff; X_eff(x)), and normality in the plane
(z, r' = BETA r sqrt(3K/2G)) is R(x) = x G F - 3/2 BETA^2 (F^2)_,I1 (q_trial - F) = 0 with q = sqrt J2. Where BETA acts
on the cap alone it is 1 where (F^2)_,I1 < 0: soil dilates there.
"""

import math

from periporo.core.numerics.jit import inlined
from periporo.materials.arena.constants import STRESS_FLOOR
from periporo.materials.arena.pores import harden
from periporo.materials.arena.surface import holds, shear_limit, squared_limit, squared_limit_slopes

SURFACE, NOSE, VERTEX = 0, 1, 2
_NOSE_SHEAR = 1e-5  # trial q below this share of the surface's length goes to the nose directly
_COMPACTION_LIMIT = 0.999  # share of the remaining compaction p3 - evp that one step may take
_BISECT_AFTER = 25
_AT_VERTEX = 1e-6  # of the surface's length
_MAX_ITERATIONS = 120


@inlined
def _normality(y, shear, x, q, i1, di1, strength, dstrength):
    """R, its derivative in x, F, and dF/dx; X < i1 < PEAKI1."""
    square, d1, d11, dx, d1x = squared_limit_slopes(y, i1, strength)
    f = math.sqrt(square)
    df = (d1 * di1 + dx * dstrength) / (2.0 * f)
    gap = q - f
    flow = y.flow if d1 > 0.0 else y.opening
    residual = x * shear * f - flow * d1 * gap
    slope = shear * (f + x * df) - flow * ((d11 * di1 + d1x * dstrength) * gap - d1 * df)
    if gap < 0.0:  # the surface has left the trial state behind: too much plastic strain
        residual = math.copysign(abs(residual) + 1e-300, x)
    return residual, slope, f, df


@inlined
def _residual(y, target, shear, x, q, i1, di1, strength, dstrength):
    """Sign-carrying residual, Newton step, F and dF/dx of one of the three targets."""
    if target == VERTEX:
        return i1 - y.peak, (y.peak - i1) / di1, 0.0, 0.0
    length = y.peak - strength
    if target == NOSE:  # F^2 is linear in the distance to the nose there
        limit = shear_limit(y, strength)[0]
        slope = 2.0 * limit * limit / ((1.0 - y.cap_ratio) * length)
        f = q * y.flow * slope / (max(x, 0.0) * shear + y.flow * slope)
        gap = i1 - strength - f * f / slope
        return gap, -gap / (di1 - dstrength), f, 0.0
    if i1 <= strength:  # beyond the nose: aim at its inside, where F is about q
        limit = shear_limit(y, strength)[0]
        width = (1.0 - y.cap_ratio) * length
        inside = 0.5 * width * min(q * q / (limit * limit), 0.5)
        return -1.0, (strength - i1 + inside) / (di1 - dstrength), 0.0, 0.0
    if i1 >= y.peak:
        return 1.0, (y.peak - 0.05 * length - i1) / di1, 0.0, 0.0
    residual, slope, f, df = _normality(y, shear, x, q, i1, di1, strength, dstrength)
    return residual, -residual / slope, f, df


@inlined
def _solve(c, y, target, bulk, shear, coupling, i1, q, evp, content, guess, pressure, tolerance):
    """Bracketed Newton iteration for x; returns x, F, effective I1, pore pressure and strength, NaN x on failure.

    `i1`, fluid `content` and `pressure` are those of the trial, in which all strain is elastic; then plastic compaction
    raises the pressure at that content, and takes back x of the elastic one. The last Newton step is applied to the
    results linearly, which leaves an error of `tolerance` squared.
    """
    low = -math.inf
    high = min((y.peak - i1) / (3.0 * bulk), _COMPACTION_LIMIT * (c.p3 - evp))
    x = min(guess, high)
    p = pressure
    for iteration in range(_MAX_ITERATIONS):
        p, dp, strength, dstrength = harden(c, evp + x, content, 0.0, p)
        full, dfull = p, dp
        if coupling > 0.0:
            full, dfull, strength, dstrength = harden(c, evp + x, _after(content, coupling, x), coupling, p)
        length = y.peak - strength
        di1 = 3.0 * (bulk + dp)
        here = i1 + 3.0 * (bulk * x + p)
        residual, step, f, df = _residual(y, target, shear, x, q, here, di1, strength, dstrength)
        if residual < 0.0:
            low = x
        elif residual > 0.0:
            high = x
        inside = target != SURFACE or (here > strength and here < y.peak and f <= q * (1.0 + 1e-9))
        reach = tolerance * min(length, abs(here) + f + min(c.p0, STRESS_FLOOR))
        small = abs(step) * di1 <= reach and abs(df * step) <= reach
        if inside and small and (step <= 0.0) == (residual >= 0.0):
            here += di1 * step
            return x + step, max(f + df * step, 0.0), here, full + dfull * step, strength + dstrength * step
        if high - low <= 4e-16 * (abs(x) + length / bulk):
            return x, f, here, full, strength
        new = x + step
        if not (new > low and new < high) or (iteration > _BISECT_AFTER and low > -math.inf):
            new = 0.5 * (low + high) if low > -math.inf else x - 2.0 * (abs(x) + length / di1)
        p = max(p + dp * (new - x), 0.0)
        x = new
    return math.nan, 0.0, i1, p, strength


@inlined
def _after(content, coupling, x):
    """Fluid content after x of an elastic compression has become plastic."""
    return content * math.exp(-coupling * x) if coupling > 0.0 else content


@inlined
def plastic_return(c, y, bulk, shear, coupling, i1, q, evp, content, pressure, strength, guess, tolerance):
    """Plastic volume increment x, sqrt J2, effective I1, pore pressure and strength X_eff after the return.

    `i1` (total), `q` = sqrt J2, fluid `content`, `pressure` and `strength` are the trial's, `evp` the plastic strain
    before. x is NaN if the iteration failed.
    """
    effective = i1 + 3.0 * pressure
    target = SURFACE
    if effective >= y.peak:
        target = VERTEX
    elif effective < strength and q <= _NOSE_SHEAR * (y.peak - strength):
        target = NOSE
    while True:
        x, f, end, p, end_strength = _solve(
            c, y, target, bulk, shear, coupling, i1, q, evp, content, guess, pressure, tolerance
        )
        if target != VERTEX:
            return x, min(f, q), end, p, end_strength
        limit, slope, _ = shear_limit(y, y.peak)
        limit = max(limit, 0.0)
        if x * shear - 2.0 * y.opening * slope * max(q - limit, 0.0) <= 0.0:
            return x, min(q, limit), end, p, end_strength
        target = SURFACE  # the trial is not in the cone of the vertex


@inlined
def strained_pores(c, coupling, state, tr):
    """Pore pressure, strength X_eff and fluid content after an elastic strain of trace `tr`."""
    p, strength, content = state[4], state[5], state[6]
    if coupling > 0.0:
        content *= math.exp(-coupling * tr)
        p, _, strength, _ = harden(c, state[3], content, 0.0, p)
    return p, strength, content


@inlined
def backward_euler(c, y, bulk, shear, coupling, state, tr, e1, e2, guess, tolerance):
    """Elastic trial and return over a strain increment (trace `tr`, deviator `e1`, `e2`).

    `state` = (I1, u, w, evp, p, X_eff, content): total I1, the deviator's two coordinates in an orthonormal basis
    (J2 = (u^2 + w^2)/2), plastic volume strain, pore pressure, strength, fluid content. Returns the new one.
    """
    u, w, evp = state[1], state[2], state[3]
    p, strength, content = strained_pores(c, coupling, state, tr)
    effective = state[0] + 3.0 * state[4] + 3.0 * bulk * tr
    u += 2.0 * shear * e1
    w += 2.0 * shear * e2
    j2 = 0.5 * (u * u + w * w)
    if holds(y, effective, j2, strength):
        return effective - 3.0 * p, u, w, evp, p, strength, content
    q = math.sqrt(j2)
    x, f, effective, p, strength = plastic_return(
        c, y, bulk, shear, coupling, effective - 3.0 * p, q, evp, content, p, strength, guess, tolerance
    )
    ratio = f / q if q > 0.0 else 0.0
    return effective - 3.0 * p, ratio * u, ratio * w, evp + x, p, strength, _after(content, coupling, x)


@inlined
def let_go(c, y, start, end):
    """`end` of a plastic substep, and the strain by which the row opened in it.

    At the vertex, and free of fluid pressure, soil has come apart: expansion is a gap, not plastic strain. The pores
    stay those of the `start`, or at which the fluid became free.
    """
    vertex = y.peak - _AT_VERTEX * (y.peak - end[5])
    if end[3] >= start[3] or end[4] > 0.0 or end[0] < vertex:
        return end, 0.0
    free = -math.log1p(c.open_volume * end[6] - c.phi0)
    evp = max(end[3], min(start[3], free))
    p, _, strength, _ = harden(c, evp, end[6], 0.0, 0.0)
    return (end[0] - 3.0 * p, end[1], end[2], evp, p, strength, end[6]), evp - end[3]


@inlined
def crossing(y, i1, di1, u, du, w, dw, strength):
    """Fraction of a straight path of effective stress, from inside to outside, at which it meets the surface.

    Illinois iteration on J2 - F^2, bisection where the path has left the range of I1.
    """
    low, high = 0.0, 1.0
    f_low = f_high = 0.0
    side = 0
    for _ in range(60):
        a = 0.5 * (low + high)
        if f_low < 0.0 and f_high > 0.0:
            a = low - f_low * (high - low) / (f_high - f_low)
        here = i1 + a * di1
        ua = u + a * du
        wa = w + a * dw
        j2 = 0.5 * (ua * ua + wa * wa)
        square = squared_limit(y, here, strength)
        f = j2 - square
        if here <= strength or here >= y.peak:
            high = a
            f_high = 0.0
        elif f > 0.0:
            high = a
            f_high = f
            f_low *= 0.5 if side == 1 else 1.0
            side = 1
        else:
            low = a
            f_low = f
            f_high *= 0.5 if side == -1 else 1.0
            side = -1
            if f >= -1e-9 * square:
                break
        if high - low < 1e-12:
            break
    return low
