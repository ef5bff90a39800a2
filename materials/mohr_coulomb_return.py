"""Return of principal stresses to Mohr-Coulomb's pyramid and its tension cut-off.

Principal stresses are s1 >= s2 >= s3, tension positive. Yield (1 + sin(phi)) s1 - (1 - sin(phi)) s3 <= Y with
Y = 2 c cos(phi); flow with psi in place of phi; cut-off s1 <= T with associated flow (Rankine). The returned stress
lies on a face, an edge, the apex, the cut-off or where both meet: each is linear in the trial stress (de Souza Neto,
Peric & Owen 2008, section 8.2), and which of them it is follows from the order that principal stresses must keep.
"""

import math

from periporo.core.numerics.jit import inlined

_SMALL = 2e-6  # of the plastic shear strain of a step: what its strength may be off
_NOISE = 1e-15  # of the trial strain: the same
_DECADE = math.log(10.0)


@inlined
def pyramid(sine, dilation, strength, cutoff, lame, shear):
    """Numbers that a return needs, of sin(phi), sin(psi) and Y; divisions are done here, once for many rows."""
    up, down = 1.0 + sine, 1.0 - sine
    volume = 2.0 * lame * dilation
    first, last = volume + 2.0 * shear * (1.0 + dilation), volume - 2.0 * shear * (1.0 - dilation)
    own = up * first - down * last
    right, left = own + up * first - down * volume, own + up * volume - down * last
    per = 1.0 / (up * down)
    apex = strength / (2.0 * sine) if sine > 0.0 else math.inf
    least = (up * cutoff - strength) * (up * per) if cutoff < math.inf else -math.inf
    flows = first, volume, last, 1.0 / own, 1.0 / right, 1.0 / left
    limits = strength, apex, cutoff, least
    confined, sideways = lame / (lame + 2.0 * shear), 0.5 * lame / (lame + shear)
    return up, down, down * per, up * per, dilation, flows, limits, confined, sideways


@inlined
def on_pyramid(s1, s2, s3, numbers):
    """Principal stresses that trial stresses come to without a cut-off, and by how much those yield.

    Stresses that may be are left as they are.
    """
    up, down, per_up, per_down, dilation, flows, limits, _, _ = numbers
    first, volume, last, per_own, per_right, per_left = flows
    strength, apex, _, _ = limits
    excess = up * s1 - down * s3 - strength
    flow = (excess if excess > 0.0 else 0.0) * per_own
    t1, t2, t3 = s1 - first * flow, s2 - volume * flow, s3 - last * flow

    right = (1.0 - dilation) * s1 + (1.0 + dilation) * s3 > 2.0 * s2  # s2 = s3 is met before s1 = s2
    flow_right = (excess + up * s1 - down * s2 - strength) * per_right
    flow_left = (excess + up * s2 - down * s3 - strength) * per_left
    e1 = s1 - first * flow_right if right else (strength + down * (s3 - last * flow_left)) * per_up
    e3 = (up * e1 - strength) * per_down
    e2 = e3 if right else e1
    beyond = e1 < e3
    e1, e2, e3 = (apex if beyond else e1), (apex if beyond else e2), (apex if beyond else e3)
    ordered = (t1 >= t2) & (t2 >= t3)
    return (t1 if ordered else e1), (t2 if ordered else e2), (t3 if ordered else e3), excess


@inlined
def cut_off(s1, s2, s3, t1, t2, t3, numbers):
    """The same with a cut-off, of stresses that come to t1, t2, t3 without one."""
    _, _, cutoff, least = numbers[6]
    confined, sideways = numbers[7], numbers[8]
    above = s1 - cutoff
    q2, q3 = s2 - confined * above, s3 - confined * above
    two = q2 > cutoff
    q3 = s3 - sideways * (above + s2 - cutoff) if two else q3
    q2 = cutoff if two else q2
    q3 = cutoff if q3 > cutoff else q3
    both = s2 - sideways * (above + s3 - least)
    both = least if both < least else both
    both = cutoff if both > cutoff else both
    sheared = q3 < least
    q2, q3 = (both if sheared else q2), (least if sheared else q3)
    cut = t1 > cutoff
    return (cutoff if cut else t1), (q2 if cut else t2), (q3 if cut else t3)


