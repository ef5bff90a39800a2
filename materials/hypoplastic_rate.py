"""Rate equations of hypoplastic sand, and their integration with substeps whose error is controlled.

s' = M : D with M from L, N and the intergranular strain d (von Wolffersdorff 1996; Niemunis & Herle 1997). Tension is
positive; s^ = s/tr(s) and its deviator s* do not depend on that.
"""

import math

import numpy as np

from periporo.core.numerics.jit import inlined, kernel

_NEAR = 0.02  # change of a base below which the series of its power is exact to 1e-11
_SAFETY, _LEAST, _MOST = 0.9, 0.1, 4.0  # factors of the next substep
_ROUNDING = 1e-12  # of a step
_THIRD = 1.0 / math.sqrt(3.0)

STRESS, INTERGRANULAR, VOID = 0, 6, 12
"""Places in the vector of unknowns: stress over 0, intergranular strain over R, void ratio."""


@inlined
def _power_near(ratio, exponent):
    """ratio^exponent, by the binomial series if the ratio is near to 1."""
    x = ratio - 1.0
    if abs(x) > _NEAR:
        return ratio**exponent
    k = exponent
    terms = 1.0 + (k - 4.0) / 5.0 * x * (1.0 + (k - 5.0) / 6.0 * x)
    return 1.0 + k * x * (1.0 + (k - 1.0) / 2.0 * x * (1.0 + (k - 2.0) / 3.0 * x * (1.0 + (k - 3.0) / 4.0 * x * terms)))


@inlined
def _product(a, i, b, j):
    """a : b of symmetric tensors that begin at i and j."""
    normal = a[i] * b[j] + a[i + 1] * b[j + 1] + a[i + 2] * b[j + 2]
    return normal + 2.0 * (a[i + 3] * b[j + 3] + a[i + 4] * b[j + 4] + a[i + 5] * b[j + 5])


@inlined
def _exp_near(y):
    """exp(y), by its series if y is near to 0."""
    if abs(y) > _NEAR:
        return math.exp(y)
    return 1.0 + y * (1.0 + y / 2.0 * (1.0 + y / 3.0 * (1.0 + y / 4.0 * (1.0 + y / 5.0))))


@inlined
def density_factors(pressure, void, sand):
    """x = (3p/h_s)^n, exp(-x), what f_d is a power of, f_s and f_d of a pressure in Pa and a void ratio."""
    hardness, n, dense, critical, loose, alpha, beta, _, constant = sand
    share = 3.0 * pressure / hardness
    x = share**n
    fade = math.exp(-x)
    limit = loose * fade
    stiffness = hardness / n * (limit / void) ** beta * (1.0 + limit) / limit * share / x * constant
    room = (void - dense * fade) / ((critical - dense) * fade)
    return x, fade, room, stiffness, room**alpha if room > 0.0 else 0.0


@inlined
def _factors_near(before, old_pressure, old_void, pressure, void, sand):
    """f_s and f_d as `density_factors`, near to a place where those are `before`."""
    _, n, dense, critical, loose, alpha, beta, _, _ = sand
    x, old_fade, old_room, stiffness, looseness = before
    grown = _power_near(pressure / old_pressure, n)
    fall = _exp_near(x - x * grown)
    fade = old_fade * fall
    stiffness *= _power_near(fall * old_void / void, beta) * (1.0 + loose * fade) / (fall * (1.0 + loose * old_fade))
    stiffness *= pressure / (old_pressure * grown)
    room = (void - dense * fade) / ((critical - dense) * fade)
    if not (room > 0.0 and old_room > 0.0):
        return stiffness, 0.0
    return stiffness, looseness * _power_near(room / old_room, alpha)


@inlined
def shape_factors(y):
    """tr(s^ : s^) and F of the stress at the beginning of `y`."""
    trace = y[0] + y[1] + y[2]
    square = _product(y, 0, y, 0) / (trace * trace)
    dev = square - 1.0 / 3.0
    if not dev > 1e-20:
        return square, 1.0
    a, b, c = y[0] / trace - 1.0 / 3.0, y[1] / trace - 1.0 / 3.0, y[2] / trace - 1.0 / 3.0
    d, e, f = y[3] / trace, y[4] / trace, y[5] / trace
    third = 3.0 * (a * (b * c - e * e) - d * (d * c - e * f) + f * (d * e - b * f))  # tr of the cube
    cosine = -math.sqrt(6.0) * third / (dev * math.sqrt(dev))
    cosine = min(max(cosine, -1.0), 1.0)
    slope = math.sqrt(3.0 * dev)
    inner = slope * slope / 8.0 + (2.0 - slope * slope) / (2.0 + math.sqrt(2.0) * slope * cosine)
    return square, math.sqrt(max(inner, 0.0)) - slope / (2.0 * math.sqrt(2.0))


