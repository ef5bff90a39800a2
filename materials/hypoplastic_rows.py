"""Loops over rows of hypoplastic sand: one substep for many rows at once, more for those whose error asks for it."""

import math

import numpy as np

from periporo.core.numerics import algebra as la
from periporo.core.numerics.algebra import LANES
from periporo.core.numerics.jit import inlined, kernel
from periporo.materials.hypoplastic_rate import (
    NEAR,
    density_factors,
    grain_factors,
    plus,
    product,
    shape_factors,
    substep,
    times,
    work_lost,
)

_SAFETY, _LEAST, _MOST = 0.9, 0.1, 4.0  # factors of the next substep
_ROUNDING = 1e-12  # of a step
_THIRD = 1.0 / math.sqrt(3.0)

# quantities of a lane: see `lanes.LANES`
_STRAIN, _STRESS, _GRAINS, _VOID, _DENSITY, _SIZE, _NUMBERS = 0, 6, 12, 18, 19, 25, 28
_DONE, _QUANTITIES = _NUMBERS + 17, _NUMBERS + 19


@inlined
def _at_most_one(grains):
    """The intergranular strain, made shorter if it is longer than R."""
    return times(1.0 / max(math.sqrt(product(grains, grains)), 1.0), grains)


@inlined
def _advance_row(s, grains, void, strain, sand, small, lowest, tolerance, most, reports):
    """Take the unknowns through the strain of a step; then substeps done, 0 if too many, what opens, and the work lost
    if it `reports` that.

    Stress does not pass the pressure `lowest`: what expands beyond opens.
    """
    done, step, lost = 0.0, 1.0, 0.0
    volumetric = strain[0] + strain[1] + strain[2]
    for count in range(1, most + 1):
        before = density_factors(-(s[0] + s[1] + s[2]) / 3.0, void, sand)
        factors = grain_factors(grains, small)
        change, turn, growth, error = s, grains, 0.0, math.inf
        for _ in range(40):
            change, turn, growth, square, _ = substep(
                s, grains, void, strain, step, before, factors, sand, small, False
            )
            error = math.sqrt(square) / tolerance
            if error <= 1.0 or math.isnan(error):
                break
            step *= max(_SAFETY / math.sqrt(error), _LEAST)
            if step < _ROUNDING:
                break
        apart = not error <= 1.0 and not math.isnan(error)  # steps cannot be short enough: the pressure vanishes
        if not apart:
            if reports:
                lost += work_lost(s, change, strain, step, before[5], small[1], sand[7])
            s, grains, void = plus(s, 1.0, change), _at_most_one(plus(grains, 1.0, turn)), void + growth
            done += step
        if apart or -(s[0] + s[1] + s[2]) / 3.0 < lowest:
            s = (-lowest, -lowest, -lowest, 0.0, 0.0, 0.0)
            # grains that have come apart remember no reversal: closing is as if it had gone on
            grains = (-_THIRD, -_THIRD, -_THIRD, 0.0, 0.0, 0.0)
            return s, grains, void, count, max((1.0 - done) * volumetric, 0.0), lost
        if done >= 1.0 - _ROUNDING or math.isnan(error):
            return s, grains, void, count, 0.0, lost
        step = min(step * min(_SAFETY / math.sqrt(error), _MOST) if error > 0.0 else _MOST * step, 1.0 - done)
    return s, grains, void, 0, 0.0, lost


@inlined
def _numbers_of(numbers, b):
    """Constants, numbers of small strains, smallest pressure, tolerance and most substeps of row b."""
    n = numbers[b if numbers.shape[0] > 1 else 0]
    sand = n[0], n[1], n[2], n[3], n[4], n[5], n[6], n[7], n[8]
    return sand, (n[9], n[10], n[11], n[12], n[13]), (n[14], n[15], n[16])


@inlined
def _six(rows, b, first, n):
    """The tensor with n = 4 or 6 components in the columns `first` ... of row b, as a tuple of 6."""
    return (
        rows[b, first], rows[b, first + 1], rows[b, first + 2], rows[b, first + 3],
        rows[b, first + 4] if n == 6 else 0.0, rows[b, first + 5] if n == 6 else 0.0,
    )  # fmt: skip


@inlined
def _load(k, s, grains, void, strain, numbers, tile):
    """Put a row with its `numbers` into lane k."""
    sand, small, bounds = numbers
    la.to_lane(tile, _STRAIN, k, strain)
    la.to_lane(tile, _STRESS, k, s)
    la.to_lane(tile, _GRAINS, k, grains)
    tile[_VOID * LANES + k] = void
    la.to_lane(tile, _DENSITY, k, density_factors(-(s[0] + s[1] + s[2]) / 3.0, void, sand))
    la.to_lane(tile, _SIZE, k, grain_factors(grains, small))
    la.to_lane(tile, _NUMBERS, k, sand)
    la.to_lane(tile, _NUMBERS + 9, k, small)
    la.to_lane(tile, _NUMBERS + 14, k, bounds)