@inlined
def returned(s, numbers, cuts):
    """Principal stresses that trial stresses come to; `numbers` are those of `pyramid`, `cuts` if there is a cut-off.
    """
    s1, s2, s3 = s
    t1, t2, t3, _ = on_pyramid(s1, s2, s3, numbers)
    return cut_off(s1, s2, s3, t1, t2, t3, numbers) if cuts else (t1, t2, t3)


@inlined
def plastic_shear(s, t, shear):
    """Largest difference of the principal plastic strains that take `s` to `t`."""
    a, b, c = s[0] - t[0], s[1] - t[1], s[2] - t[2]
    high, low = (a if a > b else b), (b if a > b else a)
    return 0.5 * ((c if c > high else high) - (c if c < low else low)) / shear


@inlined
def plastic_work(s, t, bulk, shear):
    """Work per volume of the plastic strain that takes `s` to `t`."""
    a, b, c = s[0] - t[0], s[1] - t[1], s[2] - t[2]
    mean = (a + b + c) / 3.0
    deviatoric = (t[0] * (a - mean) + t[1] * (b - mean) + t[2] * (c - mean)) / (2.0 * shear)
    return deviatoric + (t[0] + t[1] + t[2]) * mean / (3.0 * bulk)


@inlined
def strength_at(tables, r, strain):
    """sin(phi), Y, sin(psi) at a plastic shear strain, their slopes, how far these hold: see `MohrCoulomb.table`."""
    t, last = tables, tables.shape[2] - 1
    if not strain < t[r, 0, last]:
        return (t[r, 1, last], t[r, 2, last], t[r, 3, last]), (0.0, 0.0, 0.0), math.inf
    k = 0
    while strain >= t[r, 0, k + 1]:
        k += 1
    part, per = strain - t[r, 0, k], 1.0 / (t[r, 0, k + 1] - t[r, 0, k])
    a, b, c = t[r, 1, k + 1] - t[r, 1, k], t[r, 2, k + 1] - t[r, 2, k], t[r, 3, k + 1] - t[r, 3, k]
    slopes = a * per, b * per, c * per
    values = t[r, 1, k] + part * slopes[0], t[r, 2, k] + part * slopes[1], t[r, 3, k] + part * slopes[2]
    return values, slopes, t[r, 0, k + 1] - strain


@inlined
def softer(values, slopes, strain):
    """The three numbers of the strength after more strain."""
    return values[0] + slopes[0] * strain, values[1] + slopes[1] * strain, values[2] + slopes[2] * strain


@inlined
def give_on_face(values, shear, lame):
    """Plastic shear strain per strength, on a face."""
    return 0.5 / (lame * values[0] * values[2] + shear * (1.0 + values[0] * values[2]))


@inlined
def returned_with_memory(s, tables, r, start, part, cutoff, rate, reference, lame, shear):
    """Returned principal stresses and the plastic shear strain x of the step, on whose strength they lie.

    The strength is that after the step, at `start` + `part` x, times 1 + `rate` log10(x/`reference`) if that is above
    1: backward Euler. Newton's method within a bracket finds x, in its logarithm where the rate matters.
    """
    widest = 0.5 * (s[0] - s[2]) / shear
    x, low, high = 0.0, 0.0, widest
    t = s
    for _ in range(100):
        values, slopes, _ = strength_at(tables, r, start + part * x)
        sine, strength, dilation = values
        faster = rate > 0.0 and x > reference
        factor = 1.0 + rate * math.log(x / reference) / _DECADE if faster else 1.0
        t = returned(s, pyramid(sine, dilation, factor * strength, cutoff, lame, shear), True)
        off = plastic_shear(s, t, shear) - x
        if abs(off) <= _SMALL * x + _NOISE * widest:
            break
        low, high = (x, high) if off > 0.0 else (low, x)
        give = give_on_face(values, shear, lame)
        stiffening = part * (factor * slopes[1] - slopes[0] * (t[0] + t[2]))
        if faster:
            stiffening += strength * rate / (_DECADE * x)
        step = off / (1.0 + give * stiffening)
        new = x * math.exp(step / x) if faster else x + step
        if x == 0.0 and rate > 0.0 and new > reference and strength > 0.0:
            decades = off / (give * rate * strength)
            new = min(new, reference * 10.0 ** min(decades, 300.0))
        if not (low < new < high):
            new = 0.5 * (low + high)
        x = new
    return t, x