@inlined
def _rate(y, strain, stiffness, looseness, sand, small, rate):
    """Fill the `rate` of the unknowns `y` under the strain (6,) of the step."""
    a = sand[7]
    radius, stiff, turned, fading, chi = small
    trace = y[0] + y[1] + y[2]
    square, shape = shape_factors(y)
    scale = stiffness / square
    size = math.sqrt(_product(y, INTERGRANULAR, y, INTERGRANULAR))  # rho, for d stands over R
    along = _product(y, INTERGRANULAR, strain, 0) / size if size > 0.0 else 0.0
    along_stress = _product(y, INTERGRANULAR, y, STRESS) / (size * trace) if size > 0.0 else 0.0
    through = _product(strain, 0, y, STRESS) / trace
    full = min(size, 1.0)
    share = full**chi if full < 1.0 else 1.0
    linear = share * turned + (1.0 - share) * stiff
    more = share * (1.0 - turned) * along if along > 0.0 else share * (stiff - turned) * along
    plastic = share * looseness * a * shape * along if along > 0.0 else 0.0
    kept = (full**fading if full < 1.0 else 1.0) * along if along > 0.0 else 0.0
    direct = linear * a * a * through + more * a * a * along_stress
    for c in range(6):
        unit = y[INTERGRANULAR + c] / size if size > 0.0 else 0.0
        hat = y[c] / trace
        star = hat - (1.0 / 3.0 if c < 3 else 0.0)
        own = shape * shape * (linear * strain[c] + more * unit)
        rate[c] = scale * (own + direct * hat + plastic * (hat + star))
        rate[INTERGRANULAR + c] = (strain[c] - kept * unit) / radius
    rate[VOID] = (1.0 + y[VOID]) * (strain[0] + strain[1] + strain[2])


@inlined
def _work_lost(y, change, strain, part, stiffness, stiff, a):
    """Work per volume of the strain that unloading with the stiffness m_R L would not give back."""
    square, shape = shape_factors(y)
    scale, trace = stiff * stiffness / square * shape * shape, y[0] + y[1] + y[2]
    through = _product(change, 0, y, 0) / trace * a * a / (shape * shape + a * a * square)
    given = (_product(y, 0, change, 0) - through * square * trace) / scale
    return part * _product(y, 0, strain, 0) - given


@inlined
def _advance_row(y, strain, sand, small, lowest, tolerance, most, work, reports):
    """Take the unknowns through the strain of a step; substeps done, 0 if too many, what opens, and the work lost if it
    `reports` that.

    Modified Euler's method, whose difference from Euler's is the error (Sloan 1987). Stress does not pass the pressure
    `lowest`: what expands beyond opens.
    """
    first, second, trial = work[0], work[1], work[2]
    done, step, lost = 0.0, 1.0, 0.0
    for count in range(1, most + 1):
        start = -(y[0] + y[1] + y[2]) / 3.0
        before = density_factors(start, y[VOID], sand)
        error = math.inf
        _rate(y, strain, before[3], before[4], sand, small, first)
        for _ in range(40):
            for c in range(VOID + 1):
                trial[c] = y[c] + step * first[c]
            pressure = -(trial[0] + trial[1] + trial[2]) / 3.0
            error = math.inf
            if pressure > 0.1 * lowest:
                stiffness, looseness = _factors_near(before, start, y[VOID], pressure, trial[VOID], sand)
                _rate(trial, strain, stiffness, looseness, sand, small, second)
                square = largest = inner = 0.0
                for c in range(6):
                    weight = 1.0 if c < 3 else 2.0
                    square += weight * (0.5 * step * (second[c] - first[c])) ** 2
                    largest += weight * trial[c] ** 2
                    inner += weight * (0.5 * step * (second[INTERGRANULAR + c] - first[INTERGRANULAR + c])) ** 2
                error = math.sqrt(max(square / largest, 0.01 * inner)) / tolerance
            if error <= 1.0 or math.isnan(error):
                break
            step *= max(_SAFETY / math.sqrt(error), _LEAST)
            if step < _ROUNDING:
                break
        volumetric = strain[0] + strain[1] + strain[2]
        apart = not error <= 1.0 and not math.isnan(error)  # steps cannot be short enough: the pressure vanishes
        if not apart:
            for c in range(VOID + 1):
                second[c] = 0.5 * step * (first[c] + second[c])
            if reports:
                lost += _work_lost(y, second, strain, step, before[3], small[1], sand[7])
            for c in range(VOID + 1):
                y[c] += second[c]
            done += step
        size = math.sqrt(_product(y, INTERGRANULAR, y, INTERGRANULAR))
        if size > 1.0:
            for c in range(6):
                y[INTERGRANULAR + c] /= size
        if apart or -(y[0] + y[1] + y[2]) / 3.0 < lowest:
            for c in range(6):  # grains that have come apart remember no reversal: closing is as if it had gone on
                y[c] = -lowest if c < 3 else 0.0
                y[INTERGRANULAR + c] = -_THIRD if c < 3 else 0.0
            return count, max((1.0 - done) * volumetric, 0.0), lost
        if done >= 1.0 - _ROUNDING or math.isnan(error):
            return count, 0.0, lost
        step = min(step * min(_SAFETY / math.sqrt(error), _MOST) if error > 0.0 else _MOST * step, 1.0 - done)
    return 0, 0.0, lost


