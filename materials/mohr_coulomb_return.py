"""Return of principal stresses to Mohr-Coulomb's pyramid and its tension cut-off, and the loop over rows.

Principal stresses are s1 >= s2 >= s3, tension positive. Yield (1 + sin(phi)) s1 - (1 - sin(phi)) s3 <= Y with
Y = 2 c cos(phi); flow with psi in place of phi; cut-off s1 <= T with associated flow (Rankine). The returned stress
lies on a face, an edge, the apex, the cut-off or where both meet: each is linear in the trial stress (de Souza Neto,
Peric & Owen 2008, section 8.2), and which of them it is follows from the order that principal stresses must keep.
"""

import math

import numpy as np

from periporo.core.numerics import algebra as la
from periporo.core.numerics.algebra import LANES
from periporo.core.numerics.jit import inlined, kernel
from periporo.materials.principal import VALUES, put_together, take_apart

_SMALL = 2e-6  # of the plastic shear strain of a step: what its strength may be off
_NOISE = 1e-15  # of the trial strain: the same
_STRAIGHT = 2e-4  # part of the strain of a step by which a secant may go on
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
def _on_pyramid(s1, s2, s3, numbers):
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
def _cut_off(s1, s2, s3, t1, t2, t3, numbers):
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
    t1, t2, t3, _ = _on_pyramid(s1, s2, s3, numbers)
    return _cut_off(s1, s2, s3, t1, t2, t3, numbers) if cuts else (t1, t2, t3)


@inlined
def _plastic_shear(s, t, shear):
    """Largest difference of the principal plastic strains that take `s` to `t`."""
    a, b, c = s[0] - t[0], s[1] - t[1], s[2] - t[2]
    high, low = (a if a > b else b), (b if a > b else a)
    return 0.5 * ((c if c > high else high) - (c if c < low else low)) / shear


@inlined
def _plastic_work(s, t, bulk, shear):
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
def _softer(values, slopes, strain):
    """The three numbers of the strength after more strain."""
    return values[0] + slopes[0] * strain, values[1] + slopes[1] * strain, values[2] + slopes[2] * strain


@inlined
def _give(values, shear, lame):
    """Plastic shear strain per strength, on a face."""
    return 0.5 / (lame * values[0] * values[2] + shear * (1.0 + values[0] * values[2]))


@inlined
def _with_memory(s, tables, r, start, part, cutoff, rate, reference, lame, shear):
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
        off = _plastic_shear(s, t, shear) - x
        if abs(off) <= _SMALL * x + _NOISE * widest:
            break
        low, high = (x, high) if off > 0.0 else (low, x)
        give = _give(values, shear, lame)
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


@inlined
def _outside(tile, count, like, sine, strength, cutoff):
    """Whether the stress of any lane is outside the cone within the pyramid, or a cone within the cut-off."""
    wide, uncut = 1.0 + sine * sine / 3.0, cutoff == math.inf
    outside = 0.0
    for k in range(LANES):
        s = la.from_lane(tile, 0, k, like)
        p = (s[0] + s[1] + s[2]) / 3.0
        j2 = 0.5 * ((s[0] - p) ** 2 + (s[1] - p) ** 2 + (s[2] - p) ** 2)
        for c in range(3, len(like)):
            j2 += tile[c * LANES + k] ** 2
        room, below = 0.5 * strength - p * sine, cutoff - p
        inside = (j2 * wide <= room * room) & (room >= 0.0)
        inside &= uncut | ((4.0 / 3.0 * j2 <= below * below) & (below >= 0.0))
        outside += 0.0 if inside | (k >= count) else 1.0
    return outside > 0.0


@inlined
def _sorted(tile, start, k):
    """Descending order of z, high and low of a lane, of which high >= low, and these."""
    z, high, low = la.from_lane(tile, start, k, (0.0, 0.0, 0.0))
    middle = high if high < z else z
    return (high if high > z else z), (low if low > middle else middle), (low if low < z else z), (z, high, low)


@inlined
def _keep(tile, start, k, values, t, yields):
    """Write z, high, low that are `t` in order, and whether they are other ones; the old `values` tell their order."""
    z, high, low = values
    first, last = z > high, z < low
    new = t[0] if first else (t[2] if last else t[1])
    la.to_lane(tile, start, k, (new, t[1] if first else t[0], t[1] if last else t[2], 1.0 if yields else 0.0))


