"""Yield surface of Arena in (I1_eff, sqrt J2): a shear limit, a cap and a vertex in tension.

sqrt J2 = F, F^2 = Ff^2 Fc^2 with Ff = a1 - a3 exp(a2 I1) - a4 I1 and, for I1 <= kappa,
Fc^2 = 1 - ((kappa - I1)/(kappa - X_eff))^2, kappa = PEAKI1 - CR (PEAKI1 - X_eff). Tension positive.
"""

import math

from periporo.core.numerics.jit import inlined
from periporo.materials.arena.constants import Surface

_ONSET = 0.1


@inlined
def coherence(speed, time_at_failure, growth_time):
    """Kayenta's coherence, falling with the time spent yielding from nearly 1 to nearly 0 (eq. 266)."""
    return 1.0 / (1.0 + math.exp(-speed * (1.0 - growth_time / time_at_failure)))


@inlined
def weakened_surface(y, factors, growth_time):
    """Surface of a row with `factors` (4) on its strengths (variability) that has been yielding for `growth_time` s.

    A negative `growth_time` stands for a material without damage.
    """
    c = 1.0
    if growth_time >= 0.0:
        c = coherence(y.growth_speed, y.time_at_failure, growth_time)
    d = 1.0 - c
    peak = factors[0] * (c * y.peak + d * y.failed_peak)
    fslope = factors[1] * (c * y.fslope + d * y.failed_fslope)
    stren = factors[2] * (c * y.stren + d * y.failed_stren)
    yslope = factors[3] * (c * y.yslope + d * y.failed_yslope)
    a1, a2, a3, a4 = coefficients(peak, fslope, stren, yslope)
    return Surface(a1, a2, a3, a4, peak, y.cap_ratio, y.flow, y.opening)


@inlined
def coefficients(peak, fslope, stren, yslope):
    """a1..a4 of the shear limit (eq. 99 and its three special cases)."""
    if stren == 0.0:  # linear Drucker-Prager
        return peak * fslope, 0.0, 0.0, fslope
    if fslope == 0.0:  # von Mises
        return stren, 0.0, 0.0, 0.0
    cohesion = stren - peak * yslope
    a2 = (fslope - yslope) / cohesion
    return stren, a2, cohesion * math.exp(-a2 * peak), yslope


@inlined
def shear_limit(y, i1):
    """Ff and its first two derivatives in I1."""
    if y.a3 == 0.0:
        return y.a1 - y.a4 * i1, -y.a4, 0.0
    e = y.a3 * math.exp(y.a2 * i1)
    return y.a1 - e - y.a4 * i1, -y.a2 * e - y.a4, -y.a2 * y.a2 * e


@inlined
def branch(y, strength):
    """kappa, the effective I1 where the cap begins; strength X_eff."""
    return y.peak - y.cap_ratio * (y.peak - strength)


@inlined
def share_of_limit(y, i1, strength):
    """1 on the shear limit, falling smoothly to 0 over the first part of the cap, `_ONSET` of its length."""
    kappa = branch(y, strength)
    beyond = (kappa - i1) / (_ONSET * (kappa - strength))
    if beyond <= 0.0:
        return 1.0
    left = max(1.0 - beyond, 0.0)
    return left * left * (3.0 - 2.0 * left)


@inlined
def squared_limit(y, i1, strength):
    """F^2 at effective I1 for the strength X_eff; 0 beyond the nose of the cap and beyond the vertex."""
    if i1 <= strength or i1 > y.peak:
        return 0.0
    ff = shear_limit(y, i1)[0]
    kappa = branch(y, strength)
    if i1 >= kappa:
        return ff * ff
    t = (kappa - i1) / (kappa - strength)
    return ff * ff * (1.0 - t * t)


@inlined
def holds(y, i1, j2, strength):
    """Whether the surface holds the state: inside or exactly on it."""
    return i1 >= strength and i1 <= y.peak and j2 <= squared_limit(y, i1, strength)


@inlined
def is_clear(y, i1, j2, strength, margin):
    """Whether the state is inside by more than `margin` (share of the surface's length)."""
    width = margin * (y.peak - strength)
    if i1 < strength + width or i1 > y.peak - width:
        return False
    limit = math.sqrt(squared_limit(y, i1, strength)) - width
    return limit >= 0.0 and j2 <= limit * limit


@inlined
def squared_limit_slopes(y, i1, strength):
    """F^2 and its derivatives by I1, I1 I1, X and I1 X, for X < I1 < PEAKI1."""
    ff, slope, curvature = shear_limit(y, i1)
    kappa = branch(y, strength)
    square = ff * ff
    d1 = 2.0 * ff * slope
    d2 = 2.0 * (slope * slope + ff * curvature)
    if i1 >= kappa:
        return square, d1, d2, 0.0, 0.0
    w = kappa - strength
    t = (kappa - i1) / w
    cap = 1.0 - t * t
    c1 = 2.0 * t / w
    mix = y.cap_ratio + (1.0 - y.cap_ratio) * t
    cx = -2.0 * t * mix / w
    c11 = -2.0 / (w * w)
    c1x = 2.0 * (mix + (1.0 - y.cap_ratio) * t) / (w * w)
    return (
        square * cap,
        d1 * cap + square * c1,
        d2 * cap + 2.0 * d1 * c1 + square * c11,
        square * cx,
        d1 * cx + square * c1x,
    )