@inlined
def _numbers_of(numbers, b):
    """Constants, numbers of small strains, smallest pressure, tolerance and most substeps of row b."""
    n = numbers[b if numbers.shape[0] > 1 else 0]
    sand = n[0], n[1], n[2], n[3], n[4], n[5], n[6], n[7], n[8]
    return sand, (n[9], n[10], n[11], n[12], n[13]), n[14], n[15], n[16]


@kernel
def advance(numbers, stress, strain_increment, state, opened, dissipation, refused):
    """Advance all rows of `HypoplasticSand.compute_stress`; `refused` (n,) tells which need too many substeps.

    `numbers` (n, 17) of each row, or (1, 17) of all, are those of `HypoplasticSand.numbers`. The state has the void
    ratio in column 0 and the intergranular strain behind it; `opened` and `dissipation` are columns, the latter -1 if
    there is none. Rows without state, and rows that are open, stay as they are.
    """
    n = stress.shape[1]
    y, strain, work = np.zeros(VOID + 1), np.zeros(6), np.zeros((3, VOID + 1))
    for b in range(stress.shape[0]):
        sand, small, lowest, tolerance, most = _numbers_of(numbers, b)
        refused[b] = False
        if dissipation >= 0:
            state[b, dissipation] = 0.0
        moves = False
        y[:] = 0.0
        for c in range(n):
            strain[c] = strain_increment[b, c]
            moves |= strain[c] != 0.0
            y[c] = stress[b, c]
            y[INTERGRANULAR + c] = state[b, 1 + c] / small[0]
        y[VOID] = state[b, 0]
        if not moves or y[VOID] == 0.0:
            continue
        if state[b, opened] > 0.0 or -(y[0] + y[1] + y[2]) / 3.0 < lowest:
            for c in range(n):
                y[c] = stress[b, c] = -lowest if c < 3 else 0.0
            if state[b, opened] > 0.0:
                continue
        count, gap, lost = _advance_row(y, strain, sand, small, lowest, tolerance, int(most), work, dissipation >= 0)
        if count == 0:
            refused[b] = True
            continue
        for c in range(n):
            stress[b, c] = y[c]
            state[b, 1 + c] = y[INTERGRANULAR + c] * small[0]
        state[b, 0] = y[VOID]
        state[b, opened] += gap
        if dissipation >= 0:
            state[b, dissipation] = lost


@kernel
def fill_moduli(numbers, stress, state, bulk, shear):
    """Fill bulk and shear modulus (n,) Pa of small strains: a bound of m_R L, m_T L and what is between."""
    n = stress.shape[1]
    y = np.zeros(VOID + 1)
    for b in range(stress.shape[0]):
        sand, small, lowest, _, _ = _numbers_of(numbers, b)
        for c in range(n):
            y[c] = stress[b, c]
        pressure = -(y[0] + y[1] + y[2]) / 3.0
        if not pressure > lowest:
            pressure = lowest
            for c in range(n):
                y[c] = -lowest if c < 3 else 0.0
        void = state[b, 0] if state[b, 0] > 0.0 else sand[4]
        stiffness = density_factors(pressure, void, sand)[3]
        square, shape = shape_factors(y)
        scale = small[1] * stiffness / square
        a2 = sand[7] * sand[7]
        size = math.sqrt(square)  # the intergranular strain may lie along the stress, and the next strain beside it
        bulk[b] = scale * (shape * shape + a2 * size / math.sqrt(3.0)) / 3.0
        shear[b] = 0.5 * scale * (shape * shape + a2 * size * math.sqrt(max(square - 1.0 / 3.0, 0.0)))