@inlined
def _return_tile(tile, n, table, cutoff, lame, shear):
    """New values z, high, low after the old ones of all lanes, and 1 where they are new, for a constant strength."""
    numbers = pyramid(table[1, 0], table[3, 0], table[2, 0], cutoff, lame, shear)
    for k in range(LANES):
        s1, s2, s3, values = _sorted(tile, 3 * n, k)
        t1, t2, t3, excess = _on_pyramid(s1, s2, s3, numbers)
        t = _cut_off(s1, s2, s3, t1, t2, t3, numbers) if cutoff < math.inf else (t1, t2, t3)
        _keep(tile, 3 * n + 3, k, values, t, (excess > 0.0) | (s1 > cutoff))


@inlined
def _look_up(tile, count, base, start, numbers, tables, state, columns):
    """What `_soften_tile` needs of the lanes.

    Strength at their plastic shear strain, its slopes, how far these hold, the part that counts, and elasticity.
    """
    memory, part, _ = columns
    for k in range(count):
        r = base + k if numbers.shape[0] > 1 else 0
        values, slopes, room = strength_at(tables, r, state[base + k, memory] if memory >= 0 else 0.0)
        la.to_lane(tile, start, k, values)
        la.to_lane(tile, start + 3, k, slopes)
        la.to_lane(tile, start + 6, k, (room, state[base + k, part] if part >= 0 else 1.0))
        if numbers.shape[0] > 1:
            _tell(tile, start + 8, k, numbers, r)


@inlined
def _tell(tile, start, k, numbers, r):
    """Elasticity and cut-off of a lane."""
    la.to_lane(tile, start, k, (numbers[r, 0] - 2.0 / 3.0 * numbers[r, 1], numbers[r, 1], numbers[r, 2]))


@inlined
def _soften_tile(tile, n, cuts):
    """As `_return_tile`, for a strength of the strain after the step, by a secant step from two returns in all lanes.

    One return is to the strength of before, the other to that of the strain which a face would take. Their line goes
    on to the strain that agrees with its return: stress is linear in the strength, and follows it along that line.
    After z, high, low come whether they are new, then the plastic shear strain of the step, -1 where it is not found.
    """
    for k in range(LANES):
        s1, s2, s3, old = _sorted(tile, 3 * n, k)
        s = s1, s2, s3
        values = la.from_lane(tile, 3 * n + VALUES, k, (0.0, 0.0, 0.0))
        slopes = la.from_lane(tile, 3 * n + VALUES + 3, k, (0.0, 0.0, 0.0))
        room, part, lame, shear, cutoff = la.from_lane(tile, 3 * n + VALUES + 6, k, (0.0, 0.0, 0.0, 0.0, 0.0))
        before = returned(s, pyramid(values[0], values[2], values[1], cutoff, lame, shear), cuts)
        give, first = _give(values, shear, lame), _plastic_shear(s, before, shear)
        guess = first / (1.0 + give * part * (slopes[1] - slopes[0] * (before[0] + before[2])))
        values = _softer(values, slopes, part * guess)
        t = returned(s, pyramid(values[0], values[2], values[1], cutoff, lame, shear), cuts)
        second = _plastic_shear(s, t, shear)
        more = (second - guess) / (1.0 - (second - first) / (guess if guess > 0.0 else 1.0))
        x, on = guess + more, more / (guess if guess > 0.0 else 1.0)
        t = t[0] + on * (t[0] - before[0]), t[1] + on * (t[1] - before[1]), t[2] + on * (t[2] - before[2])
        found = (abs(more) <= _STRAIGHT * guess) & (part * x < room) & (x >= 0.0)
        _keep(tile, 3 * n + 3, k, old, t, (t[0] != s1) | (t[2] != s3))
        la.to_lane(tile, 3 * n + 7, k, (x if found else -1.0,))