@inlined
def _advance_lane(k, tile):
    """Take lane k through its strain in one substep; whether that was right, and the work lost, behind it."""
    six, nine = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    strain, s = la.from_lane(tile, _STRAIN, k, six), la.from_lane(tile, _STRESS, k, six)
    grains, void = la.from_lane(tile, _GRAINS, k, six), tile[_VOID * LANES + k]
    before, factors = la.from_lane(tile, _DENSITY, k, six), la.from_lane(tile, _SIZE, k, (0.0, 0.0, 0.0))
    sand, small = la.from_lane(tile, _NUMBERS, k, nine), la.from_lane(tile, _NUMBERS + 9, k, (0.0, 0.0, 0.0, 0.0, 0.0))
    lowest, tolerance = la.from_lane(tile, _NUMBERS + 14, k, (0.0, 0.0))
    change, turn, growth, square, far = substep(s, grains, void, strain, 1.0, before, factors, sand, small, True)
    new = plus(s, 1.0, change)
    right = square <= tolerance * tolerance and far <= NEAR and -(new[0] + new[1] + new[2]) / 3.0 >= lowest
    tile[_DONE * LANES + k] = 1.0 if right else 0.0
    tile[(_DONE + 1) * LANES + k] = work_lost(s, change, strain, 1.0, before[5], small[1], sand[7])
    la.to_lane(tile, _STRESS, k, new)
    la.to_lane(tile, _GRAINS, k, _at_most_one(plus(grains, 1.0, turn)))
    tile[_VOID * LANES + k] = void + growth


@kernel
def advance(numbers, stress, strain_increment, state, opened, dissipation, refused):
    """Advance all rows of `HypoplasticSand.compute_stress`; `refused` (n,) tells which need too many substeps.

    `numbers` (n, 17) of each row, or (1, 17) of all, are those of `HypoplasticSand.numbers`. The state has the void
    ratio in column 0 and the intergranular strain behind it; `opened` and `dissipation` are columns, the latter -1 if
    there is none. Rows without state, and rows that are open, stay as they are.
    """
    n = stress.shape[1]
    tile, rows, used = np.ones(_QUANTITIES * LANES), np.zeros(LANES, np.int64), 0
    for b in range(stress.shape[0]):
        own = _numbers_of(numbers, b)
        lowest = own[2][0]
        refused[b] = False
        if dissipation >= 0:
            state[b, dissipation] = 0.0
        strain, s = _six(strain_increment, b, 0, n), _six(stress, b, 0, n)
        moves = strain != (0.0, 0.0, 0.0, 0.0, 0.0, 0.0) and state[b, 0] != 0.0
        if moves and (state[b, opened] > 0.0 or -(s[0] + s[1] + s[2]) / 3.0 < lowest):
            s = (-lowest, -lowest, -lowest, 0.0, 0.0, 0.0)
            for c in range(n):
                stress[b, c] = s[c]
            moves = not state[b, opened] > 0.0
        if moves:
            grains = times(1.0 / own[1][0], _six(state, b, 1, n))
            _load(used, s, grains, state[b, 0], strain, own, tile)
            rows[used] = b
            used += 1
        if used == LANES or b == stress.shape[0] - 1:
            for k in range(LANES):
                _advance_lane(k, tile)
            for k in range(used):
                r = rows[k]
                sand, small, bounds = _numbers_of(numbers, r)
                s = la.from_lane(tile, _STRESS, k, s)
                grains = la.from_lane(tile, _GRAINS, k, s)
                void, lost, gap = tile[_VOID * LANES + k], tile[(_DONE + 1) * LANES + k], 0.0
                if tile[_DONE * LANES + k] == 0.0:
                    s, grains, strain = _six(stress, r, 0, n), _six(state, r, 1, n), _six(strain_increment, r, 0, n)
                    s, grains, void, count, gap, lost = _advance_row(
                        s, times(1.0 / small[0], grains), state[r, 0], strain, sand, small, bounds[0], bounds[1],
                        int(bounds[2]), dissipation >= 0,
                    )  # fmt: skip
                    if count == 0:
                        refused[r] = True
                        continue
                for c in range(n):
                    stress[r, c] = s[c]
                    state[r, 1 + c] = grains[c] * small[0]
                state[r, 0] = void
                state[r, opened] += gap
                if dissipation >= 0:
                    state[r, dissipation] = lost
            used = 0


@kernel
def fill_moduli(numbers, stress, state, bulk, shear):
    """Fill bulk and shear modulus (n,) Pa of small strains: a bound of m_R L, m_T L and what is between."""
    n = stress.shape[1]
    for b in range(stress.shape[0]):
        sand, small, bounds = _numbers_of(numbers, b)
        s, lowest = _six(stress, b, 0, n), bounds[0]
        pressure = -(s[0] + s[1] + s[2]) / 3.0
        if not pressure > lowest:
            pressure = lowest
            s = (-lowest, -lowest, -lowest, 0.0, 0.0, 0.0)
        void = state[b, 0] if state[b, 0] > 0.0 else sand[4]
        stiffness = density_factors(pressure, void, sand)[5]
        square, shape = shape_factors(s)
        scale = small[1] * stiffness / square
        a2 = sand[7] * sand[7]
        size = math.sqrt(square)  # the intergranular strain may lie along the stress, and the next strain beside it
        bulk[b] = scale * (shape * shape + a2 * size / math.sqrt(3.0)) / 3.0
        shear[b] = 0.5 * scale * (shape * shape + a2 * size * math.sqrt(max(square - 1.0 / 3.0, 0.0)))
