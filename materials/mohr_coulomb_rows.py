"""The loop over rows of Mohr-Coulomb: returns of `mohr_coulomb_return` in tiles of many lanes."""

import math

import numpy as np

from periporo.core.numerics import algebra as la
from periporo.core.numerics.algebra import LANES
from periporo.core.numerics.elasticity import add_elastic
from periporo.core.numerics.jit import inlined, kernel
from periporo.materials.mohr_coulomb_return import (
    cut_off,
    give_on_face,
    on_pyramid,
    plastic_shear,
    plastic_work,
    pyramid,
    returned,
    returned_with_memory,
    softer,
    strength_at,
)
from periporo.materials.principal import VALUES, put_together, take_apart

_STRAIGHT = 2e-4  # part of the strain of a step by which a secant may go on


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
        t1, t2, t3, excess = on_pyramid(s1, s2, s3, numbers)
        t = cut_off(s1, s2, s3, t1, t2, t3, numbers) if cutoff < math.inf else (t1, t2, t3)
        _keep(tile, 3 * n + 3, k, values, t, (excess > 0.0) | (s1 > cutoff))


@inlined
def _look_up(tile, count, base, start, numbers, tables, state, columns):
    """What `_return_each` and `_soften_tile` need of the lanes.

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
def _return_each(tile, n, cuts):
    """As `_return_tile`, for lanes with a strength each that does not change."""
    for k in range(LANES):
        s1, s2, s3, old = _sorted(tile, 3 * n, k)
        sine, strength, dilation = la.from_lane(tile, 3 * n + VALUES, k, (0.0, 0.0, 0.0))
        lame, shear, cutoff = la.from_lane(tile, 3 * n + VALUES + 8, k, (0.0, 0.0, 0.0))
        t = returned((s1, s2, s3), pyramid(sine, dilation, strength, cutoff, lame, shear), cuts)
        _keep(tile, 3 * n + 3, k, old, t, (t[0] != s1) | (t[2] != s3))


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
        give, first = give_on_face(values, shear, lame), plastic_shear(s, before, shear)
        guess = first / (1.0 + give * part * (slopes[1] - slopes[0] * (before[0] + before[2])))
        values = softer(values, slopes, part * guess)
        t = returned(s, pyramid(values[0], values[2], values[1], cutoff, lame, shear), cuts)
        second = plastic_shear(s, t, shear)
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
            start, reference = state[base + k, memory], numbers[r, 4] * dt
            t, x = returned_with_memory((s1, s2, s3), tables, r, start, part, cutoff, rate, reference, lame, shear)
            _keep(tile, 3 * n + 3, k, old, t, (t[0] != s1) | (t[2] != s3))
        state[base + k, memory] += part * x


@inlined
def _work(tile, n, k, bulk, shear):
    """Plastic work per volume of a lane."""
    old = la.from_lane(tile, 3 * n, k, (0.0, 0.0, 0.0))
    new = la.from_lane(tile, 3 * n + 3, k, (0.0, 0.0, 0.0))
    return plastic_work(old, new, bulk, shear)


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
            add_elastic(numbers[r, 0], numbers[r, 1], b, stress, strain_increment)
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
            if memory >= 0:
                _soften_tile(tile, n, cuts)
                _soften_lanes(tile, count, base, n, numbers, tables, dt, state, columns)
            else:
                _return_each(tile, n, cuts)
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