@inlined
def _soften_lanes(tile, count, base, n, numbers, tables, dt, state, columns):
    """Bracket what `_soften_tile` has not found, or all where the strength follows the rate, and store the strain."""
    memory = columns[0]
    for k in range(count):
        r = base + k if numbers.shape[0] > 1 else 0
        x, part = tile[(3 * n + 7) * LANES + k], tile[(3 * n + VALUES + 7) * LANES + k]
        rate = numbers[r, 3]
        if rate > 0.0 or x < 0.0:
            s1, s2, s3, old = _sorted(tile, 3 * n, k)
            lame, shear, cutoff = la.from_lane(tile, 3 * n + VALUES + 8, k, (0.0, 0.0, 0.0))
            start = state[base + k, memory] if memory >= 0 else 0.0
            reference = numbers[r, 4] * dt
            t, x = _with_memory((s1, s2, s3), tables, r, start, part, cutoff, rate, reference, lame, shear)
            _keep(tile, 3 * n + 3, k, old, t, (t[0] != s1) | (t[2] != s3))
        if memory >= 0:
            state[base + k, memory] += part * x


@inlined
def _work(tile, n, k, bulk, shear):
    """Plastic work per volume of a lane."""
    old = la.from_lane(tile, 3 * n, k, (0.0, 0.0, 0.0))
    new = la.from_lane(tile, 3 * n + 3, k, (0.0, 0.0, 0.0))
    return _plastic_work(old, new, bulk, shear)


@kernel
def advance(numbers, tables, dt, stress, strain_increment, state, columns, dim):
    """Advance all rows of `MohrCoulomb.compute_stress`.

    `numbers` (n, 5) and `tables` (n, 4, m) of each row, or (1, ...) of all, are those of `MohrCoulomb.numbers` and
    `MohrCoulomb.table`. `columns` of the state are those of the plastic shear strain, of the part of it that counts and
    of the dissipation; one that the state lacks is -1. `dim` is a tuple of as many zeros as there are dimensions.
    """
    like = la.zero_symmetric(dim)
    n = len(like)
    memory, _, dissipation = columns
    own = numbers.shape[0] > 1
    plain = memory < 0 and not own
    table, cuts = tables[0], numbers[:, 2].min() < math.inf
    tile = np.ones((3 * n + VALUES + 11) * LANES)
    for k in range(LANES):
        _tell(tile, 3 * n + VALUES + 8, k, numbers, 0)
    for base in range(0, stress.shape[0], LANES):
        count = min(LANES, stress.shape[0] - base)
        for k in range(count):
            b = base + k
            r = b if own else 0
            bulk, shear = numbers[r, 0], numbers[r, 1]
            lame = bulk - 2.0 / 3.0 * shear
            volumetric = lame * (strain_increment[b, 0] + strain_increment[b, 1] + strain_increment[b, 2])
            for c in range(n):
                stress[b, c] += 2.0 * shear * strain_increment[b, c] + (volumetric if c < 3 else 0.0)
            la.to_lane(tile, 0, k, la.symmetric_at(stress, b, 0, dim))
        if dissipation >= 0:
            state[base : base + count, dissipation] = 0.0
        bulk, shear, cutoff = numbers[0, 0], numbers[0, 1], numbers[0, 2]
        if plain and not _outside(tile, count, like, table[1, 0], table[2, 0], cutoff):
            continue
        take_apart(tile, like)
        if plain:
            _return_tile(tile, n, table, cutoff, bulk - 2.0 / 3.0 * shear, shear)
        else:
            _look_up(tile, count, base, 3 * n + VALUES, numbers, tables, state, columns)
            _soften_tile(tile, n, cuts)
            _soften_lanes(tile, count, base, n, numbers, tables, dt, state, columns)
        put_together(tile, like, 3 * n + 3)
        for k in range(count):
            if tile[(3 * n + 6) * LANES + k] == 0.0:
                continue
            for c in range(n):
                stress[base + k, c] = tile[c * LANES + k]
            if dissipation >= 0:
                r = base + k if own else 0
                state[base + k, dissipation] = _work(tile, n, k, numbers[r, 0], numbers[r, 1])


@kernel
def fill_tension_limit(numbers, tables, state, memory, limit):
    """Fill the mean stress (n,) Pa at the apex, or the cut-off if that is lower; `memory` as in `advance`."""
    for b in range(limit.shape[0]):
        r = b if numbers.shape[0] > 1 else 0
        values, _, _ = strength_at(tables, r, state[b, memory] if memory >= 0 else 0.0)
        apex = values[1] / (2.0 * values[0]) if values[0] > 0.0 else math.inf
        limit[b] = apex if apex < numbers[r, 2] else numbers[r, 2]
